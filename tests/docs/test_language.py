"""Documents have short lines, and none of the phrases that plain engineering English replaces."""

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
PAGES = sorted([*ROOT.glob("*.md"), *(ROOT / "docs").rglob("*.md")])
LONGEST = 100

RETIRED = {
    r"\bin force\b": "active",
    r"\bbeside\b": "with, next to, compared with",
    r"\banew\b": "again",
    r"\bstands? (?:here|there|in|on|at|for)\b": "is, appears",
    r"\btold\b": "reported, shown",
    r"\bby (?:itself|themselves)\b": "automatically, without",
    r"\bwhoever\b": "a person who",
    r"\bgiv(?:e|es|ing) way\b": "switch to compliance, yield",
    r"\bbrought about\b": "injected, caused",
    r"\bon purpose\b": "injected, deliberately",
    r"\b(?:is|was|not|nothing) heard\b": "no heartbeat",
    r"\bleft over\b": "residual, remaining",
    r"\blooked over\b": "checked",
    r"\bgoes by\b": "follows, uses",
    r"\btak(?:e|en|es) (?:it )?in again\b": "imported",
    r"\bput aside\b": "deactivated",
    r"\boutside force\b": "external force",
    r"\bdry friction\b": "Coulomb friction",
    r"\bbegin of\b": "start of",
    r"\bis no number\b": "is not a number",
    r"\bcannot be had\b": "is not available",
    r"\bhanded over\b": "passed, transferred",
    r"\bknows? (?:no|nothing)\b": "does not use",
}
"""Phrases with the words to write instead. Each has no other meaning in a document about Sinew."""

EXCEPTIONS: dict[tuple[str, str], str] = {}
"""Name of a page and phrase that it may contain, with the reason, such as a message that it quotes."""


def prose(text: str) -> list[tuple[int, str]]:
    """Lines of a page with their numbers, without code blocks and without the targets of links."""
    lines, fenced, before = [], False, ""
    for number, line in enumerate(text.splitlines(), 1):
        if line.startswith("```"):
            fenced = not fenced
        elif not fenced and not (line.startswith("    ") and not before.lstrip().startswith(("-", "1."))):
            lines.append((number, re.sub(r"\]\([^)]*\)", "]", line)))
        before = line or before
    return lines


def without_rejected_words(page: Path, line: str) -> str:
    """A row of the glossary without its last cell, which lists the words that it replaces."""
    return line.rsplit("|", 2)[0] if page.name == "glossary.md" and line.startswith("|") else line


ALL = [pytest.param(page, id=str(page.relative_to(ROOT))) for page in PAGES]


@pytest.mark.parametrize("page", ALL)
def test_lines_are_short(page: Path) -> None:
    text = page.read_text(encoding="utf-8")
    assert [number for number, line in prose(text) if len(line) > LONGEST and not line.startswith("|")] == []


@pytest.mark.parametrize("page", ALL)
def test_no_retired_phrase_is_left(page: Path) -> None:
    name = str(page.relative_to(ROOT))
    found = [
        f"{name}:{number}: {match[0]!r}; write {instead}"
        for number, line in prose(page.read_text(encoding="utf-8"))
        for phrase, instead in RETIRED.items()
        if (page.name, phrase) not in EXCEPTIONS
        for match in [re.search(phrase, re.sub(r"`[^`]*`", "", without_rejected_words(page, line)), re.IGNORECASE)]
        if match
    ]
    assert found == []


def test_code_and_targets_of_links_are_not_prose() -> None:
    page = """- an item that
    goes on

A [link](somewhere/far/away.md).

    code

```
fenced
```
end
"""
    assert prose(page) == [
        (1, "- an item that"),
        (2, "    goes on"),
        (3, ""),
        (4, "A [link]."),
        (5, ""),
        (7, ""),
        (11, "end"),
    ]
