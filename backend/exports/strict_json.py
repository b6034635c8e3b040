"""JSON of a file that may be anybody's: only what every database and every digest can hold."""

import json
import math
from collections.abc import Iterator
from typing import Any, NoReturn

from backend.plain_text import require_plain_texts

_MOST_DIGITS = 18


def read_strict(text: str | bytes) -> Any:
    """Return a document without nan, infinity, numbers out of all bounds and texts that are not plain.

    Raises ValueError.
    """
    document = read_finite(text)
    require_texts(document)
    return document


def read_finite(text: str | bytes) -> Any:
    """Return a document without nan, infinity and numbers out of all bounds. Raises ValueError."""
    try:
        return json.loads(text, parse_constant=_refuse, parse_float=_finite, parse_int=_whole)
    except RecursionError:
        raise ValueError("it is nested too deeply") from None


def _refuse(word: str) -> NoReturn:
    raise ValueError(f"{word} is no number")


def _finite(word: str) -> float:
    number = float(word)
    if not math.isfinite(number):
        raise ValueError(f"the number {word[:40]} is beyond 1.8e308")
    return number


def _whole(word: str) -> int:
    if len(word.lstrip("-")) > _MOST_DIGITS:
        raise ValueError(f"the whole number {word[:20]}... has {len(word)} digits: {_MOST_DIGITS} at most are stored")
    return int(word)


def require_texts(document: Any) -> None:
    """Raise ValueError for texts that are not taken, also in JSON that stands in a text, as an experiment in a plan."""
    try:
        require_plain_texts(document)
        for inner in _inner_documents(document):
            require_texts(inner)
    except RecursionError:
        raise ValueError("it is nested too deeply") from None


def _inner_documents(document: Any) -> Iterator[Any]:
    parts = [document]
    while parts:
        part = parts.pop()
        if isinstance(part, dict):
            parts.extend(part.values())
        elif isinstance(part, list):
            parts.extend(part)
        elif isinstance(part, str) and part.startswith(("{", "[")) and "\\" in part:
            try:
                yield json.loads(part)
            except (ValueError, RecursionError):  # a text like any other
                continue
