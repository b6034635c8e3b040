"""Each document lies in the folder of one purpose, and docs/README.md lists it under that purpose."""

import re
from pathlib import Path

DOCS = Path(__file__).parents[2] / "docs"
SECTIONS = {
    "tutorial": "Tutorial",
    "how-to": "How-to guides",
    "reference": "Reference",
    "explanation": "Explanation",
}
OF_THE_WHOLE = {"README.md", "glossary.md", "where.md"}


def test_each_document_lies_in_the_folder_of_one_purpose() -> None:
    assert {path.name for path in DOCS.glob("*.md")} <= OF_THE_WHOLE
    assert {path.parent.name for path in DOCS.glob("*/*.md")} == {*SECTIONS, "decisions"}
    names = [path.name for purpose in SECTIONS for path in (DOCS / purpose).glob("*.md")]
    assert len(names) == len(set(names)), "the page addresses a document by its name alone"


def test_the_index_lists_each_document_under_its_purpose() -> None:
    index = (DOCS / "README.md").read_text(encoding="utf-8")
    for purpose, heading in SECTIONS.items():
        section = index.split(f"## {heading}\n", 1)[1].split("\n## ", 1)[0]
        listed = {link for link in re.findall(r"\]\(([^)]+)\)", section) if link.startswith(f"{purpose}/")}
        assert listed == {f"{purpose}/{path.name}" for path in (DOCS / purpose).glob("*.md")}


def test_each_document_and_module_that_the_sources_name_exists() -> None:
    """A text of the program that sends somebody to a document is a link, and so is a module in a docstring."""
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
