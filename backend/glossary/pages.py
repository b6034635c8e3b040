"""What the pages in docs/ define: signals, parameters and quantities of the notation; faults and limits."""

import re
from pathlib import Path

from backend.faults import EXPLAINED, Fault, Limit
from backend.glossary.entry import Entry, Kind

DOCS = Path(__file__).resolve().parents[2] / "docs"

_SECTIONS = (
    ("Signals", Kind.SIGNAL),
    ("Parameters of the plant", Kind.PARAMETER),
    ("Control", Kind.QUANTITY),
    ("Identification", Kind.QUANTITY),
)
_ONE_SOURCE = r"\(\d+\)|table \d|decision \d+|docs/[\w-]+\.md"
_SOURCE = re.compile(rf"^((?:{_ONE_SOURCE})(?:, (?:{_ONE_SOURCE}))*)(?:: (.*))?$")
_PARTS = ("Cause", "Reaction", "Within", "Remedy")


class GlossaryError(ValueError):
    """A page does not say what the glossary needs of it."""


def notation(page: str | None = None) -> list[Entry]:
    """Return the entries of docs/notation.md. Raises GlossaryError."""
    text = _read("notation.md") if page is None else page
    return [entry for heading, kind in _SECTIONS for row in _rows(text, heading) for entry in _of_row(kind, row)]


def faults(page: str | None = None) -> list[Entry]:
    """Return the faults with cause, reaction, time and remedy of docs/faults.md. Raises GlossaryError."""
    text = _read("faults.md") if page is None else page
    sections = dict(re.findall(r"^### `(\w+)`\n(.*?)(?=^##|\Z)", text, re.MULTILINE | re.DOTALL))
    return [_fault(fault, sections.get(fault.value, "")) for fault in Fault if fault is not Fault.NONE]


def limits(page: str | None = None) -> list[Entry]:
    """Return the limits of docs/faults.md. Raises GlossaryError."""
    held = {row[0].strip("`"): row[2] for row in _rows(_read("faults.md") if page is None else page, "Limits")}
    missing = [str(limit.name) for limit in Limit if limit.name not in held]
    if missing:
        raise GlossaryError(f"docs/faults.md does not explain the limits {', '.join(missing)}")
    return [
        Entry(Kind.LIMIT, name, _in_words(name), held[name], source="docs/faults.md")
        for name in (str(limit.name) for limit in Limit)
    ]


def _of_row(kind: Kind, row: list[str]) -> list[Entry]:
    """Return the entry of each code name of a row of the notation: symbol, code names, unit, meaning, equation."""
    symbol, code, unit, meaning, equation = row
    names = re.findall(r"`([\w.]+)`", code)
    if not names or not meaning:
        raise GlossaryError(f"docs/notation.md: {symbol or code!r} needs a code name and a meaning")
    symbols = symbol.split(", ") if len(names) > 1 else [symbol]
    units = unit.split(", ") if len(names) > 1 else [unit]
    found = _SOURCE.match(equation)
    source, equation = (_cited(found[1]), found[2] or "") if found else ("docs/notation.md", equation)
    return [
        Entry(
            kind,
            name,
            (symbols[at] if len(symbols) > at else "") or name,
            meaning,
            _no_one(units[min(at, len(units) - 1)]),
            equation,
            source,
        )
        for at, name in enumerate(names)
    ]


def _cited(cited: str) -> str:
    """Return where equations stand: "(16)" is of the paper, as are its tables."""
    if cited.startswith("docs/"):
        return cited
    if cited.startswith("decision "):
        return f"docs/decisions, {cited}"
    word = "equations " if ", (" in cited else "equation "
    return f"paper, {word if cited.startswith('(') else ''}{cited}"


def _fault(fault: Fault, section: str) -> Entry:
    parts = {part: re.search(rf"^- {part}: (.+)$", section, re.MULTILINE) for part in _PARTS}
    more = tuple((part, _plain(found[1])) for part, found in parts.items() if found)
    if len(more) != len(_PARTS):
        raise GlossaryError(f"docs/faults.md: {fault.value} needs {', '.join(_PARTS)}")
    name = fault.value
    return Entry(Kind.FAULT, name, _in_words(name), EXPLAINED[fault].message, source="docs/faults.md", more=more)


def _rows(page: str, heading: str) -> list[list[str]]:
    """Return the cells of the table under a heading, without its head."""
    if f"\n## {heading}" not in page:
        raise GlossaryError(f"there is no section {heading!r}")
    part = page.split(f"\n## {heading}", 1)[1].split("\n## ", 1)[0]
    lines = re.findall(r"^\|(.*)\|$", part, re.MULTILINE)
    return [[cell.strip() for cell in line.split("|")] for line in lines[2:]]


def _plain(text: str) -> str:
    """Return a text of a page without its markup: a link is its words."""
    return re.sub(r"\[([^\]]+)\]\([^)]+\)", r"\1", text).replace("`", "")


def _in_words(name: str) -> str:
    """Return a name of the code as words: "voltage A", "force limit"."""
    words = name.replace("_", " ").lower()
    return re.sub(r" ([ab])$", lambda side: f" {side[1].upper()}", words)


def _no_one(unit: str) -> str:
    return "" if unit == "1" else unit


def _read(name: str) -> str:
    return (DOCS / name).read_text(encoding="utf-8")
