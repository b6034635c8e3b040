"""Documents: their folders, and the index of modules."""

import re
from pathlib import Path

# Each document is in the folder of its purpose, and docs/README.md lists it under that purpose.

DOCS = Path(__file__).parents[2] / "docs"
SECTIONS = {
    "tutorial": "Tutorial",
    "how-to": "How-to guides",
    "reference": "Reference",
    "explanation": "Explanation",
}
OF_THE_WHOLE = {"README.md", "glossary.md", "where.md"}


def test_documents_are_in_the_folder_of_their_purpose() -> None:
    assert {path.name for path in DOCS.glob("*.md")} <= OF_THE_WHOLE
    assert {path.parent.name for path in DOCS.glob("*/*.md")} == {*SECTIONS, "decisions"}
    names = [path.name for purpose in SECTIONS for path in (DOCS / purpose).glob("*.md")]
    assert len(names) == len(set(names)), "the page addresses a document by its name alone"


def test_the_index_lists_every_document_under_its_purpose() -> None:
    index = (DOCS / "README.md").read_text(encoding="utf-8")
    for purpose, heading in SECTIONS.items():
        section = index.split(f"## {heading}\n", 1)[1].split("\n## ", 1)[0]
        listed = {link for link in re.findall(r"\]\(([^)]+)\)", section) if link.startswith(f"{purpose}/")}
        assert listed == {f"{purpose}/{path.name}" for path in (DOCS / purpose).glob("*.md")}


def test_documents_and_modules_named_in_the_sources_exist() -> None:
    """References to documents in texts of the program, and to modules in docstrings."""
    root = DOCS.parent
    modules = [path for folder in ("backend", "plant", "migrations", "tests") for path in (root / folder).rglob("*.py")]
    sources = [path for path in modules if "tests" not in path.relative_to(root).parts]

    def names(pattern: str) -> list[tuple[str, str]]:
        texts = {path.relative_to(root).as_posix(): path.read_text(encoding="utf-8") for path in sources}
        return sorted({(place, name) for place, text in texts.items() for name in re.findall(pattern, text)})

    documents = names(r"docs/[\w./-]+\.md")
    assert len(documents) > 20
    assert [one for one in documents if not (root / one[1]).exists()] == []
    endings = [f"/{path.relative_to(root).as_posix()}" for path in modules]
    assert [one for one in names(r"``([\w/]+\.py)``") if not any(end.endswith(f"/{one[1]}") for end in endings)] == []


# docs/where.md names files that exist, and no package is too large.

ROOT = Path(__file__).parents[2]
PAGE = (ROOT / "docs" / "where.md").read_text(encoding="utf-8")
LARGEST_SHARE = 0.12
"""Largest share of one package in the lines of backend, plant and migrations."""
LARGEST_API = 2_700


def lines(folder: Path) -> int:
    """Return the number of lines of a package without its message catalogues, which contain no logic."""
    files = [*folder.rglob("*.py"), *folder.rglob("*.pyi")]
    return sum(
        len(file.read_text(encoding="utf-8").splitlines()) for file in files if not file.name.endswith("messages.py")
    )


def test_files_named_in_the_index_of_modules_exist() -> None:
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


def test_files_and_names_in_contributing_exist() -> None:
    page = (ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8")
    rows = [row for row in re.findall(r"^\| (`.*) \| (.*) \|$", page, re.MULTILINE) if "/" in row[0]]
    assert len(rows) > 20
    for places, change in rows:
        paths = [ROOT / path for path in re.findall(r"`([^`]+)`", places) if "/" in path and "NAME" not in path]
        assert [path for path in paths if not path.exists()] == []
        names = re.findall(r"`([A-Z]\w+|[a-z]+_\w+)`", change)
        files = [path for path in paths if path.is_file()]
        assert [name for name in names if not any(name in path.read_text(encoding="utf-8") for path in files)] == []
