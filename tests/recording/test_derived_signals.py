"""Derived signals: formulas and envelopes, also of long recordings."""

import asyncio
import json
import math
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from backend.experiments.parser import (
    SIGNAL_NAMES,
    ExpressionError,
    evaluate_condition,
    evaluate_number,
    parse_derived_signal,
)
from backend.realtime.ring_buffer import Ring
from backend.recording.codec import pack_table, summarize_buckets
from backend.recording.reader import AT_HAND_SAMPLES, UnknownSignalError, read_envelope, read_samples
from backend.recording.recorder import CHUNK_TICKS
from backend.sample import COMBINED_SIGNAL_BY_NAME, COMBINED_SIGNALS, INDEX, STORED_NAMES
from backend.services.runs import SampleSlice, StoredRuns
from backend.storage import recordings, runs
from backend.storage.database import Database, open_database
from backend.storage.recordings import Chunk
from backend.storage.runs import NewRun, RunKind
from backend.workers import WorkerProcess
from plant.interface import T_s
from tests.reasons import Reason
from tests.recording.stand_in import Rows, Writer, recorder_of
from tests.refusals import refused

# Signals that are not stored: their envelopes are those of the sums themselves, and nan where there is none.

TICKS = 9_000
R_M, R_J = 0.0075, 0.075
NAMES = [one.name for one in COMBINED_SIGNALS if "S_true" not in one.name]


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> tuple[Database, int, Rows]:
    database = open_database(Path(tmp_path_factory.mktemp("combined")))
    geometry = {"r_m": {"value": R_M}, "r_j": {"value": R_J}}
    with database.session() as session:
        plant = {"plant": "simulator", "parameters_name": "ideal", "parameters": {"geometry": geometry}}
        run = runs.create(session, NewRun(kind=RunKind.SESSION, who="Ana", software="0.1.0", **plant))  # type: ignore[arg-type]  # a dict of these keys
    writer = Writer(Ring.create(TICKS + 100))
    recorder = recorder_of(writer, database)
    writer.write(50)
    head = writer.write(4000, run.id)
    recorder.drain()
    recorder._position += 1000
    writer.write(1000, run.id)
    tail = writer.write(TICKS - 5000, run.id)
    writer.write(1)
    recorder.close()
    writer.ring.close()
    return database, run.id, np.concatenate((head, tail))


def plainly(rows: Rows, name: str) -> Rows:
    """The sum, written out by hand."""
    column = {one: rows[:, at].astype(np.float32).astype(np.float64) for one, at in INDEX.items()}
    if name == "x_A":
        return R_M * column["theta_A"] - R_J * column["q"]
    if name == "x_B":
        return R_M * column["theta_B"] + R_J * column["q"]
    of, _, taken = name.partition(" - ")
    return column[of] - column[taken]


@pytest.mark.parametrize("points", [20_000, 3000, 100, 17])
@pytest.mark.parametrize(("from_s", "to_s"), [(0.0, np.inf), (1.2345, 6.789), (3.9, 5.1)])
def test_an_envelope_has_the_extremes_of_the_sums(
    recorded: tuple[Database, int, Rows], points: int, from_s: float, to_s: float
) -> None:
    database, run, rows = recorded
    with database.reading() as session:
        found = read_envelope(session, run, points, ["q", *NAMES, "F_A"], from_s, to_s)
    t = (rows[:, INDEX["tick"]] - 50) * 1e-3
    inside = (t >= from_s - 5e-4) & (t < to_s - 5e-4)
    assert list(found.minimum) == ["q", *NAMES, "F_A"]
    for name in NAMES:
        values = plainly(rows, name)
        assert len(found.minimum[name]) == len(found.t)
        for bucket, begin in enumerate(found.t):
            here = values[inside & (t >= begin - 5e-4) & (t < begin + found.width_s - 5e-4)]
            low, high = (here.min(), here.max()) if here.size else (np.nan, np.nan)
            assert found.minimum[name][bucket] == pytest.approx(low, rel=1e-6, abs=1e-7, nan_ok=True)
            assert found.maximum[name][bucket] == pytest.approx(high, rel=1e-6, abs=1e-7, nan_ok=True)


def test_a_derived_signal_adds_no_other_column(recorded: tuple[Database, int, Rows]) -> None:
    database, run, _ = recorded
    with database.reading() as session:
        assert list(read_envelope(session, run, 100, ["q - q_ref"]).minimum) == ["q - q_ref"]


def test_unavailable_derived_signals_are_nan(recorded: tuple[Database, int, Rows]) -> None:
    database, run, _ = recorded
    with database.reading() as session:
        assert np.isnan(read_envelope(session, run, 100, ["S - S_true"]).minimum["S - S_true"]).all()  # as on a rig


def test_exports_contain_recorded_columns_only(recorded: tuple[Database, int, Rows]) -> None:
    database, run, _ = recorded
    with database.reading() as session, refused(UnknownSignalError, "signals_not_recorded", signals=["q - q_ref"]):
        read_samples(session, run, ["q - q_ref"])


def test_each_derived_signal_has_the_unit_of_its_terms() -> None:
    metres = {"x_A", "x_B"}
    assert {one.name for one in COMBINED_SIGNALS if one.unit == "m"} == metres
    assert len(COMBINED_SIGNAL_BY_NAME) == len(COMBINED_SIGNALS)
    assert not set(COMBINED_SIGNAL_BY_NAME) & set(INDEX)


# Formulas over many samples at once, against values worked out by hand and against the language of experiments.

CASES = json.loads((Path(__file__).parent / "formula_cases.json").read_text())
"""The page's test evaluates the same (frontend/src/samples/formula.test.ts)."""

LENGTHS = {"r_m": 0.0075, "r_j": 0.075}


def numbers(values: list[float | None]) -> np.ndarray[Any, np.dtype[np.float64]]:
    return np.array([math.nan if value is None else value for value in values])


@pytest.mark.parametrize("case", CASES, ids=lambda case: case["expression"])
def test_values(case: dict[str, Any]) -> None:
    derived = parse_derived_signal("made", "1", case["expression"])
    columns = {name: numbers(values) for name, values in case["columns"].items()}
    wanted = numbers(case["values"])
    np.testing.assert_allclose(derived.values(columns, LENGTHS, len(wanted)), wanted, rtol=1e-12, atol=1e-15)


def test_the_steps_in_the_page_s_fixture_are_those_of_the_expressions() -> None:
    fixture = Path(__file__).parents[2] / "frontend/src/samples/formulaCases.fixture.json"
    made = [
        case | {"steps": [vars(step) for step in parse_derived_signal("made", "1", case["expression"]).steps]}
        for case in CASES
    ]
    assert json.loads(fixture.read_text()) == made


@pytest.mark.parametrize("name", SIGNAL_NAMES)
def test_every_signal_may_be_named(name: str) -> None:
    derived = parse_derived_signal("made", "1", f"2 * {name}")
    columns = {one: np.full(2, 3.0) for one in STORED_NAMES}
    combined = {one.name: one for one in COMBINED_SIGNALS}
    one = 3.0
    if name in combined:
        one = sum(term.sign * (LENGTHS[term.length] if term.length else 1.0) * 3.0 for term in combined[name].terms)
    np.testing.assert_allclose(derived.values(columns, LENGTHS, 2), [2 * one, 2 * one], rtol=1e-12)


def test_a_missing_column_or_length_gives_a_gap() -> None:
    derived = parse_derived_signal("made", "1", "q + F_wall")
    assert np.isnan(derived.values({"q": np.ones(3)}, {}, 3)).all()
    assert np.isnan(
        parse_derived_signal("made", "m", "x_A").values({"q": np.ones(1), "theta_A": np.ones(1)}, {}, 1)
    ).all()


@given(
    q=st.floats(-100, 100),
    S=st.floats(-100, 100),
    expression=st.sampled_from(
        ["q + S", "q / S", "q % S", "q ** 2", "abs(q) ** 0.3", "min(q, S)", "round(q, 1)", "q if q > S else S",
         "sqrt(q)", "q * S - S / q", "max(q, -S, 1)", "(q > 0) + (S > 0)", "not q", "q < S < 50"]
    ),
)  # fmt: skip
def test_formulas_agree_with_the_language_of_experiments(q: float, S: float, expression: str) -> None:
    """Where that language rejects a value, for example a division by zero, the signal has a gap."""
    derived = parse_derived_signal("made", "1", expression)
    (value,) = derived.values({"q": np.array([q]), "S": np.array([S])}, {}, 1)
    names = {"q": q, "S": S}
    try:
        wanted = evaluate_number(expression, names)
    except ExpressionError as error:
        if error.message == Reason("not_a_finite_number") and isinstance(error.message.values["value"], bool):
            wanted = float(evaluate_condition(expression, names))
        else:
            assert math.isnan(value)
            return
    assert value == pytest.approx(wanted, rel=1e-9, abs=1e-9)


@pytest.mark.parametrize(
    ("expression", "reason"),
    [
        ("F_C + 1", Reason("unknown_signal", name="F_C", nearest="F_B")),
        ("theta_a", Reason("unknown_signal", name="theta_a", nearest="theta_A")),
        ("t * 2", Reason("unknown_signal", name="t")),
        ("1 + 2", Reason("formula_without_signal", expression="1 + 2")),
        ("q +", Reason("not_an_expression", expression="q +")),
        ("q.real", Reason("unsupported_in_formula", operation="q.real")),
        ("__import__('os')", Reason("unsupported_in_formula", operation="__import__('os')")),
        ("'text' if q else 1", Reason("unsupported_in_formula", operation="'text'")),
        ("sqrt(q, 2)", Reason("wrong_number_of_arguments", function="sqrt", minimum=1, maximum=1, count=2)),
        ("min(q)", Reason("wrong_number_of_arguments", function="min", minimum=2, maximum=50, count=1)),
        ("abs()", Reason("wrong_number_of_arguments", function="abs", minimum=1, maximum=1, count=0)),
        ("round(q, ndigits=1)", Reason("unsupported_in_formula", operation="round(q, ndigits=1)")),
        ("[q for q in q]", Reason("unsupported_in_formula", operation="[q for q in q]")),
        ("q" + " + q" * 200, Reason("expression_too_long", maximum=500)),
        ("-" * 40 + "q", Reason("expression_nested_too_deep", maximum=30)),
    ],
)
def test_invalid_formulas_are_rejected(expression: str, reason: Reason) -> None:
    with pytest.raises(ExpressionError) as refused:
        parse_derived_signal("made", "1", expression)
    assert refused.value.message == reason


@pytest.mark.parametrize("name", ["q", "x_A", "min", "pi", "and", "t", "1a", "a b", "", "a" * 21, "_a"])
def test_duplicate_or_invalid_names_are_rejected(name: str) -> None:
    with pytest.raises(ExpressionError):
        parse_derived_signal(name, "1", "q")


# Signals that follow from others, of recordings longer than an hour: over all of them, and beside the service.

SECONDS = 3 * 3600 + 7
"""No whole number of hours, and not as many seconds as are unpacked at once."""
R_M_LONG, R_J_LONG = 0.0075, 0.075
SPIKES = {5: 0.25, 4000: -0.5, SECONDS - 1: 0.125}
"""Seconds of which one sample has another error q - q_ref [rad] than 0."""
AT = 321


@pytest.fixture(scope="module")
def long_run(tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[Database, int]]:
    """A stored recording: seconds at rest, and some seconds with a spike of one millisecond."""
    database = open_database(tmp_path_factory.mktemp("long"))
    geometry = {"r_m": {"value": R_M_LONG}, "r_j": {"value": R_J_LONG}}
    with database.session() as session:
        new = NewRun(RunKind.SESSION, "simulator", "ideal", {"geometry": geometry}, "Ana", "0.1.0")
        run = runs.create(session, new).id
        recordings.begin(session, run, list(STORED_NAMES), T_s)
    packed = {error: packed_second(error) for error in (0.0, *SPIKES.values())}
    with database.session() as session:
        chunks = [
            Chunk(second * CHUNK_TICKS, CHUNK_TICKS, *packed[SPIKES.get(second, 0.0)]) for second in range(SECONDS)
        ]
        recordings.add_chunks(session, run, chunks)
    yield database, run
    database.close()


def packed_second(error: float) -> tuple[bytes, bytes]:
    table: NDArray[np.float32] = np.zeros((CHUNK_TICKS, len(STORED_NAMES)), np.float32)
    q, q_ref, theta_A = (STORED_NAMES.index(name) for name in ("q", "q_ref", "theta_A"))
    # both move by more than the error: the extremes of a difference are not differences of extremes
    table[:, q] = table[:, q_ref] = np.sin(np.arange(CHUNK_TICKS))
    table[:, theta_A] = 2.0
    table[AT, q] += np.float32(error)
    return pack_table(summarize_buckets(table)), pack_table(table)


def test_the_envelope_of_a_long_recording_has_the_extremes_of_all_samples(long_run: tuple[Database, int]) -> None:
    database, run = long_run
    with database.reading() as session:
        found = read_envelope(session, run, 2000, ["q - q_ref", "x_A"])
    low, high = found.minimum["q - q_ref"], found.maximum["q - q_ref"]
    assert found.t[-1] + found.width_s >= SECONDS
    expected = np.zeros((2, len(found.t)))
    for second, error in SPIKES.items():
        expected[int(error > 0), int((second + AT * T_s) // found.width_s)] = error
    np.testing.assert_allclose(low, expected[0], atol=1e-6)
    np.testing.assert_allclose(high, expected[1], atol=1e-6)
    q = np.sin(np.arange(CHUNK_TICKS))
    assert np.median(found.minimum["x_A"]) == pytest.approx(R_M_LONG * 2.0 - R_J_LONG * q.max(), rel=1e-5)


def test_queries_of_many_samples_run_in_the_worker_process(
    long_run: tuple[Database, int],
) -> None:
    database, run = long_run
    deaths: list[str] = []
    lengths_s = {"at hand": AT_HAND_SAMPLES * T_s, "too long": AT_HAND_SAMPLES * T_s + 1.0}

    async def asked() -> dict[str, tuple[bytes, bool]]:
        worker = WorkerProcess(deaths.append)
        stored = StoredRuns(database, lambda: None, lambda _run: False, worker)
        try:
            found = {}
            for name, to_s in lengths_s.items():
                curves = await stored.pack_samples(SampleSlice(run, 0.0, to_s, 500, ["q", "q - q_ref"]))
                found[name] = (curves, worker._pool is not None)
            return found
        finally:
            worker.close()

    async def directly(to_s: float) -> bytes:
        stored = StoredRuns(database, lambda: None, lambda _run: False)
        return await stored.pack_samples(SampleSlice(run, 0.0, to_s, 500, ["q", "q - q_ref"]))

    found = asyncio.run(asked())
    assert {name: elsewhere for name, (_, elsewhere) in found.items()} == {"at hand": False, "too long": True}
    for name, (curves, _) in found.items():
        assert curves == asyncio.run(directly(lengths_s[name]))
    assert not deaths
