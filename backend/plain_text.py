"""Which characters a text may have, wherever it comes from: a request, a file of a person's, an import, a command line.

Refused are control characters but tab and the ends of lines, which a terminal obeys and some databases do not store
(NUL), and lone surrogates, halves of a character that nothing can write down. Pure.
"""

import re
from typing import Any

_REFUSED = re.compile("[\0-\x08\x0b\x0c\x0e-\x1f\x7f-\x9f\ud800-\udfff]")


class PlainTextError(ValueError):
    """A text with a character that is not taken."""


def require_plain(text: str) -> None:
    """Raise PlainTextError for a text with a control character or half a character."""
    if (found := _REFUSED.search(text)) is None:
        return
    code = ord(found[0])
    kind = "half a character" if code >= 0xD800 else "a control character"
    around = text[max(0, found.start() - 20) : found.start() + 20]
    raise PlainTextError(
        f"a text has the character U+{code:04X}, {kind}, at place {found.start() + 1} (near {around!a}), "
        "which no text here may have: delete it"
    )


def require_plain_texts(document: Any) -> None:
    """Raise PlainTextError for a document of mappings and lists with such a text in it, also as a key."""
    parts = [document]
    while parts:
        part = parts.pop()
        if isinstance(part, str):
            require_plain(part)
        elif isinstance(part, dict):
            parts.extend(part)
            parts.extend(part.values())
        elif isinstance(part, list | tuple):
            parts.extend(part)
