"""Letters that the fonts of a PDF do not have: the PDF shows a box for each, and says in a sentence which they are.

Only fonts that typst carries are used, so that a report looks the same everywhere; they have neither Chinese, Japanese
and Korean letters nor emoji.
"""

import json
from collections.abc import Iterable
from typing import Any

BOX = "\u25a1"
MOST = 5_000
"""Different letters of one document that are looked at; what is beyond them is taken for missing."""

_NAMED = 30
"""Missing letters that the sentence names."""

_NOBODYS = "\U0010ffff"
"""Has no letter in any font: whatever is drawn like it has none either."""

_TEMPLATE = b"""
#set page(width: 40pt, height: 40pt, margin: 4pt)
#set text(font: "Libertinus Serif")
#for letter in json(bytes(sys.inputs.letters)) { text(letter); pagebreak(weak: true) }
"""
_RANGES = ((0x20, 0x7F), (0xA0, 0x180), (0x391, 0x3A2), (0x3A3, 0x3CA))
_PLAIN = frozenset("\n").union(*(map(chr, range(*ends)) for ends in _RANGES))
"""Letters that the fonts have, as tests/reports/test_missing_letters.py sees."""


def missing_letters(texts: Iterable[str]) -> frozenset[str]:
    """Return the letters of texts that the fonts do not have."""
    import typst  # takes its time to load

    asked = sorted(set[str]().union(*texts) - _PLAIN)
    if not asked:
        return frozenset()
    looked_at, rest = asked[:MOST], asked[MOST:]
    pages = typst.compile(
        _TEMPLATE,
        format="svg",
        font_paths=typst.Fonts(include_system_fonts=False),
        sys_inputs={"letters": json.dumps([_NOBODYS, *looked_at])},
    )
    nothing, *drawn = pages
    return frozenset(letter for letter, page in zip(looked_at, drawn, strict=True) if page == nothing) | frozenset(rest)


def with_boxes(document: Any, missing: frozenset[str]) -> Any:
    """Return a document of mappings, lists and texts with a box for each letter that is missing."""
    if isinstance(document, str):
        return document.translate(dict.fromkeys(map(ord, missing), BOX))
    if isinstance(document, dict):
        return {name: with_boxes(part, missing) for name, part in document.items()}
    return [with_boxes(part, missing) for part in document] if isinstance(document, list | tuple) else document


def sentence(missing: frozenset[str], elsewhere: str) -> str:
    """Return which letters are boxes, and where they can be read; "" where none are."""
    if not missing:
        return ""
    codes = [f"U+{ord(letter):04X}" for letter in sorted(missing)]
    more = f" and {len(codes) - _NAMED} more" if len(codes) > _NAMED else ""
    named = f"{', '.join(codes[:_NAMED])}{more}"
    return f"{BOX} stands for a character that the fonts of this PDF do not have: {named}. {elsewhere}"


def texts_of(document: Any) -> Iterable[str]:
    """Yield the texts of a document of mappings and lists, but for its drawings."""
    if isinstance(document, str):
        yield document
    elif isinstance(document, dict):
        for name, part in document.items():
            if name != "svg":
                yield from texts_of(part)
    elif isinstance(document, list | tuple):
        for part in document:
            yield from texts_of(part)
