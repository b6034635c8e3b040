"""One decorator for everything that runs in the tick: compiled once, cached, the same live and offline.

numba looks at the modification time of the one file a function stands in, not at the functions it calls in other
files. The cache folder is therefore named after the content of all compiled sources: a change anywhere makes a new one.
"""

import fcntl
import hashlib
import logging
import os
import shutil
import stat
import tempfile
from collections.abc import Callable, Iterator
from contextlib import suppress
from functools import cached_property
from operator import index
from pathlib import Path
from typing import Any, Generic, TypeVar, TypeVarTuple, cast, get_args, get_type_hints

import numba
import numpy as np
from numba.core import types
from numba.core.caching import FunctionCache
from numba.core.registry import CPUDispatcher


class InterpretedError(RuntimeError):
    """numba is told to compile nothing; the message says what to do."""


_F = TypeVar("_F", bound=Callable[..., Any])
_R = TypeVar("_R")
_Arguments = TypeVarTuple("_Arguments")

_ROOT = Path(__file__).resolve().parents[1]
_COMPILED_SOURCES = (
    "plant/*.py",
    "backend/controllers/*.py",
    "backend/identification/friction.py",
    "backend/loop/heartbeat.py",
    "backend/tick/*.py",
    "backend/tuning/closed_loop.py",
)


FALLBACK = "SINEW_CACHE_FALLBACK"
"""Variable that names a folder for machine code where no usual one can be written; a command puts its data folder."""
PREPARED = "SINEW_CACHE_PREPARED"
"""Variable that names a folder with what was compiled when an image was built: copied where nothing is compiled yet."""
_IN_MEMORY = "SINEW_CACHE_IN_MEMORY"
"""Variable that tells further processes that no folder can be written: only the first says so."""

_log = logging.getLogger(__name__)


def _cache_folder() -> Path | None:
    """Return the folder that machine code is kept in, None where it has to stay in memory; say where it is unusual."""
    name = f"compiled-{_digest_of_sources()}"
    usual, further = list(_usual_places()), list(_further_places())
    named = ", ".join(map(str, usual)) or "a cache folder of an account without a home"
    for place in (*usual, *further):
        folder = place / name
        if _can_be_used(folder):
            _copy_what_is_prepared(folder)
            if place != next(iter(usual), None):
                os.environ["NUMBA_CACHE_DIR"] = str(place)  # further processes look there first, and say nothing
                _log.warning("%s cannot be used: compiled code is kept in %s", named, folder)
            return folder
    if _IN_MEMORY not in os.environ:
        os.environ[_IN_MEMORY] = "1"
        _log.warning("no folder for compiled code can be used: each start compiles anew; name one by NUMBA_CACHE_DIR")
    return None


def _copy_what_is_prepared(folder: Path) -> None:
    """Copy what an image has compiled into a folder without machine code, and the figures that go with it.

    What cannot be read is compiled anew, as is what was compiled for another processor.
    """
    prepared = os.environ.get(PREPARED)
    if not prepared or any(folder.iterdir()):
        return
    with suppress(OSError, shutil.Error):
        shutil.copytree(Path(prepared) / folder.name, folder, dirs_exist_ok=True)
        for copied in (folder, *(part for part in folder.rglob("*") if part.is_dir())):
            copied.chmod(0o700)  # those of an image may be read-only
        for figures in Path(prepared).glob("figures-*.json"):
            if not (folder.parent / figures.name).exists():
                shutil.copyfile(figures, folder.parent / figures.name)


def _usual_places() -> Iterator[Path]:
    """Yield where machine code is kept: where numba is told to, else in the cache folder of the account."""
    if named := os.environ.get("NUMBA_CACHE_DIR"):
        yield Path(named)
    with suppress(RuntimeError):  # an account without a home
        yield Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "sinew"


def _further_places() -> Iterator[Path]:
    """Yield where else machine code may lie: in the data folder, or in a folder of the account among temporary ones."""
    if (data := os.environ.get(FALLBACK)) and Path(data).is_dir():  # to make a data folder is not for us
        yield Path(data) / "cache"
    with suppress(OSError):
        yield Path(tempfile.gettempdir()) / f"sinew-{os.geteuid()}"


def _can_be_used(folder: Path) -> bool:
    """Make a folder; return whether files can be made in it, and by no other account: what it holds is executed."""
    place = folder.parent
    try:
        for made in (place, folder):
            made.mkdir(mode=0o700, parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):
            pass
        return _is_safe(place) and _is_safe(folder)
    except OSError:
        return False


def _is_safe(folder: Path) -> bool:
    """Return whether a folder is this account's own, where everybody could have made it."""
    if not folder.parent.stat().st_mode & stat.S_IWOTH:
        return True
    found = folder.stat()
    return found.st_uid == os.geteuid() and not found.st_mode & (stat.S_IWOTH | stat.S_IWGRP)


def _digest_of_sources() -> str:
    digest = hashlib.sha256()
    for pattern in _COMPILED_SOURCES:
        for source in sorted(_ROOT.glob(pattern)):
            digest.update(source.read_bytes())
    return digest.hexdigest()[:16]


CACHE = _cache_folder()
numba.config.CACHE_DIR = str(CACHE or "")  # type: ignore[attr-defined]  # numba fills this module at run time
if numba.config.DISABLE_JIT:  # type: ignore[attr-defined]  # as above
    raise InterpretedError("NUMBA_DISABLE_JIT is set, but the control laws run as machine code only: unset it")


# A dictionary, because numba's own types leave out "_nrt": its runtime that allocates arrays and counts references.
STRICT: dict[str, Any] = {"error_model": "numpy", "_nrt": False}


class _InTurns(FunctionCache):
    """Machine code on disk, written by one process at a time.

    Two that compile a function for different arguments at the same time would be given one and the same file by numba,
    and whoever starts next would run for its arguments what was compiled for others.
    """

    def save_overload(self, sig: object, data: object) -> None:
        """Keep machine code under its signature."""
        folder = Path(self.cache_path)
        folder.mkdir(parents=True, exist_ok=True)
        with (folder / "turn.lock").open("w") as lock:
            fcntl.flock(lock, fcntl.LOCK_EX)
            super().save_overload(sig, data)  # type: ignore[no-untyped-call]  # of numba


def kept(function: _F) -> _F:
    """Return what numba has decorated so that its machine code is kept on disk, by many processes at a time."""
    dispatcher: Any = function
    if CACHE is not None:
        dispatcher._cache = cast(Any, _InTurns)(dispatcher.py_func)
    return function


class _Compiled(cast(Any, CPUDispatcher)):  # type: ignore[misc]  # of numba
    """What the interpreter calls; compiled code that calls it has ``inner`` instead.

    The way in from the interpreter takes each number out of each tuple, one by one: compiling it for a function that
    only compiled code calls, and writing that function to disk on its own, cost more than a third of all compiling.
    """

    @cached_property
    def inner(self) -> Any:
        """The function without a way in from the interpreter; kept on disk as a part of those that call it."""
        return cast(Any, numba.njit)(no_cpython_wrapper=True, no_cfunc_wrapper=True, **STRICT)(self.py_func)

    @property
    def _numba_type_(self) -> Any:
        return types.Dispatcher(self.inner)


def compiled(function: _F) -> _F:
    """Compile with numba in strict IEEE arithmetic (division by zero gives inf, as in numpy), cached on disk.

    Without numba's reference counting: a function that allocates an array is refused when it is compiled, and passing
    a spring's table down to the innermost sum costs nothing (counting made the offline closed loop four times slower).
    """
    dispatcher = _Compiled(function, targetoptions={"nopython": True, "no_cfunc_wrapper": True, **STRICT})
    return kept(cast(_F, dispatcher))


class Specialised(Generic[_R, *_Arguments]):
    """The machine code of a compiled function for arguments like these, to be called in the tick.

    numba looks at the type of each argument of each call, tuple by tuple: for the constants of the plant that takes ten
    times as long as the physics. Here it is done once, and nothing is ever compiled in the tick. So ``like`` has to say
    what will come in every call: where it has None or an array, None or an array of the same sort of numbers. A float
    stands for whole numbers too, as does a whole number where the function says float; where it says int, a float is
    refused with TypeError. So is what has not as many numbers as ``like``; whether they are the right ones, mypy sees.
    """

    def __init__(self, function: Callable[[*_Arguments], _R], *like: *_Arguments) -> None:
        self._made_from = function, like
        like = cast(Any, _as_declared(like, tuple(get_type_hints(cast(Any, function).py_func).values())))
        self._whole = tuple(_whole_numbers(like))
        kind = function, kind_of(like)
        if kind not in _KNOWN:
            types = tuple(map(cast(Any, numba.typeof), like))
            dispatcher: Any = function
            dispatcher.compile(types)
            _KNOWN[kind] = dispatcher.get_overload(types)
        self._code: Callable[..., _R] = _KNOWN[kind]

    def __call__(self, *arguments: *_Arguments) -> _R:
        """Call it."""
        for path in self._whole:  # machine code would cut off the rest
            value: Any = arguments
            for at in path:
                value = value[at]
            index(value)
        return self._code(*arguments)

    def __reduce__(self) -> tuple[Any, ...]:
        """Pickle what it was made from: machine code stays in its process."""
        return Specialised, (self._made_from[0], *self._made_from[1])


_KNOWN: dict[object, Callable[..., Any]] = {}
"""Machine code by function and kind of arguments: asking numba for the types takes half a tick."""


def _as_declared(value: Any, hint: Any) -> Any:
    """Return a value of ``like`` with a float wherever one is declared, that being a tuple of hints or a type."""
    if type(value) is int and hint is float:
        return float(value)
    if not isinstance(value, tuple):
        return value
    if hasattr(value, "_fields"):
        named = get_type_hints(type(value))
        return type(value)(*(_as_declared(part, named[name]) for name, part in zip(value._fields, value, strict=True)))
    hints = hint if isinstance(hint, tuple) else get_args(hint)
    if hints[1:] == (...,):
        hints = hints[:1] * len(value)
    return tuple(map(_as_declared, value, hints)) if len(hints) >= len(value) else value


def _whole_numbers(value: object) -> Iterator[tuple[int, ...]]:
    """Yield the way to each whole number of nested tuples."""
    if isinstance(value, tuple):
        for at, part in enumerate(value):
            yield from ((at, *path) for path in _whole_numbers(part))
    elif type(value) is int:
        yield ()


def kind_of(value: object) -> object:
    """Return what is equal for values that are the same to the compiler: types, and of arrays how they lie."""
    if isinstance(value, tuple):
        return type(value), *map(kind_of, value)
    if isinstance(value, np.ndarray):
        return value.dtype, value.ndim, value.flags.c_contiguous, value.flags.writeable
    return getattr(value, "numba_type", type(value))  # cells are alike where what they hold is


def compiled_run(function: _F) -> _F:
    """Compile likewise a function that takes long, a whole offline run: other Python threads go on meanwhile.

    Not for what the tick calls: giving up and taking back Python's lock would let another thread delay the tick.
    """
    return kept(cast(_F, numba.njit(nogil=True, **STRICT)(function)))
