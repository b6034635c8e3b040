"""Checks the characters of texts, and escapes them for terminals and files.

Texts come from requests, files of a person, imports and command lines. Texts of several lines have no control
characters but tab and line ends: terminals obey them and some databases do not store NUL. Nor do they have lone
surrogates, which cannot be encoded. Texts of one line, such as names, titles, labels, symbols and units, have no
control characters at all, and no invisible characters or ones that change the direction of the text. Stored texts of
earlier versions are shown with such characters as escapes.
"""

import json
import re
import unicodedata
from typing import Any

from pydantic import AfterValidator, ValidationInfo

from backend import messages
from plant import ErrorCode, SinewError

_REFUSED_ANYWHERE = re.compile("[\0-\x08\x0b\x0c\x0e-\x1f\x7f-\x9f\ud800-\udfff]")
_DIRECTION = "\u061c\u200e\u200f\u202a-\u202e\u2066-\u2069"
_INVISIBLE = (
    "\xad\u034f\u115f\u1160\u17b4\u17b5\u180b-\u180f\u200b\u2028\u2029\u2060-\u2065\u206a-\u206f\u3164\ufeff\uffa0"
    "\ufff0-\ufffb\ufffe\uffff\U0001bca0-\U0001bca3\U0001d173-\U0001d17a\U000e0000-\U000e0fff"
)
_JOINERS = r"(?<![^\0-\x7f])[\u200c\u200d]|[\u200c\u200d](?![^\0-\x7f])"
"""Joiners that are not between letters of some scripts or parts of an emoji."""

_REFUSED_IN_LINE = re.compile(f"[\0-\x1f\x7f-\x9f\ud800-\udfff{_DIRECTION}{_INVISIBLE}]|{_JOINERS}")
_ESCAPED_IN_LINES = re.compile(f"[\0-\x08\x0b-\x1f\x7f-\x9f\ud800-\udfff{_DIRECTION}{_INVISIBLE}]|{_JOINERS}")
_FORMULA_PREFIXES = ("=", "+", "-", "@", "\uff1d", "\uff0b", "\uff0d", "\uff20")
"""First characters of a cell that a spreadsheet evaluates as a formula."""

_JSON_STRING = re.compile(r'"(?:[^"\\]|\\.)*"')
_FORMULA_IN_STRING = re.compile(r'([,;"]\s*)([=+@\uff1d\uff0b\uff0d\uff20]|-(?![0-9.]+[^0-9.a-zA-Z+*/|!(-]))')
_FORMULA_AFTER_SEPARATOR = re.compile(r"([,;]\s*)([=+@\uff1d\uff0b\uff0d\uff20-])")
_NOT_IN_FILE_NAME = re.compile(r"[^\w.+-]+")
STORED_CONTEXT = {"stored": True}
"""Validation context for stored documents: rejected characters become escapes."""


class PlainTextError(SinewError, ValueError):
    """A text with a rejected character, or without any visible one."""

    category = ErrorCode.BAD_VALUE


def check_plain_text(text: str) -> None:
    """Raise PlainTextError for a control character or a lone surrogate."""
    if (found := _REFUSED_ANYWHERE.search(text)) is not None:
        raise PlainTextError(
            messages.character_not_allowed(text=text, position=found.start(), description=_describe_character(found[0]))
        )


def check_single_line(text: str) -> str:
    """Return a text of one line, possibly empty, or raise PlainTextError."""
    if (found := _REFUSED_IN_LINE.search(text)) is not None:
        raise PlainTextError(
            messages.character_not_allowed_in_line(
                text=text, position=found.start(), description=_describe_character(found[0])
            )
        )
    if text and not text.strip():
        raise PlainTextError(messages.text_is_blank(text=text))
    return text


def _describe_character(character: str) -> str:
    if "\ud800" <= character <= "\udfff":
        return "an unpaired surrogate"
    if character in "\u2028\u2029":
        return "a line or paragraph separator"
    if character < "\xa0":
        return "a control character"
    return "which changes the direction of the text" if re.match(f"[{_DIRECTION}]", character) else "which is invisible"


def _validate_line(text: str, info: ValidationInfo) -> str:
    return escape_line(text) if info.context == STORED_CONTEXT else check_single_line(text)


ONE_LINE = AfterValidator(_validate_line)
"""Makes a field of a pydantic model a text of one line.

Stored documents are validated with ``STORED_CONTEXT``, which escapes instead of rejecting.
"""


def check_plain_texts(document: Any) -> None:
    """Raise PlainTextError for a rejected text in a document of mappings and lists.

    Keys are checked too.
    """
    parts = [document]
    while parts:
        part = parts.pop()
        if isinstance(part, str):
            check_plain_text(part)
        elif isinstance(part, dict):
            parts.extend(part)
            parts.extend(part.values())
        elif isinstance(part, list | tuple):
            parts.extend(part)


def escape_line(text: object) -> str:
    r"""Return a text as one line, with rejected characters as escapes such as \u202e."""
    return _REFUSED_IN_LINE.sub(_escape_match, str(text))


def escape_lines(text: object) -> str:
    r"""Return a text of several lines, with rejected characters except \n as escapes."""
    return _ESCAPED_IN_LINES.sub(_escape_match, str(text))


def fold_name(name: str) -> str:
    """Return the form in which names compare equal that people take for the same.

    Case, compatibility forms of Unicode and spaces do not count.
    """
    return " ".join(unicodedata.normalize("NFKC", unicodedata.normalize("NFKC", name).casefold()).split())


def escape_refused_characters(document: Any) -> Any:
    """Return a stored document with rejected characters as escapes."""
    if isinstance(document, str):
        return _REFUSED_ANYWHERE.sub(_escape_match, document)
    if isinstance(document, dict):
        return {escape_refused_characters(name): escape_refused_characters(part) for name, part in document.items()}
    return [escape_refused_characters(part) for part in document] if isinstance(document, list | tuple) else document


def format_json(document: Any, indent: int | None = None) -> str:
    """Return a document as JSON, with control characters as escapes for a terminal."""
    written = json.dumps(document, ensure_ascii=False, default=str, indent=indent)
    return _ESCAPED_IN_LINES.sub(lambda found: json.dumps(found[0])[1:-1], written)


def format_csv_cell(value: Any) -> Any:
    """Return a value as a cell of a CSV file that no spreadsheet evaluates.

    A text that looks like a formula gets an apostrophe in front, line ends and other control characters become
    escapes. Numbers, and texts that are numbers, stay unchanged. A float keeps all digits, None is empty.
    """
    if value is None:
        return ""
    if isinstance(value, float):
        return repr(value)
    if not isinstance(value, str):
        return value
    cell = _FORMULA_AFTER_SEPARATOR.sub(
        r"\1'\2", escape_line(value)
    )  # some spreadsheets split at the other separator too
    return f"'{cell}" if value.lstrip().startswith(_FORMULA_PREFIXES) and not _is_number(value) else cell


def format_csv_comment(text: str) -> str:
    """Return a text as a comment line of a CSV file, no cell of which is a formula."""
    return "# " + _FORMULA_AFTER_SEPARATOR.sub(r"\1'\2", escape_line(text))


def escape_json_for_csv(written: str) -> str:
    """Return JSON in a line of a CSV file, no cell of which is a formula.

    The first character of a text, and one after a separator, is written as an escape that JSON decodes to the same
    text.
    """

    def escape_formulas(text: re.Match[str]) -> str:
        return _FORMULA_IN_STRING.sub(lambda found: f"{found[1]}\\u{ord(found[2]):04x}", text[0])

    return _REFUSED_IN_LINE.sub(lambda found: json.dumps(found[0])[1:-1], _JSON_STRING.sub(escape_formulas, written))


def make_file_name(text: str, longest: int = 80) -> str:
    """Return a text as part of a file name: letters, digits and . + - _ only.

    The result has no path and no leading dot; an empty text gives "file".
    """
    return _NOT_IN_FILE_NAME.sub("-", escape_line(text)).strip(".-")[:longest].rstrip(".-") or "file"


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return text.isascii() and "_" not in text and text.split() == [text]


def _escape_match(found: re.Match[str]) -> str:
    code = ord(found[0])
    return f"\\x{code:02x}" if code < 0x100 else f"\\u{code:04x}" if code < 0x10000 else f"\\U{code:08x}"
