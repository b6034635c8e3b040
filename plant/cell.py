"""Memory that compiled functions read and write in place: a nested named tuple that stays where it is.

A call hands over the address of a cell where it would hand over hundreds of numbers, one by one. Compiled functions say
``cell.value`` for all that a cell holds, ``cell.field`` for the cell of a field, and ``keep(cell, value)``; a function
may be compiled for cells before any is there. From the interpreter a cell is read by ``get`` and filled by ``put``.
"""

from __future__ import annotations

import struct
from collections.abc import Callable, Iterator
from typing import TYPE_CHECKING, Any, Generic, TypeVar, cast

import numpy as np
from numba import typeof, types
from numba.core import cgutils
from numba.core.imputils import lower_getattr_generic
from numba.core.registry import cpu_target
from numba.core.typing.templates import AttributeTemplate
from numba.extending import NativeValue, infer_getattr, intrinsic, models, register_model, typeof_impl, unbox
from numpy.typing import NDArray

from plant.compiled import kind_of

_T = TypeVar("_T")
_Arrays = dict[int, NDArray[Any]]


class CellType(types.Type):
    """numba's type of a cell that holds ``holds``."""

    def __init__(self, holds: Any) -> None:
        self.holds = holds
        super().__init__(name=f"Cell({holds})")


class Cell(Generic[_T]):
    """Memory for values like ``first``, a named tuple of numbers, of arrays and of such tuples; holds it at once.

    Arrays are not copied: the cell sees what they hold, and keeps them alive.
    """

    def __init__(self, first: _T) -> None:
        layout = _layout_for(first)
        self._memory = np.zeros(layout.size // 8 + 1)  # of doubles: numbers stand at multiples of their size
        self._arrays: _Arrays = {}
        self._whole: tuple[Cell[Any], str] | None = None
        self._lie(layout, self._memory.ctypes.data)
        self.put(first)

    def _lie(self, layout: _Layout, address: int) -> None:
        self.numba_type = layout.numba_type
        self.address = address
        self._offset = address - self._memory.ctypes.data
        self._bytes = self._memory.data.cast("B")
        self._layout = layout

    def field(self, name: str) -> Cell[Any]:
        """Return the cell of a field."""
        offset, layout = self._layout.field(name)
        part: Cell[Any] = object.__new__(Cell)
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

        def __getattr__(self, name: str) -> Cell[Any]: ...

    def __reduce__(self) -> tuple[Any, ...]:
        """Pickle what it holds, the cell of a field as that of the whole."""
        return (Cell, (self.get(),)) if self._whole is None else (Cell.field, self._whole)


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


@typeof_impl.register(Cell)
def _typeof(cell: Cell[Any], _context: Any) -> CellType:
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


keep: Callable[[Cell[_T], _T], None] = cast(Any, intrinsic)(_keep)
"""Let a cell hold a value of its type; for compiled functions."""
