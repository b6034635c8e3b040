"""Texts of the page, read from its catalogues: tests find elements by role and catalogue entry."""

import re
from functools import cache
from pathlib import Path

SOURCES = Path(__file__).resolve().parents[2] / "frontend" / "src"

_ENTRY = re.compile(r"^\s+(\w+):\s*(?:\n\s+)?\"((?:[^\"\\]|\\.)*)\",?\s*(?://.*)?$", re.MULTILINE)
_ESCAPES = {r"\"": '"', r"\n": "\n", r"\\": "\\"}


@cache
def load_texts(place: str) -> dict[str, str]:
    """Return the texts of a catalogue by name; ``place`` is its folder below the page's sources, "pages/log"."""
    source = (SOURCES / place / "texts.ts").read_text(encoding="utf-8")
    texts = {
        name: re.sub(r"\\.", lambda found: _ESCAPES.get(found[0], found[0]), text)
        for name, text in _ENTRY.findall(source)
    }
    assert texts, f"{place}/texts.ts has no text"
    return texts
