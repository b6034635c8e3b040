"""Drawings that are remembered: a page, its PDF and what verifies both would draw the same figures of the same samples.

To draw them takes nearly all of the time that a report takes.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import fields, is_dataclass
from functools import wraps
from hashlib import sha256
from typing import Any, ParamSpec

import numpy as np

_Given = ParamSpec("_Given")
_MOST = 64
"""Drawings kept, each some hundred kilobytes: those of the last reports."""

_drawings: dict[bytes, str] = {}


def drawn_once(draw: Callable[_Given, str]) -> Callable[_Given, str]:
    """Return ``draw``, which makes a drawing of nothing but what it is given, so that it draws the same only once."""
    called = f"{draw.__module__}.{draw.__qualname__}"

    @wraps(draw)
    def drawn(*args: _Given.args, **named: _Given.kwargs) -> str:
        digest = sha256()
        for part in _parts((called, args, named)):
            digest.update(part)
        of = digest.digest()
        drawing = _drawings.pop(of, None)
        if drawing is None:
            drawing = draw(*args, **named)
            if len(_drawings) >= _MOST:
                del _drawings[next(iter(_drawings))]
        _drawings[of] = drawing  # the one used last stands at the end
        return drawing

    return drawn


def forget_drawings() -> None:
    """Draw everything anew."""
    _drawings.clear()


def _parts(value: Any) -> Iterator[bytes | memoryview]:
    """Give all that makes a value what it is, bit by bit."""
    if isinstance(value, np.ndarray):
        yield f"{value.dtype}{value.shape}".encode()
        yield np.ascontiguousarray(value).data.cast("B") if value.size else b""
    elif isinstance(value, str | int | float | complex | np.generic | slice | None):  # of which enumerations are some
        yield f"{type(value).__name__} {value!r}\0".encode()
    elif isinstance(value, Mapping):
        yield f"{len(value)} named\0".encode()
        for pair in value.items():
            yield from _parts(pair)
    elif isinstance(value, Sequence):
        yield f"{len(value)}\0".encode()
        for item in value:
            yield from _parts(item)
    elif is_dataclass(value):
        yield f"{type(value).__qualname__}\0".encode()
        for field in fields(value):
            yield from _parts(getattr(value, field.name))
    else:
        raise TypeError(f"a drawing is made of data: {type(value).__name__}")
