"""JSON of a file that may be anybody's: only what every database and every digest can hold."""

import json
import math
import re
from typing import Any, NoReturn

_MOST_DIGITS = 18
_UNSTORABLE = re.compile("[\0\ud800-\udfff]")


def read_strict(text: str | bytes) -> Any:
    """Return a document without nan, infinity, numbers out of all bounds and half characters. Raises ValueError."""
    try:
        document = json.loads(text, parse_constant=_refuse, parse_float=_finite, parse_int=_whole)
        _require_texts(document)
    except RecursionError:
        raise ValueError("it is nested too deeply") from None
    return document


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


def _require_texts(part: Any) -> None:
    if isinstance(part, str):
        if _UNSTORABLE.search(part):
            raise ValueError(f"the text {ascii(part)[:60]} has half a character or a zero, which nothing stores")
    elif isinstance(part, dict):
        for name, value in part.items():
            _require_texts(name)
            _require_texts(value)
    elif isinstance(part, list):
        for value in part:
            _require_texts(value)
