"""Compilation of every function of the control step with numba, cached on disk.

numba checks only the modification time of the file that defines a function, not that of the functions it calls in other
files. The cache folder is therefore named after the content of all compiled sources: any change selects a new folder.
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

from plant import messages
from plant.errors import ErrorCode, SinewError

# Compiled functions --------------------------------------------------------------------------------


class InterpretedError(SinewError, RuntimeError):
    """Numba's compiler is disabled; the message contains the remedy."""

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
_NOT_COMPILED = ("message", "messages")
"""Modules without compiled functions: a changed text does not invalidate the compiled code."""


FALLBACK = "SINEW_CACHE_FALLBACK"
"""Variable that names a folder for compiled code if no usual one is writable; commands set it to the data folder."""
PREPARED = "SINEW_CACHE_PREPARED"
"""Variable that names a folder of code compiled with an image; it is copied into an empty cache folder."""
_IN_MEMORY = "SINEW_CACHE_IN_MEMORY"
"""Variable that is set once no folder is writable, so that only the first process logs it."""

_log = logging.getLogger(__name__)


def _cache_folder() -> Path | None:
    """Return the folder for compiled code, or None to compile in memory.

    Logs a warning if it is not the preferred folder.
    """
    name = f"compiled-{_digest_of_sources()}"
    preferred, fallback = list(_list_preferred_folders()), list(_list_fallback_folders())
    names = ", ".join(map(str, preferred)) or "The cache folder of an account without a home folder"
    for parent in (*preferred, *fallback):
        folder = parent / name
        if _prepare_folder(folder):
            _copy_prepared_cache(folder)
            if parent != next(iter(preferred), None):
                os.environ["NUMBA_CACHE_DIR"] = str(parent)  # further processes use it without a warning
                _log.warning("%s cannot be used. Compiled code goes to %s.", names, folder)
            return folder
    if _IN_MEMORY not in os.environ:
        os.environ[_IN_MEMORY] = "1"
        _log.warning(
            "No folder for compiled code is usable, so each start compiles the code. Set one with NUMBA_CACHE_DIR."
        )
    return None


def _copy_prepared_cache(folder: Path) -> None:
    """Copy an image's compiled code and timings into an empty cache folder.

    Files that cannot be read, and code for another processor, are compiled again.
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


def _list_preferred_folders() -> Iterator[Path]:
    """Yield the preferred cache folders: NUMBA_CACHE_DIR, then that of the account."""
    if named := os.environ.get("NUMBA_CACHE_DIR"):
        yield Path(named)
    with suppress(RuntimeError):  # an account without a home
        yield Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "sinew"


def _list_fallback_folders() -> Iterator[Path]:
    """Yield the fallback cache folders: in the data folder, then a temporary one."""
    if (data := os.environ.get(FALLBACK)) and Path(data).is_dir():  # the data folder is not created here
        yield Path(data) / "cache"
    with suppress(OSError):
        yield Path(tempfile.gettempdir()) / f"sinew-{os.geteuid()}"


def _prepare_folder(folder: Path) -> bool:
    """Create a folder; return whether it is writable, and by this account alone.

    Other accounts must not write to it because its files are executed.
    """
    parent = folder.parent
    try:
        for created in (parent, folder):
            created.mkdir(mode=0o700, parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):
            pass
        return _is_safe(parent) and _is_safe(folder)
    except OSError:
        return False


def _is_safe(folder: Path) -> bool:
    """Return whether no other account can have created or can write a folder."""
    if not folder.parent.stat().st_mode & stat.S_IWOTH:
        return True
    status = folder.stat()
    return status.st_uid == os.geteuid() and not status.st_mode & (stat.S_IWOTH | stat.S_IWGRP)


def _digest_of_sources() -> str:
    digest = hashlib.sha256()
    for pattern in _COMPILED_SOURCES:
        for source in sorted(_ROOT.glob(pattern)):
            if source.stem not in _NOT_COMPILED:
                digest.update(source.read_bytes())
    return digest.hexdigest()[:16]


CACHE = _cache_folder()
numba.config.CACHE_DIR = str(CACHE or "")
if numba.config.DISABLE_JIT:
    raise InterpretedError(messages.compiler_disabled())


# A dictionary, because numba's own types lack "_nrt": the runtime that allocates arrays and counts references.
STRICT: dict[str, Any] = {"error_model": "numpy", "_nrt": False}


class _LockedCache(FunctionCache):
    """Compiled code on disk, written by one process at a time.

    numba gives the same file name to two processes that compile a function for different arguments at the same time.
    The next process would then run code that was compiled for other argument types.
    """

    def save_overload(self, sig: object, data: object) -> None:
        """Store compiled code under its signature."""
        folder = Path(self.cache_path)
        folder.mkdir(parents=True, exist_ok=True)
        with (folder / "turn.lock").open("w") as lock:
            fcntl.flock(lock, fcntl.LOCK_EX)
            super().save_overload(sig, data)


def cache_compiled(function: _F) -> _F:
    """Let a numba dispatcher cache its code on disk, safely with many processes."""
    dispatcher: Any = function
    if CACHE is not None:
        dispatcher._cache = cast(Any, _LockedCache)(dispatcher.py_func)
    return function


class _Compiled(cast(Any, CPUDispatcher)):  # type: ignore[misc]  # of numba
    """Dispatcher for calls from Python; compiled callers use ``inner`` instead.

    The Python wrapper unpacks each number of each tuple. Compiling it for functions that only compiled code calls, and
    storing those functions on their own, took more than a third of the compile time.
    """

    @cached_property
    def inner(self) -> Any:
        """The function without Python wrapper; cached as a part of its callers."""
        return cast(Any, numba.njit)(no_cpython_wrapper=True, no_cfunc_wrapper=True, **STRICT)(self.py_func)

    @property
    def _numba_type_(self) -> Any:
        return core_types.Dispatcher(self.inner)


def compiled(function: _F) -> _F:
    """Compile with numba in strict IEEE arithmetic, cached on disk.

    Division by zero gives inf, as in numpy. Reference counting is off: a function that allocates an array fails to
    compile, and passing a spring's table to the innermost sum costs nothing (with counting the offline closed loop took
    four times as long).
    """
    dispatcher = _Compiled(function, targetoptions={"nopython": True, "no_cfunc_wrapper": True, **STRICT})
    return cache_compiled(cast(_F, dispatcher))


class PrecompiledCall(Generic[_R, *_Arguments]):
    """Compiled code for arguments of given types, called in the control step.

    numba examines the type of each argument at each call, tuple by tuple: for the constants of the plant this takes ten
    times as long as the physics. Here it is done once, so nothing is compiled during a control step. Each call must
    pass what ``like`` has: None or an array of the same dtype, dimensions and layout at the same place. An int is
    accepted for a float, in ``like`` too where the function declares float; a float for an int raises TypeError, as
    does a different count of numbers. mypy checks that they are the right numbers.
    """

    def __init__(self, function: Callable[[*_Arguments], _R], *like: *_Arguments) -> None:
        self._origin = function, like
        like = cast(Any, _as_declared(like, tuple(get_type_hints(cast(Any, function).py_func).values())))
        self._integer_paths = tuple(_find_integers(like))
        kind = function, get_compiled_kind(like)
        if kind not in _OVERLOADS:
            types = tuple(map(cast(Any, numba.typeof), like))
            dispatcher: Any = function
            dispatcher.compile(types)
            _OVERLOADS[kind] = dispatcher.get_overload(types)
        self._code: Callable[..., _R] = _OVERLOADS[kind]

    def __call__(self, *arguments: *_Arguments) -> _R:
        """Call the compiled code."""
        for path in self._integer_paths:  # machine code would truncate
            value: Any = arguments
            for at in path:
                value = value[at]
            index(value)
        return self._code(*arguments)

    def __reduce__(self) -> tuple[Any, ...]:
        """Pickle function and argument types; compiled code stays in its process."""
        return PrecompiledCall, (self._origin[0], *self._origin[1])


_OVERLOADS: dict[object, Callable[..., Any]] = {}
"""Compiled code by function and kind of arguments: numba takes half a period to determine the types."""


def _as_declared(value: Any, hint: Any) -> Any:
    """Return a value of ``like`` with floats where floats are declared.

    ``hint`` is a type or a tuple of types.
    """
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


def _find_integers(value: object) -> Iterator[tuple[int, ...]]:
    """Yield the index path of each integer in nested tuples."""
    if isinstance(value, tuple):
        for at, part in enumerate(value):
            yield from ((at, *path) for path in _find_integers(part))
    elif type(value) is int:
        yield ()


def get_compiled_kind(value: object) -> object:
    """Return a key that is equal for values of the same compiled type.

    It consists of the types and, for arrays, of dtype, dimensions and layout.
    """
    if isinstance(value, tuple):
        return type(value), *map(get_compiled_kind, value)
    if isinstance(value, np.ndarray):
        return value.dtype, value.ndim, value.flags.c_contiguous, value.flags.writeable
    return getattr(value, "numba_type", type(value))  # the kind of a state block is that of its content


def compiled_run(function: _F) -> _F:
    """Compile a long function, such as an offline run, so that it releases the GIL.

    Not for functions of the control step: releasing and reacquiring the GIL would let another thread delay it.
    """
    return cache_compiled(cast(_F, numba.njit(nogil=True, **STRICT)(function)))


# State blocks --------------------------------------------------------------------------------------
# Memory that compiled functions read and write in place: a nested named tuple at a fixed address.
#
# A call passes the address of a block instead of hundreds of numbers one by one. In compiled functions ``block.value``
# is the whole content, ``block.field`` the block of a field, and ``store_compiled(block, value)`` writes; a function
# can be compiled for blocks before one exists. Python code reads with ``get`` and writes with ``set``.


_T = TypeVar("_T")
_Arrays = dict[int, NDArray[Any]]


class CellType(types.Type):
    """Type of a block that holds ``content``, for numba."""

    def __init__(self, content: Any) -> None:
        self.content = content
        super().__init__(name=f"Cell({content})")


class StateBlock(Generic[_T]):
    """Memory for named tuples of numbers, arrays and such tuples, typed by ``first``.

    It holds ``first`` at once. Arrays are not copied: the block refers to them and keeps them alive.
    """

    def __init__(self, first: _T) -> None:
        layout = _layout_for(first)
        self._memory = np.zeros(layout.size // 8 + 1)  # float64, so that numbers are aligned
        self._arrays: _Arrays = {}
        self._parent: tuple[StateBlock[Any], str] | None = None
        self._bind(layout, self._memory.ctypes.data)
        self.set(first)

    def _bind(self, layout: _Layout, address: int) -> None:
        self.numba_type = layout.numba_type
        self.address = address
        self._offset = address - self._memory.ctypes.data
        self._bytes = self._memory.data.cast("B")
        self._layout = layout

    def field(self, name: str) -> StateBlock[Any]:
        """Return the block of a field."""
        offset, layout = self._layout.field(name)
        block: StateBlock[Any] = object.__new__(StateBlock)
        block._memory, block._arrays, block._parent = self._memory, self._arrays, (self, name)
        block._bind(layout, self.address + offset)
        return block

    def set(self, value: _T) -> None:
        """Store a value. Raises struct.error if its structure differs from the first."""
        arrays: _Arrays = {}
        packed = self._layout.packed.pack(*self._layout.flatten(value, arrays, self._offset))
        self._bytes[self._offset : self._offset + len(packed)] = packed  # all or nothing
        self._arrays.update(arrays)

    def get(self) -> _T:
        """Return the content; its arrays are the stored ones."""
        numbers = iter(self._layout.packed.unpack_from(self._bytes, self._offset))
        return cast(_T, self._layout.build(numbers, self._arrays, self._offset))

    if TYPE_CHECKING:  # attributes in compiled functions
        value: _T

        def __getattr__(self, name: str) -> StateBlock[Any]: ...

    def __reduce__(self) -> tuple[Any, ...]:
        """Pickle the content; the block of a field is pickled as part of the whole."""
        return (StateBlock, (self.get(),)) if self._parent is None else (StateBlock.field, self._parent)


_Flat = Callable[[Any, list[object], _Arrays, int], None]
_Build = Callable[[Iterator[Any], _Arrays, int], Any]


class _Layout:
    """Memory layout of a type, with conversion from values to numbers and back."""

    def __init__(self, kind: Any) -> None:
        self.numba_type = CellType(kind)
        self.size = _size(kind)
        self._fields: dict[str, tuple[int, _Layout]] = {}
        leaves: list[tuple[int, str]] = []
        self._flatten, self.build = _describe_type(kind, 0, leaves)
        formats, end = [], 0
        for at, letters in leaves:
            formats.append(f"{at - end}x{letters}")
            end = at + struct.calcsize(f"={letters}")
        self.packed = struct.Struct("=" + "".join(formats))

    def field(self, name: str) -> tuple[int, _Layout]:
        """Return offset and layout of a field."""
        if name not in self._fields:
            kind = self.numba_type.content
            index = kind.fields.index(name)
            self._fields[name] = _offset(kind, index), _Layout(kind.types[index])
        return self._fields[name]

    def flatten(self, value: object, arrays: _Arrays, offset: int) -> list[object]:
        """Return the numbers of a value in memory order; add its arrays to ``arrays``."""
        numbers: list[object] = []
        self._flatten(value, numbers, arrays, offset)
        return numbers


_SCALARS = {types.float64: "d", types.int64: "q", types.boolean: "?"}
_LAYOUTS: dict[object, _Layout] = {}
"""Layouts by kind of value: numba takes a millisecond, and blocks of motions are created between two ticks."""


def _layout_for(value: object) -> _Layout:
    kind = get_compiled_kind(value)
    if kind not in _LAYOUTS:
        _LAYOUTS[kind] = _Layout(typeof(value))
    return _LAYOUTS[kind]


def _describe_type(kind: Any, at: int, leaves: list[tuple[int, str]]) -> tuple[_Flat, _Build]:
    """Add the leaves of a type at offset ``at``; return flatten and build functions."""
    if kind in _SCALARS:
        leaves.append((at, _SCALARS[kind]))
        return lambda value, found, _arrays, _offset: found.append(value), lambda numbers, _arrays, _offset: next(
            numbers
        )
    if isinstance(kind, types.NoneType):
        return lambda _value, _found, _arrays, _offset: None, lambda _numbers, _arrays, _offset: None
    if isinstance(kind, types.Array):
        return _describe_array(kind, at, leaves)
    if isinstance(kind, types.BaseTuple):
        return _describe_tuple(kind, at, leaves)
    raise TypeError(f"a cell cannot store a value of type {kind}")


def _describe_array(kind: Any, at: int, leaves: list[tuple[int, str]]) -> tuple[_Flat, _Build]:
    count = 5 + 2 * kind.ndim  # parent, owner, items, item size, address, shape, strides
    leaves.append((at, f"{count}q"))

    def flatten(value: Any, found: list[object], arrays: _Arrays, offset: int) -> None:
        if typeof(value) != kind:
            raise struct.error(f"an array of {typeof(value)} where {kind} is expected")
        arrays[offset + at] = value
        found += [0, 0, value.size, value.itemsize, value.ctypes.data, *value.shape, *value.strides]

    def make(numbers: Iterator[Any], arrays: _Arrays, offset: int) -> Any:
        for _ in range(count):
            next(numbers)
        return arrays[offset + at]

    return flatten, make


def _describe_tuple(kind: Any, at: int, leaves: list[tuple[int, str]]) -> tuple[_Flat, _Build]:
    parts = [_describe_type(part, at + _offset(kind, index), leaves) for index, part in enumerate(kind.types)]
    build = kind.instance_class if isinstance(kind, types.BaseNamedTuple) else lambda *values: values

    def flatten(value: Any, found: list[object], arrays: _Arrays, offset: int) -> None:
        if len(value) != len(parts):
            raise struct.error(f"{value} does not have the structure that the cell was created for")
        for (part, _), inner in zip(parts, value, strict=True):
            part(inner, found, arrays, offset)

    def make(numbers: Iterator[Any], arrays: _Arrays, offset: int) -> Any:
        return build(*(part(numbers, arrays, offset) for _, part in parts))

    return flatten, make


def _data_type(kind: Any) -> Any:
    return cpu_target.target_context.get_data_type(kind)


def _size(kind: Any) -> int:
    return int(_data_type(kind).get_abi_size(cpu_target.target_context.target_data))


def _offset(kind: Any, index: int) -> int:
    if isinstance(kind, types.UniTuple | types.NamedUniTuple):  # numba stores equal types as an array
        return index * _size(kind.dtype)
    return int(_data_type(kind).get_element_offset(cpu_target.target_context.target_data, index))


@register_model(CellType)
class _CellModel(models.PrimitiveModel):
    """Representation of a block in compiled code: its address."""

    def __init__(self, manager: Any, kind: CellType) -> None:
        super().__init__(manager, kind, cgutils.intp_t)


@typeof_impl.register(StateBlock)
def _typeof(cell: StateBlock[Any], _context: Any) -> CellType:
    return cell.numba_type


@unbox(CellType)
def _unbox(_kind: CellType, cell: Any, c: Any) -> Any:
    address = c.pyapi.object_getattr_string(cell, "address")
    value = c.pyapi.long_as_longlong(address)
    c.pyapi.decref(address)
    return NativeValue(value)


@infer_getattr
class _Attributes(AttributeTemplate):
    key = CellType

    def generic_resolve(self, cell: CellType, name: str) -> Any:
        """Return the type of a block's content or of the block of a field."""
        if name == "value":
            return cell.content
        content = cell.content
        if isinstance(content, types.BaseNamedTuple) and name in content.fields:
            return CellType(content.types[content.fields.index(name)])
        return None


@lower_getattr_generic(CellType)
def _attribute(context: Any, builder: Any, cell: CellType, address: Any, name: str) -> Any:
    pointer = builder.inttoptr(address, context.get_data_type(cell.content).as_pointer())
    if name == "value":
        return context.unpack_value(builder, cell.content, pointer)
    part = cgutils.gep_inbounds(builder, pointer, 0, cell.content.fields.index(name))
    return builder.ptrtoint(part, cgutils.intp_t)


def _store_value(_context: Any, cell: Any, value: Any) -> Any:
    def generate(context: Any, builder: Any, _signature: Any, arguments: Any) -> Any:
        pointer = builder.inttoptr(arguments[0], context.get_data_type(cell.content).as_pointer())
        context.pack_value(builder, cell.content, arguments[1], pointer)
        return context.get_dummy_value()

    return types.void(cell, cell.content), generate


store_compiled: Callable[[StateBlock[_T], _T], None] = cast(Any, intrinsic)(_store_value)
"""Store a value in a block of its type; for compiled functions."""
