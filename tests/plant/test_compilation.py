"""Machine code: specialised functions, state blocks, and the cache folder."""

import math
import os
import pickle
import random
import struct
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple, cast

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numba.core.errors import TypingError
from numpy.typing import NDArray

from backend.storage import events
from backend.storage.database import open_database
from plant.compilation import PrecompiledCall, StateBlock, compiled, store_compiled
from plant.dynamics import AT_REST, PlantState
from plant.interface import ZERO_VOLTS
from plant.parameters import load_parameters
from plant.simulator import SafetyBounds, Simulator, actuate_plant, is_limit_exceeded

# Machine code for one place in the tick: the same numbers, and never compiled again.

LAB = load_parameters("lab")
PLANT, BOUNDS = LAB.make_dynamics(), SafetyBounds(40.0, 1.5)
is_exceeded = PrecompiledCall(is_limit_exceeded, PLANT, BOUNDS, AT_REST)


def test_a_compiled_function_returns_the_same_values() -> None:
    numbers = random.Random(12)
    answers = []
    for _ in range(200):
        q, theta_A, theta_B = numbers.uniform(-1.8, 1.8), numbers.uniform(0.0, 6.0), numbers.uniform(0.0, 6.0)
        x = PlantState(q, 0.0, theta_A, 0.0, 0.0, theta_B, 0.0, 0.0)
        answers.append(is_exceeded(PLANT, BOUNDS, x))
        assert answers[-1] == is_limit_exceeded.py_func(PLANT, BOUNDS, x)  # type: ignore[attr-defined]  # of numba
    assert 20 < sum(answers) < 180  # both answers were to be had


def test_an_integer_argument_for_a_float_compiles_nothing() -> None:
    simulator, whole = Simulator(LAB), Simulator(LAB, x=PlantState(0, 0, 0, 0, 0, 0, 0, 0))
    known = len(actuate_plant.signatures)  # type: ignore[attr-defined]  # of numba
    simulator.write(ZERO_VOLTS._replace(u_A=2.0))
    whole.write(ZERO_VOLTS._replace(u_A=2))
    assert whole.x == simulator.x != AT_REST
    assert len(actuate_plant.signatures) == known  # type: ignore[attr-defined]  # of numba


class Weights(NamedTuple):
    """Of a sum; ``shift`` counts places."""

    a: float
    b: float
    shift: int


@compiled
def weighted(weights: Weights, pair: tuple[float, float], times: int, x: float) -> float:
    """Return a sum that depends on every number."""
    return times * (weights.a * x + weights.b * pair[0]) + pair[1] + weights.shift


WHOLE, BROKEN = (Weights(2, 3, 1), (4, 5), 2, 6), (Weights(2.5, 3.25, 1), (4.5, 5.75), 2, 6.125)


@pytest.mark.parametrize("like", [WHOLE, BROKEN], ids=["made of whole numbers", "made of floats"])
def test_parameters_declared_as_float_accept_integers_and_floats(like: tuple[Weights, Any, int, Any]) -> None:
    called = PrecompiledCall(weighted, *like)
    mixed = (Weights(2, 3.25, 1), (4.5, 5), 2, 6)
    for each_given in (WHOLE, BROKEN, mixed):
        assert called(*each_given) == weighted.py_func(*each_given)  # type: ignore[attr-defined]  # of numba


@compiled
def summed(parts: tuple[float, ...]) -> float:
    """Return the sum of as many floats as there are."""
    total = 0.0
    for part in parts:
        total += part
    return total


@compiled
def allocated(count: int) -> float:
    """Return the first of some zeros, from an array that needs numba's runtime."""
    return float(np.zeros(count)[0])


def test_functions_that_allocate_are_rejected() -> None:
    with pytest.raises(TypingError, match="zeros"):
        allocated(3)


@pytest.mark.parametrize("count", [2, 3, 5])
def test_every_item_of_a_variadic_tuple_is_a_float(count: int) -> None:
    whole: tuple[float, ...] = tuple(range(count))
    called = PrecompiledCall(summed, whole)
    assert called(tuple(part + 0.5 for part in whole)) == sum(range(count)) + 0.5 * count


@pytest.mark.parametrize(
    "given",
    [
        (Weights(2.0, 3.0, 1), (4.0, 5.0), 2.5, 6.0),
        (Weights(2.0, 3.0, 1), (4.0, 5.0), 2.0, 6.0),
        (Weights(2.0, 3.0, cast(int, 1.5)), (4.0, 5.0), 2, 6.0),
        (Weights(2.0, 3.0, 1), (4.0, 5.0), math.nan, 6.0),
    ],
    ids=["broken", "whole", "in a tuple", "nan"],
)
def test_a_float_for_an_integer_is_rejected_and_not_truncated(given: tuple[Any, Any, Any, Any]) -> None:
    called = PrecompiledCall(weighted, *BROKEN)
    with pytest.raises(TypeError, match="float"):
        called(*given)


@pytest.mark.parametrize(
    "x", [BOUNDS, AT_REST[:7], 0.0, AT_REST._replace(q=cast(float, "left"))], ids=["other", "short", "float", "text"]
)
def test_arguments_of_a_wrong_type_are_rejected(x: PlantState) -> None:
    with pytest.raises(TypeError):
        is_exceeded(PLANT, BOUNDS, x)


# A state block holds the same value for compiled functions and for the interpreter, in one place.


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
    """Change one value of each kind: by a field, by the whole tuple, and in the array."""
    was = cell.value
    store_compiled(cell.last, Inner(was.last.a + by, not was.last.on, was.last.n + 1))
    store_compiled(cell.first.a, was.first.a - by)
    cell.table.value[1, 2] = by
    return float(cell.pair.value[1] + was.pair[0])


def test_a_state_block_returns_its_value_and_its_fields() -> None:
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


def test_a_new_array_replaces_the_old_one() -> None:
    cell = StateBlock(outer(np.zeros((2, 3))))
    larger = np.zeros((40, 3))
    cell.field("table").set(larger)
    shifted(cell, 4.0)
    assert larger[1, 2] == 4.0
    assert cell.get().table is larger


def test_a_pickled_copy_is_an_independent_state_block() -> None:
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
def test_a_value_of_another_structure_is_rejected_and_changes_nothing(wrong: Any) -> None:
    value = outer(np.zeros((2, 3)))
    cell = StateBlock(value)
    with pytest.raises(struct.error):
        cell.set(wrong)
    assert cell.get() == value


def test_values_that_cannot_be_stored_are_rejected() -> None:
    with pytest.raises(TypeError, match="cannot store"):
        StateBlock((1.0, "text"))


# Where machine code is kept: for an account with a home, without one, and where nothing can be written.

STRANGER = 54_321
"""Number of an account that is in no password file."""
SHOWS = """
import subprocess, sys
from plant import compilation

@compilation.compiled
def more(x):
    return x + 1.0

assert more(1.0) == 2.0
print(compilation.CACHE, flush=True)
if sys.argv[1:]:
    subprocess.run([sys.executable, __file__], check=True)
"""


def as_stranger() -> Sequence[str]:
    """Return a command that runs a program as an account without name and home, which may read all and write nothing.

    Only root can change the account; otherwise the account of the tests is used.
    """
    if os.geteuid() != 0:
        return ()
    numbers = (f"--reuid={STRANGER}", f"--regid={STRANGER}", "--clear-groups")
    return ("setpriv", *numbers, "--inh-caps=+dac_read_search", "--ambient-caps=+dac_read_search")


@pytest.fixture
def open_folder(tmp_path: Path) -> Path:
    """A folder where every account may write."""
    folder = tmp_path / "open"
    folder.mkdir()
    folder.chmod(0o777)
    return folder


@pytest.fixture
def closed(tmp_path: Path) -> Path:
    """A path where not even root can make a folder."""
    file = tmp_path / "closed"
    file.write_text("")
    return file / "below"


@pytest.fixture
def program(tmp_path: Path) -> Path:
    """A file with a compiled function that prints where its code is cached."""
    file = tmp_path / "shows.py"
    file.write_text(SHOWS)
    return file


def find_cache(program: Path, *words: str, **environment: object) -> tuple[list[str], list[str]]:
    """Return the output lines of a process and, with ``words``, of one that it starts."""
    given = {"PATH": os.environ["PATH"], **{name: str(value) for name, value in environment.items()}}
    ended = subprocess.run(
        [*as_stranger(), sys.executable, str(program), *words], env=given, cwd="/", capture_output=True, text=True
    )
    assert ended.returncode == 0, ended.stderr
    return ended.stdout.splitlines(), ended.stderr.splitlines()


def test_the_cache_of_the_account_is_used_without_a_message(program: Path, open_folder: Path) -> None:
    (folder,), said = find_cache(program, HOME=open_folder)
    assert Path(folder).parent == open_folder / ".cache" / "sinew"
    assert said == []
    (folder,), said = find_cache(program, HOME=open_folder, XDG_CACHE_HOME=open_folder / "other")
    assert (Path(folder).parent, said) == (open_folder / "other" / "sinew", [])


def test_the_folder_configured_for_numba_takes_precedence(program: Path, open_folder: Path) -> None:
    (folder,), said = find_cache(program, HOME=open_folder, NUMBA_CACHE_DIR=open_folder / "named")
    assert (Path(folder).parent, said) == (open_folder / "named", [])


def test_the_data_folder_replaces_the_cache_with_one_message(program: Path, open_folder: Path, closed: Path) -> None:
    data = open_folder / "data"
    data.mkdir(mode=0o777)
    data.chmod(0o777)
    found, said = find_cache(program, "both", HOME=closed, SINEW_CACHE_FALLBACK=data)
    assert {Path(folder).parent for folder in found} == {data / "cache"}
    assert len(found) == 2
    assert len(said) == 1
    assert str(data / "cache") in said[0]


def test_a_temporary_folder_of_the_account_is_the_next_choice(program: Path, open_folder: Path, closed: Path) -> None:
    found, said = find_cache(
        program, "both", HOME=closed, TMPDIR=open_folder, SINEW_CACHE_FALLBACK=open_folder / "missing"
    )
    (place,) = {Path(folder).parent for folder in found}
    assert place.parent == open_folder
    assert place.stat().st_mode & 0o077 == 0
    assert len(said) == 1
    assert str(place) in said[0]
    assert not (open_folder / "missing").exists()


def test_code_that_another_account_may_have_written_is_not_run(program: Path, open_folder: Path, closed: Path) -> None:
    user = STRANGER if os.geteuid() == 0 else os.geteuid()
    place = open_folder / f"sinew-{user}"
    place.mkdir()
    place.chmod(0o777)
    (folder,), _ = find_cache(program, HOME=closed, TMPDIR=open_folder)
    assert folder == "None"


def test_without_a_folder_the_code_stays_in_memory_with_one_message(
    program: Path, closed: Path, open_folder: Path
) -> None:
    place = open_folder / f"sinew-{STRANGER if os.geteuid() == 0 else os.geteuid()}"
    place.write_text("a file where the folder would be")
    found, said = find_cache(program, "both", HOME=closed, TMPDIR=open_folder)
    assert found == ["None", "None"]
    assert len(said) == 1
    assert "NUMBA_CACHE_DIR" in said[0]


def by_stranger(folder: Path, *words: str) -> str:
    """Return the output of a command run by an account without name and home."""
    sinew = str(Path(sys.executable).with_name("sinew"))
    ended = subprocess.run(
        [*as_stranger(), sinew, *words, "--data", str(folder / "data")],
        env={"PATH": os.environ["PATH"], "TMPDIR": str(folder), "PYTHONIOENCODING": "utf-8"},
        cwd="/",
        capture_output=True,
        text=True,
    )
    assert ended.returncode == 0, ended.stderr
    return ended.stdout


def test_an_account_without_name_and_home_is_recorded_by_its_number(open_folder: Path) -> None:
    by_stranger(open_folder, "db", "backup")
    database = open_database(open_folder / "data")
    with database.reading() as session:
        (event,) = events.find(session)
    database.close()
    if os.geteuid() == 0:
        assert event.who == str(STRANGER)
    by_stranger(open_folder, "doctor")


def test_an_account_without_name_and_home_runs_an_experiment(open_folder: Path) -> None:
    words = ["experiment", "sequence", "--set", 'segments=[{"duration_s": 0.5, "q_ref": 0.0, "S_ref": 10}]']
    assert "completed" in by_stranger(open_folder, *words)


HITS = SHOWS + "\nprint(sum(more.stats.cache_hits.values()), sum(more.stats.cache_misses.values()))\n"


def test_code_compiled_in_an_image_is_copied_and_not_recompiled(program: Path, open_folder: Path) -> None:
    program.write_text(HITS)
    (folder, first), said = find_cache(program, XDG_CACHE_HOME=open_folder / "image")
    assert (first, said) == ("0 1", [])
    prepared = Path(folder).parent
    (prepared / "figures-1.json").write_text("{}")
    (copied, second), said = find_cache(program, XDG_CACHE_HOME=open_folder / "volume", SINEW_CACHE_PREPARED=prepared)
    assert (second, said) == ("1 0", [])
    assert Path(copied).parent == open_folder / "volume" / "sinew"
    assert (Path(copied).parent / "figures-1.json").read_text() == "{}"
    _, third = find_cache(program, XDG_CACHE_HOME=open_folder / "other", SINEW_CACHE_PREPARED=open_folder / "nowhere")[
        0
    ]
    assert third == "0 1"
