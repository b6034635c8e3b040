"""docs/where.md names files that exist, and no package is too large."""

import re
from pathlib import Path

ROOT = Path(__file__).parents[2]
PAGE = (ROOT / "docs" / "where.md").read_text(encoding="utf-8")
LARGEST_SHARE = 0.12
"""Largest share of one package in the lines of backend, plant and migrations."""
LARGEST_API = 2_700


def lines(folder: Path) -> int:
    files = [*folder.rglob("*.py"), *folder.rglob("*.pyi")]
    return sum(len(file.read_text(encoding="utf-8").splitlines()) for file in files)


def test_every_place_is_there() -> None:
    rows = re.findall(r"^\| (?!Addition|-)(.*) \|(.*)\|(.*)\|$", PAGE, re.MULTILINE)
    assert len(rows) == 27
    named = [[path for cell in row[1:] for path in re.findall(r"`([^`]+)`", cell)] for row in rows]
    assert all(named)
    assert [path for paths in named for path in paths if not (ROOT / path).exists()] == []


def test_no_package_is_too_large() -> None:
    packages = [ROOT / "plant", *(file.parent for file in (ROOT / "backend").glob("*/__init__.py"))]
    whole = sum(lines(ROOT / part) for part in ("backend", "plant", "migrations"))
    shares = {package.name: lines(package) / whole for package in packages}
    assert len(shares) > 15
    assert {name: round(share, 3) for name, share in shares.items() if share > LARGEST_SHARE} == {}
    assert lines(ROOT / "backend" / "api") < LARGEST_API


def test_contributing_names_files_and_what_they_contain() -> None:
    page = (ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8")
    rows = [row for row in re.findall(r"^\| (`.*) \| (.*) \|$", page, re.MULTILINE) if "/" in row[0]]
    assert len(rows) > 20
    for places, change in rows:
        paths = [ROOT / path for path in re.findall(r"`([^`]+)`", places) if "/" in path and "NAME" not in path]
        assert [path for path in paths if not path.exists()] == []
        names = re.findall(r"`([A-Z]\w+|[a-z]+_\w+)`", change)
        files = [path for path in paths if path.is_file()]
        assert [name for name in names if not any(name in path.read_text(encoding="utf-8") for path in files)] == []
