"""One decorator for everything that runs in the tick: compiled once, cached, the same live and offline.

numba looks at the modification time of the one file a function stands in, not at the functions it calls in other
files. The cache folder is therefore named after the content of all compiled sources: a change anywhere makes a new one.
"""

from __future__ import annotations

import fcntl
import hashlib
import logging
import os
import shutil
import stat
import struct
import tempfile
from collections.abc import Callable, Iterator
from contextlib import suppress
from functools import cached_property
from operator import index
from pathlib import Path
from typing import TYPE_CHECKING, Any, Generic, TypeVar, TypeVarTuple, cast, get_args, get_type_hints

import numba
import numpy as np
from numba import typeof, types
from numba.core import cgutils
from numba.core import types as core_types
from numba.core.caching import FunctionCache
from numba.core.imputils import lower_getattr_generic
from numba.core.registry import CPUDispatcher, cpu_target
from numba.core.typing.templates import AttributeTemplate
from numba.extending import NativeValue, infer_getattr, intrinsic, models, register_model, typeof_impl, unbox
from numpy.typing import NDArray

from plant.errors import ErrorCode, SinewError

# Compiled ------------------------------------------------------------------------------------------


class InterpretedError(SinewError, RuntimeError):
    """numba is told to compile nothing; the message says what to do."""

    category = ErrorCode.BAD_VALUE


_F = TypeVar("_F", bound=Callable[..., Any])
_R = TypeVar("_R")
_Arguments = TypeVarTuple("_Arguments")

_ROOT = Path(__file__).resolve().parents[1]
_COMPILED_SOURCES = (
    "plant/*.py",
    "backend/control/*.py",
    "backend/identification/friction.py",
    "backend/realtime/heartbeat.py",
    "backend/tuning/simulation.py",
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
                _log.warning("%s cannot be used. Compiled code goes to %s.", named, folder)
            return folder
    if _IN_MEMORY not in os.environ:
        os.environ[_IN_MEMORY] = "1"
        _log.warning(
            "No folder for compiled code can be used, so that each start compiles anew. Name one by NUMBA_CACHE_DIR."
        )
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
numba.config.CACHE_DIR = str(CACHE or "")
if numba.config.DISABLE_JIT:
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
            super().save_overload(sig, data)


def cache_compiled(function: _F) -> _F:
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
        return core_types.Dispatcher(self.inner)


def compiled(function: _F) -> _F:
    """Compile with numba in strict IEEE arithmetic (division by zero gives inf, as in numpy), cached on disk.

    Without numba's reference counting: a function that allocates an array is refused when it is compiled, and passing
    a spring's table down to the innermost sum costs nothing (counting made the offline closed loop four times slower).
    """
    dispatcher = _Compiled(function, targetoptions={"nopython": True, "no_cfunc_wrapper": True, **STRICT})
    return cache_compiled(cast(_F, dispatcher))


class PrecompiledCall(Generic[_R, *_Arguments]):
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
        return PrecompiledCall, (self._made_from[0], *self._made_from[1])


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
    return cache_compiled(cast(_F, numba.njit(nogil=True, **STRICT)(function)))


# Cell ----------------------------------------------------------------------------------------------
#
# Memory that compiled functions read and write in place: a nested named tuple that stays where it
# is.
#
# A call hands over the address of a cell where it would hand over hundreds of numbers, one by one.
# Compiled functions say ``cell.value`` for all that a cell holds, ``cell.field`` for the cell of a
# field, and ``keep(cell, value)``; a function may be compiled for cells before any is there. From
# the interpreter a cell is read by ``get`` and filled by ``put``.


_T = TypeVar("_T")
_Arrays = dict[int, NDArray[Any]]


class CellType(types.Type):
    """numba's type of a cell that holds ``holds``."""

    def __init__(self, holds: Any) -> None:
        self.holds = holds
        super().__init__(name=f"Cell({holds})")


class StateBlock(Generic[_T]):
    """Memory for values like ``first``, a named tuple of numbers, of arrays and of such tuples; holds it at once.

    Arrays are not copied: the cell sees what they hold, and keeps them alive.
    """

    def __init__(self, first: _T) -> None:
        layout = _layout_for(first)
        self._memory = np.zeros(layout.size // 8 + 1)  # of doubles: numbers stand at multiples of their size
        self._arrays: _Arrays = {}
        self._whole: tuple[StateBlock[Any], str] | None = None
        self._lie(layout, self._memory.ctypes.data)
        self.put(first)

    def _lie(self, layout: _Layout, address: int) -> None:
        self.numba_type = layout.numba_type
        self.address = address
        self._offset = address - self._memory.ctypes.data
        self._bytes = self._memory.data.cast("B")
        self._layout = layout

    def field(self, name: str) -> StateBlock[Any]:
        """Return the cell of a field."""
        offset, layout = self._layout.field(name)
        part: StateBlock[Any] = object.__new__(StateBlock)
        part._memory, part._arrays, part._whole = self._memory, self._arrays, (self, name)
        part._lie(layout, self.address + offset)
        return part

    def put(self, value: _T) -> None:
        """Fill it. Raises struct.error for what is not like the first."""
        arrays: _Arrays = {}
        packed = self._layout.packed.pack(*self._layout.taken_apart(value, arrays, self._offset))
        self._bytes[self._offset : self._offset + len(packed)] = packed  # whole or not at all
        self._arrays.update(arrays)

    def get(self) -> _T:
        """Return what it holds now; arrays are those that were put."""
        numbers = iter(self._layout.packed.unpack_from(self._bytes, self._offset))
        return cast(_T, self._layout.made(numbers, self._arrays, self._offset))

    if TYPE_CHECKING:  # what compiled functions say
        value: _T

        def __getattr__(self, name: str) -> StateBlock[Any]: ...

    def __reduce__(self) -> tuple[Any, ...]:
        """Pickle what it holds, the cell of a field as that of the whole."""
        return (StateBlock, (self.get(),)) if self._whole is None else (StateBlock.field, self._whole)


_Flat = Callable[[Any, list[object], _Arrays, int], None]
_Made = Callable[[Iterator[Any], _Arrays, int], Any]


class _Layout:
    """Where the numbers of a type stand in memory, and how they come from a value and become one."""

    def __init__(self, kind: Any) -> None:
        self.numba_type = CellType(kind)
        self.size = _size(kind)
        self._fields: dict[str, tuple[int, _Layout]] = {}
        leaves: list[tuple[int, str]] = []
        self._flat, self.made = _described(kind, 0, leaves)
        words, end = [], 0
        for at, letters in leaves:
            words.append(f"{at - end}x{letters}")
            end = at + struct.calcsize(f"={letters}")
        self.packed = struct.Struct("=" + "".join(words))

    def field(self, name: str) -> tuple[int, _Layout]:
        """Return where a field begins, and how it lies there."""
        if name not in self._fields:
            kind = self.numba_type.holds
            index = kind.fields.index(name)
            self._fields[name] = _offset(kind, index), _Layout(kind.types[index])
        return self._fields[name]

    def taken_apart(self, value: object, arrays: _Arrays, offset: int) -> list[object]:
        """Return the numbers of a value in the order in which they stand; its arrays go to ``arrays``."""
        found: list[object] = []
        self._flat(value, found, arrays, offset)
        return found


_SCALARS = {types.float64: "d", types.int64: "q", types.boolean: "?"}
_LAYOUTS: dict[object, _Layout] = {}
"""By kind of value: asking numba takes a millisecond, and a motion's cell is made between two ticks."""


def _layout_for(value: object) -> _Layout:
    kind = kind_of(value)
    if kind not in _LAYOUTS:
        _LAYOUTS[kind] = _Layout(typeof(value))
    return _LAYOUTS[kind]


def _described(kind: Any, at: int, leaves: list[tuple[int, str]]) -> tuple[_Flat, _Made]:
    """Add the leaves of a type that begins at ``at``; return how to take it apart and to put it together."""
    if kind in _SCALARS:
        leaves.append((at, _SCALARS[kind]))
        return lambda value, found, _arrays, _offset: found.append(value), lambda numbers, _arrays, _offset: next(
            numbers
        )
    if isinstance(kind, types.NoneType):
        return lambda _value, _found, _arrays, _offset: None, lambda _numbers, _arrays, _offset: None
    if isinstance(kind, types.Array):
        return _described_array(kind, at, leaves)
    if isinstance(kind, types.BaseTuple):
        return _described_tuple(kind, at, leaves)
    raise TypeError(f"a cell has no place for {kind}")


def _described_array(kind: Any, at: int, leaves: list[tuple[int, str]]) -> tuple[_Flat, _Made]:
    count = 5 + 2 * kind.ndim  # owner, parent, items, size of one, address, shape, strides
    leaves.append((at, f"{count}q"))

    def flat(value: Any, found: list[object], arrays: _Arrays, offset: int) -> None:
        if typeof(value) != kind:
            raise struct.error(f"an array of {typeof(value)} where {kind} has a place")
        arrays[offset + at] = value
        found += [0, 0, value.size, value.itemsize, value.ctypes.data, *value.shape, *value.strides]

    def made(numbers: Iterator[Any], arrays: _Arrays, offset: int) -> Any:
        for _ in range(count):
            next(numbers)
        return arrays[offset + at]

    return flat, made


def _described_tuple(kind: Any, at: int, leaves: list[tuple[int, str]]) -> tuple[_Flat, _Made]:
    parts = [_described(part, at + _offset(kind, index), leaves) for index, part in enumerate(kind.types)]
    build = kind.instance_class if isinstance(kind, types.BaseNamedTuple) else lambda *values: values

    def flat(value: Any, found: list[object], arrays: _Arrays, offset: int) -> None:
        if len(value) != len(parts):
            raise struct.error(f"{value} is not like what the cell was made for")
        for (part, _), inner in zip(parts, value, strict=True):
            part(inner, found, arrays, offset)

    def made(numbers: Iterator[Any], arrays: _Arrays, offset: int) -> Any:
        return build(*(part(numbers, arrays, offset) for _, part in parts))

    return flat, made


def _data_type(kind: Any) -> Any:
    return cpu_target.target_context.get_data_type(kind)


def _size(kind: Any) -> int:
    return int(_data_type(kind).get_abi_size(cpu_target.target_context.target_data))


def _offset(kind: Any, index: int) -> int:
    if isinstance(kind, types.UniTuple | types.NamedUniTuple):  # numba keeps what is all alike as an array
        return index * _size(kind.dtype)
    return int(_data_type(kind).get_element_offset(cpu_target.target_context.target_data, index))


@register_model(CellType)
class _CellModel(models.PrimitiveModel):
    """A cell is its address."""

    def __init__(self, manager: Any, kind: CellType) -> None:
        super().__init__(manager, kind, cgutils.intp_t)


@typeof_impl.register(StateBlock)
def _typeof(cell: StateBlock[Any], _context: Any) -> CellType:
    return cell.numba_type


@unbox(CellType)
def _unboxed(_kind: CellType, cell: Any, c: Any) -> Any:
    address = c.pyapi.object_getattr_string(cell, "address")
    value = c.pyapi.long_as_longlong(address)
    c.pyapi.decref(address)
    return NativeValue(value)


@infer_getattr
class _Attributes(AttributeTemplate):
    key = CellType

    def generic_resolve(self, cell: CellType, name: str) -> Any:
        """Return the type of what a cell holds, or of the cell of a field."""
        if name == "value":
            return cell.holds
        holds = cell.holds
        if isinstance(holds, types.BaseNamedTuple) and name in holds.fields:
            return CellType(holds.types[holds.fields.index(name)])
        return None


@lower_getattr_generic(CellType)
def _attribute(context: Any, builder: Any, cell: CellType, address: Any, name: str) -> Any:
    place = builder.inttoptr(address, context.get_data_type(cell.holds).as_pointer())
    if name == "value":
        return context.unpack_value(builder, cell.holds, place)
    part = cgutils.gep_inbounds(builder, place, 0, cell.holds.fields.index(name))
    return builder.ptrtoint(part, cgutils.intp_t)


def _keep(_context: Any, cell: Any, value: Any) -> Any:
    def generate(context: Any, builder: Any, _signature: Any, arguments: Any) -> Any:
        place = builder.inttoptr(arguments[0], context.get_data_type(cell.holds).as_pointer())
        context.pack_value(builder, cell.holds, arguments[1], place)
        return context.get_dummy_value()

    return types.void(cell, cell.holds), generate


keep_compiled: Callable[[StateBlock[_T], _T], None] = cast(Any, intrinsic)(_keep)
"""Let a cell hold a value of its type; for compiled functions."""
