"""Rules of the repository that no linter checks."""

import ast
import re
import subprocess
from pathlib import Path

import pytest

from backend import __version__

ROOT = Path(__file__).parents[1]
TOP_LEVEL = {
    ".ci", ".dockerignore", ".gitattributes", ".gitignore", "ARCHITECTURE.md", "CHANGELOG.md", "CITATION.cff",
    "CONTRIBUTING.md", "Dockerfile", "Makefile", "README.md", "SECURITY.md", "alembic.ini", "backend",
    "docker-compose.postgres.yml", "docker-compose.yml", "docs", "frontend", "migrations", "plant", "pyproject.toml",
    "tests",
}  # fmt: skip
BANNED_NAMES = {"utils", "util", "helpers", "helper", "common", "manager", "misc"}
MAX_BYTES = 1_000_000


def tracked() -> list[Path]:
    listed = subprocess.run(["git", "ls-files", "-z"], cwd=ROOT, capture_output=True, check=True, text=True)
    return [ROOT / name for name in listed.stdout.split("\0") if name and (ROOT / name).is_file()]


FILES = tracked()
TEXTS = {
    path: path.read_text(encoding="utf-8")
    for path in FILES
    if path.suffix not in {".png", ".webp", ".ico", ".woff2", ".pdf"} and path != Path(__file__)
}


def names(paths: list[Path]) -> list[str]:
    return [str(path.relative_to(ROOT)) for path in paths]


def test_the_top_level_contains_only_listed_files() -> None:
    assert {path.relative_to(ROOT).parts[0] for path in FILES} <= TOP_LEVEL


def test_no_file_has_a_meaningless_name() -> None:
    assert names([path for path in FILES if path.stem.lower() in BANNED_NAMES]) == []


def test_no_large_file_is_tracked() -> None:
    assert names([path for path in FILES if path.stat().st_size > MAX_BYTES]) == []


@pytest.mark.parametrize(
    "pattern",
    [
        pytest.param(r"(?<![\w.$}])/(root|work|home|tmp)/\w", id="path of one machine"),
        pytest.param(r"https?://[^\s\"]*(pypi|npmjs|registry)", id="package registry"),
        pytest.param(r"\b(TODO|FIXME|XXX|HACK)\b", id="unfinished business"),
        pytest.param(r"BEGIN [A-Z ]*PRIVATE KEY", id="private key"),
    ],
)
def test_no_file_contains(pattern: str) -> None:
    assert names([path for path, text in TEXTS.items() if re.search(pattern, text)]) == []


def test_suppressed_checks_state_rule_and_reason() -> None:
    bare = re.compile(r"# (type: ignore|noqa)(?!(\[|: )[\w, -]+\]?.*# \S)|@ts-ignore|biome-ignore(?! .+: \S)")
    found = [
        f"{path.relative_to(ROOT)}: {line.strip()}"
        for path, text in TEXTS.items()
        for line in text.splitlines()
        if path.suffix in {".py", ".ts", ".tsx"} and "tests" not in path.parts and bare.search(line)
    ]
    assert found == []


def test_links_between_documents_have_targets() -> None:
    broken = [
        f"{page.relative_to(ROOT)} -> {target}"
        for page in FILES
        if page.suffix == ".md"
        for target in re.findall(r"\]\((?!https?://|#)([^)#]+)(?:#[^)]*)?\)", TEXTS[page])
        if not (page.parent / target).exists()
    ]
    assert broken == []


def test_all_files_state_the_same_version() -> None:
    assert f'"version": "{__version__}"' in TEXTS[ROOT / "frontend" / "package.json"]
    assert f"\nversion: {__version__}\n" in TEXTS[ROOT / "CITATION.cff"]
    assert f"Version {__version__} is the supported version" in TEXTS[ROOT / "SECURITY.md"]
    released = re.findall(r"^## (\d\S*) – (\S+)$", TEXTS[ROOT / "CHANGELOG.md"], re.MULTILINE)
    assert released[0][0] == __version__
    assert f"\ndate-released: {released[0][1]}\n" in TEXTS[ROOT / "CITATION.cff"]


@pytest.mark.parametrize("page", ["README.md", "CONTRIBUTING.md"])
def test_make_targets_in_the_documents_exist(page: str) -> None:
    named = set(re.findall(r"(?:^ {4}|`)make ([\w-]+)", TEXTS[ROOT / page], re.MULTILINE))
    offered = set(re.findall(r"^([\w-]+):", TEXTS[ROOT / "Makefile"], re.MULTILINE))
    assert {"run", "test"} <= named <= offered


def test_no_public_class_name_has_two_definitions() -> None:
    """A search for a class finds one definition."""
    definitions: dict[str, list[str]] = {}
    for path in sorted(path for folder in ("plant", "backend") for path in (ROOT / folder).rglob("*.py")):
        for node in ast.parse(path.read_text(encoding="utf-8")).body:
            if isinstance(node, ast.ClassDef) and not node.name.startswith("_"):
                definitions.setdefault(node.name, []).append(str(path.relative_to(ROOT)))
    assert {name: found for name, found in definitions.items() if len(found) > 1} == {}
