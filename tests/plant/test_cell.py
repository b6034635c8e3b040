"""A cell holds a value as compiled functions see it and as the interpreter put it: the same, and in one place."""

import pickle
import struct
from typing import Any, NamedTuple

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from plant.compilation import StateBlock, compiled, store_compiled


class Inner(NamedTuple):
    a: float
    on: bool
    n: int


class Outer(NamedTuple):
    first: Inner
    table: NDArray[np.float64]
    pair: tuple[float, float]
    nothing: None
    flags: tuple[bool, bool]
    last: Inner


def outer(table: NDArray[np.float64]) -> Outer:
    return Outer(Inner(1.5, True, -7), table, (2.5, 3.5), None, (False, True), Inner(-0.5, False, 1 << 40))


@compiled
def shifted(cell: StateBlock[Outer], by: float) -> float:
    """Change of each kind something: by a field, by the whole, and in the array."""
    was = cell.value
    store_compiled(cell.last, Inner(was.last.a + by, not was.last.on, was.last.n + 1))
    store_compiled(cell.first.a, was.first.a - by)
    cell.table.value[1, 2] = by
    return float(cell.pair.value[1] + was.pair[0])


def test_what_is_put_is_what_is_got_and_fields_are_parts_of_it() -> None:
    value = outer(np.arange(6.0).reshape(2, 3))
    cell = StateBlock(value)
    assert cell.get() == value
    part = cell.field("last")
    part.set(Inner(9.0, True, 3))
    assert cell.get().last == Inner(9.0, True, 3)
    cell.set(value)
    assert part.get() == value.last


@given(by=st.floats(-1e6, 1e6), n=st.integers(-(2**60), 2**60), on=st.booleans())
def test_compiled_functions_read_and_write_the_same_numbers(by: float, n: int, on: bool) -> None:
    table = np.zeros((2, 3))
    cell = StateBlock(outer(table)._replace(last=Inner(0.25, on, n)))
    assert shifted(cell, by) == 6.0
    now = cell.get()
    assert now.last == Inner(0.25 + by, not on, n + 1)
    assert now.first == Inner(1.5 - by, True, -7)
    assert table[1, 2] == by
    assert now.table is table


def test_another_array_takes_the_place_of_the_one_before() -> None:
    cell = StateBlock(outer(np.zeros((2, 3))))
    larger = np.zeros((40, 3))
    cell.field("table").set(larger)
    shifted(cell, 4.0)
    assert larger[1, 2] == 4.0
    assert cell.get().table is larger


def test_a_copy_by_pickle_is_another_cell_and_its_fields_are_its_own() -> None:
    cell = StateBlock(outer(np.zeros((2, 3))))
    copy, part = pickle.loads(pickle.dumps((cell, cell.field("last"))))
    shifted(copy, 2.0)
    assert cell.get().last == outer(np.zeros((2, 3))).last
    assert part.get() == copy.get().last == Inner(1.5, True, (1 << 40) + 1)


@pytest.mark.parametrize(
    "wrong",
    [
        outer(np.zeros((2, 3)))[:5],
        outer(np.zeros(6)),
        outer(np.zeros((2, 3), np.int64)),
        outer(np.zeros((2, 3)))._replace(first=Inner("a", True, 1)),  # type: ignore[arg-type]  # that is the mistake
    ],
)
def test_what_is_not_like_the_first_is_refused_and_nothing_changes(wrong: Any) -> None:
    value = outer(np.zeros((2, 3)))
    cell = StateBlock(value)
    with pytest.raises(struct.error):
        cell.set(wrong)
    assert cell.get() == value


def test_what_has_no_place_is_refused() -> None:
    with pytest.raises(TypeError, match="no place"):
        StateBlock((1.0, "text"))
