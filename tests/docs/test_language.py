"""Documents have short lines, and contain no phrase that plain engineering English replaces."""

import ast
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
    """Return the lines of a page with their numbers, without code blocks and link targets."""
    lines, fenced, before = [], False, ""
    for number, line in enumerate(text.splitlines(), 1):
        if line.startswith("```"):
            fenced = not fenced
        elif not fenced and not (line.startswith("    ") and not before.lstrip().startswith(("-", "1."))):
            lines.append((number, re.sub(r"\]\([^)]*\)", "]", line)))
        before = line or before
    return lines


def without_rejected_words(page: Path, line: str) -> str:
    """Return a row of the glossary without its last cell, which lists replaced words."""
    return line.rsplit("|", 2)[0] if page.name == "glossary.md" and line.startswith("|") else line


ALL = [pytest.param(page, id=str(page.relative_to(ROOT))) for page in PAGES]


@pytest.mark.parametrize("page", ALL)
def test_lines_are_short(page: Path) -> None:
    text = page.read_text(encoding="utf-8")
    assert [number for number, line in prose(text) if len(line) > LONGEST and not line.startswith("|")] == []


@pytest.mark.parametrize("page", ALL)
def test_documents_contain_no_retired_phrase(page: Path) -> None:
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


def test_code_and_link_targets_are_not_checked_as_prose() -> None:
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


# Texts of the service and the plant ----------------------------------------------------------------
# Refusals, log entries, reports and descriptions are string literals; docstrings are checked by readers only.


RETIRED_IN_TEXTS = {
    r"\bin turn\b": "one after the other",
    r"\bunder way\b": "in progress",
    r"\blooks? (?:at|for|whether|into|over)\b": "check, search",
    r"\b(?:goes|went) on\b": "continues, continued",
    r"\bon (?:its|the) way\b": "in motion",
    r"\blets? go\b": "releases",
    r"\bsays?\b(?! more)": "states, gives",
    r"\btells?\b": "reports, shows",
    r"\bas it (?:is|was) (?:read|written)\b": "visible",
    r"\bhas to be\b": "must be",
    r"\b(?<!there )is no (?!longer\b)": "is not a",
    r"\b(?<!there )are no (?!longer\b)": "are not",
}
"""Further phrases for the texts of the service, which are shorter than the prose of documents."""

TEXT_EXCEPTIONS: dict[tuple[str, str], str] = {
    ("backend/auth/handover.py", r"\bhanded over\b"): "the verb of the term handover",
    ("backend/auth/messages.py", r"\bhanded over\b"): "the verb of the term handover",
    ("backend/banks/tuning_settings.py", r"\bin force\b"): "the key of a stored document",
    ("backend/experiments/forecast.py", r"\bon (?:its|the) way\b"): "the code of a stage, which the page translates",
    ("backend/scene/proxy.py", r"\btells?\b"): "JavaScript",
}
"""Module and phrase that its texts may contain, with the reason."""


def texts(module: Path) -> list[tuple[int, str]]:
    """Return the texts of a module with their lines: literals with a space that are not docstrings."""
    tree = ast.parse(module.read_text(encoding="utf-8"))
    passed = {id(node.value) for node in ast.walk(tree) if isinstance(node, ast.Expr)}
    found = []
    for node in ast.walk(tree):
        if isinstance(node, ast.JoinedStr):
            passed |= {id(part) for part in node.values}
            text = "".join(str(part.value) if isinstance(part, ast.Constant) else "{}" for part in node.values)
            found.append((node.lineno, text))
        elif isinstance(node, ast.Constant) and isinstance(node.value, str) and id(node) not in passed:
            found.append((node.lineno, node.value))
    return [(line, text) for line, text in found if " " in text]


@pytest.mark.parametrize("package", ["backend", "plant"])
def test_texts_of_the_service_contain_no_rejected_phrase(package: str) -> None:
    found = [
        f"{name}:{line}: {text[:80]!r}; write {instead}"
        for module in sorted((ROOT / package).rglob("*.py"))
        for name in [str(module.relative_to(ROOT))]
        for line, text in texts(module)
        for phrase, instead in (RETIRED | RETIRED_IN_TEXTS).items()
        if (name, phrase) not in TEXT_EXCEPTIONS and re.search(phrase, text, re.IGNORECASE)
    ]
    assert found == []


@pytest.mark.parametrize(("name", "phrase"), TEXT_EXCEPTIONS)
def test_every_exception_is_needed(name: str, phrase: str) -> None:
    assert any(re.search(phrase, text, re.IGNORECASE) for _, text in texts(ROOT / name))


TEMPLATE = re.compile(r"(?:GET|POST|PUT|PATCH|DELETE) /api/|.*\$.*\$|√|\s*<(?:head|script)>", re.DOTALL)
"""Texts in which names in braces are right: routes, mathematical notation, JavaScript."""


@pytest.mark.parametrize("package", ["backend", "plant"])
def test_texts_contain_no_unevaluated_expressions(package: str) -> None:
    """A text of several literals loses its values if one of them lacks its f prefix."""
    found = [
        f"{module.relative_to(ROOT)}:{line}: {text[:80]!r}"
        for module in sorted((ROOT / package).rglob("*.py"))
        for line, text in texts(module)
        if re.search(r"\{[A-Za-z_]\w*[}(:.\[]", text) and not TEMPLATE.match(text)
    ]
    assert found == []
