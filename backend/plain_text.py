"""Which characters a text may have, wherever it comes from, and how one is written where they matter.

A text comes by a request, a file of a person's, an import or a command line. Texts of several lines have no control
characters but tab and the ends of lines: a terminal obeys them and some databases do not store NUL. Nor do they have
lone surrogates, halves of a character that nothing can write. Texts of one line, such as names, titles, labels, symbols
and units, have no control characters at all, and none that nobody sees or that change the direction of what is read.
What an earlier version stored is shown with such characters as escapes. Pure.
"""

import json
import re
import unicodedata
from typing import Any

from pydantic import AfterValidator, ValidationInfo

from plant import ErrorCode, SinewError

_REFUSED = re.compile("[\0-\x08\x0b\x0c\x0e-\x1f\x7f-\x9f\ud800-\udfff]")
_DIRECTION = "\u061c\u200e\u200f\u202a-\u202e\u2066-\u2069"
_UNSEEN = (
    "\xad\u034f\u115f\u1160\u17b4\u17b5\u180b-\u180f\u200b\u2028\u2029\u2060-\u2065\u206a-\u206f\u3164\ufeff\uffa0"
    "\ufff0-\ufffb\ufffe\uffff\U0001bca0-\U0001bca3\U0001d173-\U0001d17a\U000e0000-\U000e0fff"
)
_JOINERS = r"(?<![^\0-\x7f])[\u200c\u200d]|[\u200c\u200d](?![^\0-\x7f])"
"""Joiners belong between letters of some scripts, and between the parts of an emoji."""

_OF_A_LINE = re.compile(f"[\0-\x1f\x7f-\x9f\ud800-\udfff{_DIRECTION}{_UNSEEN}]|{_JOINERS}")
_OF_LINES = re.compile(f"[\0-\x08\x0b-\x1f\x7f-\x9f\ud800-\udfff{_DIRECTION}{_UNSEEN}]|{_JOINERS}")
_FORMULA = ("=", "+", "-", "@", "\uff1d", "\uff0b", "\uff0d", "\uff20")
"""How a cell begins that a spreadsheet computes."""

_STRING = re.compile(r'"(?:[^"\\]|\\.)*"')
_IN_A_STRING = re.compile(r'([,;"]\s*)([=+@\uff1d\uff0b\uff0d\uff20]|-(?![0-9.]+[^0-9.a-zA-Z+*/|!(-]))')
_CUT = re.compile(r"([,;]\s*)([=+@\uff1d\uff0b\uff0d\uff20-])")
_NO_FILE_NAME = re.compile(r"[^\w.+-]+")
STORED = {"stored": True}
"""Context of a validation that takes what an earlier version has stored, with escapes for what is refused now."""


class PlainTextError(SinewError, ValueError):
    """A text with a character that is not taken, or without any that is seen."""

    category = ErrorCode.BAD_VALUE


def require_plain(text: str) -> None:
    """Raise PlainTextError for a text with a control character or half a character."""
    if (found := _REFUSED.search(text)) is not None:
        raise _refusal(text, found, "no text here may have")


def require_line(text: str) -> str:
    """Return a text of one line; "" is one. Raises PlainTextError for what a name or title must not have."""
    if (found := _OF_A_LINE.search(text)) is not None:
        raise _refusal(text, found, "no name, title or other text of one line may have")
    if text and not text.strip():
        raise PlainTextError(f"the text {text!r} is blank: write something that can be seen")
    return text


def _refusal(text: str, found: re.Match[str], nobody: str) -> PlainTextError:
    code, place = ord(found[0]), found.start()
    around = ascii(text[max(0, place - 20) : place + 20])
    said = f"U+{code:04X}, {_kind(found[0])}, at place {place + 1} (near {around})"
    return PlainTextError(f"a text has the character {said}, which {nobody}: delete it")


def _kind(letter: str) -> str:
    if "\ud800" <= letter <= "\udfff":
        return "half a character"
    if letter in "\u2028\u2029":
        return "the end of a line"
    if letter < "\xa0":
        return "a control character"
    return "which changes the direction of the text" if re.match(f"[{_DIRECTION}]", letter) else "which nobody sees"


def _line(text: str, info: ValidationInfo) -> str:
    return as_line(text) if info.context == STORED else require_line(text)


ONE_LINE = AfterValidator(_line)
"""Makes a field of a document or a request a text of one line; what is stored is read with ``STORED`` as context."""


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


def as_line(text: object) -> str:
    r"""Return a text as one line of a terminal, a list or a heading: what is refused there as an escape, \u202e."""
    return _OF_A_LINE.sub(_escape, str(text))


def as_lines(text: object) -> str:
    r"""Return a text of several lines for a terminal: all but \n that is refused in a line as an escape, \x1b."""
    return _OF_LINES.sub(_escape, str(text))


def as_folded(name: str) -> str:
    """Return what two names have in common that people take for one: letters of either case, forms, spaces."""
    return " ".join(unicodedata.normalize("NFKC", unicodedata.normalize("NFKC", name).casefold()).split())


def as_stored(document: Any) -> Any:
    """Return a stored document with escapes for characters that no text may have any more."""
    if isinstance(document, str):
        return _REFUSED.sub(_escape, document)
    if isinstance(document, dict):
        return {as_stored(name): as_stored(part) for name, part in document.items()}
    return [as_stored(part) for part in document] if isinstance(document, list | tuple) else document


def as_json(document: Any, indent: int | None = None) -> str:
    """Return a document as JSON that a terminal shows as it is: what it would obey is written as an escape."""
    written = json.dumps(document, ensure_ascii=False, default=str, indent=indent)
    return _OF_LINES.sub(lambda found: json.dumps(found[0])[1:-1], written)


def as_cell(value: Any) -> Any:
    """Return a value as a cell of a CSV file: a text that a spreadsheet would compute begins with an apostrophe.

    Numbers stay, as do texts that are numbers; ends of lines and other control characters become escapes. A float has
    all its digits, None is empty.
    """
    if value is None:
        return ""
    if isinstance(value, float):
        return repr(value)
    if not isinstance(value, str):
        return value
    cell = _CUT.sub(r"\1'\2", as_line(value))  # some spreadsheets cut at the other separator too
    return f"'{cell}" if value.lstrip().startswith(_FORMULA) and not _is_number(value) else cell


def as_comment(text: str) -> str:
    """Return a text as a comment before the heading of a CSV file, no cell of which is a formula."""
    return "# " + _CUT.sub(r"\1'\2", as_line(text))


def as_json_cells(written: str) -> str:
    """Return JSON as it is written in a line of a CSV file: no cell of it, wherever it is cut, is a formula.

    What follows a separator or begins a text is written as an escape, which JSON reads back as it was.
    """

    def guarded(text: re.Match[str]) -> str:
        return _IN_A_STRING.sub(lambda found: f"{found[1]}\\u{ord(found[2]):04x}", text[0])

    return _OF_A_LINE.sub(lambda found: json.dumps(found[0])[1:-1], _STRING.sub(guarded, written))


def as_file_name(text: str, longest: int = 80) -> str:
    """Return a text as a part of a file's name: letters, digits and . + - _, no path, nothing hidden; "" as "file"."""
    return _NO_FILE_NAME.sub("-", as_line(text)).strip(".-")[:longest].rstrip(".-") or "file"


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return text.isascii() and "_" not in text and text.split() == [text]


def _escape(found: re.Match[str]) -> str:
    code = ord(found[0])
    return f"\\x{code:02x}" if code < 0x100 else f"\\u{code:04x}" if code < 0x10000 else f"\\U{code:08x}"
