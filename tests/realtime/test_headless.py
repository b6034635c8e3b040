"""Headless stepping, and the content of each column of a sample."""

import asyncio
from collections.abc import Callable
from functools import partial

import numpy as np
import pytest

from backend.faults import FAULT_CODE, Fault, Limit
from backend.realtime.commands import (
    Accepted,
    ModeChanged,
    PretensionReached,
    Refused,
    Reset,
    RunEnded,
    RunProgram,
    SetMode,
    SetReferences,
    Stop,
    Stopped,
)
from backend.realtime.gains import make_tuning_command
from backend.realtime.headless import SimulatedLoop
from backend.realtime.modes import MODE_CODE, Mode
from backend.realtime.program import Law, Program, Segment, SetTuning
from backend.realtime.ring_buffer import Ring
from backend.sample import INDEX, NAMES
from backend.tuning.gains import TuningParameters
from plant.interface import Measurement, MotorCommand, RawReading
from plant.parameters import PlantParameters, load_parameters
from plant.simulator import Simulator
from tests.realtime.bench_top import BenchTop
from tests.reasons import assert_reason

# Headless stepping is the same loop: answers, events, samples and time agree, and it repeats to the last bit.

Make = Callable[..., SimulatedLoop]


@pytest.fixture
def make(ideal: PlantParameters, tuning: SetTuning) -> Make:
    def build(**options: Callable[[Ring], None]) -> SimulatedLoop:
        return SimulatedLoop(Simulator(ideal, seed=1), ideal, tuning, **options)

    return build


def read_mode(ring: Ring) -> Mode:
    newest = ring.newest()
    assert newest is not None
    return list(MODE_CODE)[int(newest[INDEX["mode"]])]


def slack(ring: Ring) -> bool:
    newest = ring.newest()
    return newest is not None and bool(max(newest[INDEX["F_A"]], newest[INDEX["F_B"]]) < 0.5)


async def pretension(headless: SimulatedLoop) -> None:
    await headless.send(SetMode(Mode.PRETENSION))

    async def granted() -> bool:
        return isinstance(await headless.send(SetMode(Mode.RUN, run=5)), Accepted)

    for _ in range(300):
        if await granted():
            return
        await headless.advance(0.1)
    raise AssertionError("pretension was never reached")


def test_a_program_runs_to_its_end_and_its_samples_hold_its_run_number(make: Make) -> None:
    async def session() -> None:
        headless = make()
        events: list[object] = []
        headless.listen(events.append)
        await pretension(headless)
        program = Program(Law.CASCADE, (Segment(0.3, q_ref=0.1, S_ref=10.0), Segment(0.2, q_ref=0.0, S_ref=10.0)))
        assert isinstance(await headless.send(RunProgram(program, run=8)), Accepted)
        start = headless.ring.count
        await headless.advance_until(lambda: isinstance(events[-1], RunEnded | ModeChanged), timeout_s=1.0)
        _, rows, missed = headless.ring.read(start, 10_000)
        assert missed == 0
        assert np.count_nonzero(rows[:, INDEX["run"]] == 8) == pytest.approx(500, abs=2)
        assert any(isinstance(event, RunEnded) and event.completed and event.run == 8 for event in events)
        headless.close()

    asyncio.run(session())


def test_rejections_and_stops_are_acknowledged(make: Make) -> None:
    async def session() -> None:
        headless = make()
        events: list[object] = []
        forget = headless.listen(events.append)
        refused = await headless.send(SetReferences(0.0, 10.0))
        assert isinstance(refused, Refused)
        assert isinstance(await headless.send(Stop()), Accepted)
        await headless.advance(0.002)
        assert [event.fault for event in events if isinstance(event, Stopped)] == [Stop().fault]
        assert read_mode(headless.ring) is Mode.TRIPPED
        forget()
        seen = len(events)
        await headless.send(Stop())
        assert len(events) == seen
        headless.close()

    asyncio.run(session())


def test_advance_is_exact_and_calls_each_batch_before_the_ring_overflows(make: Make) -> None:
    async def session() -> None:
        counts: list[int] = []
        headless = make(each_batch=lambda ring: counts.append(ring.count))
        await headless.advance(2.5)
        assert headless.ring.count == 2500
        assert counts[-1] == 2500
        assert max(np.diff([0, *counts])) <= 1000
        with pytest.raises(TimeoutError) as late:
            await headless.advance_until(lambda: False, timeout_s=0.01)
        assert_reason(late.value.args[0], "state_not_reached_in_mode", timeout_s=0.01, mode=Mode.OFF)
        assert headless.ring.count == 2510
        await headless.advance_until(lambda: headless.ring.count >= 2515, timeout_s=0.1)
        assert headless.ring.count == 2515
        headless.close()

    asyncio.run(session())


def test_the_same_session_is_bit_identical(make: Make) -> None:
    async def session() -> np.ndarray[tuple[int, ...], np.dtype[np.float64]]:
        headless = make()
        await headless.send(SetMode(Mode.PRETENSION))
        await headless.advance(1.0)
        _, rows, _ = headless.ring.read(0, 1000)
        headless.close()
        return rows

    np.testing.assert_array_equal(asyncio.run(session()), asyncio.run(session()))


def test_reached_pretension_is_reported_once_and_enables_motion(make: Make) -> None:
    async def session() -> None:
        headless = make()
        told: list[object] = []
        headless.listen(lambda event: told.append(event) if isinstance(event, PretensionReached) else None)
        await headless.send(SetMode(Mode.PRETENSION))
        assert isinstance(await headless.send(SetMode(Mode.RUN)), Refused)
        await headless.advance_until(lambda: bool(told), timeout_s=30.0)
        await headless.advance(0.5)
        assert len(told) == 1
        assert isinstance(await headless.send(SetMode(Mode.RUN)), Accepted)
        headless.close()

    asyncio.run(session())


def test_pretension_is_reached_again_after_a_stop_released_the_tendons(make: Make) -> None:
    async def session() -> None:
        headless = make()
        told: list[object] = []
        headless.listen(lambda event: told.append(event) if isinstance(event, PretensionReached) else None)

        def count_reports(times: int) -> bool:
            return len(told) == times

        for times in (1, 2):
            assert isinstance(await headless.send(SetMode(Mode.PRETENSION)), Accepted)
            await headless.advance_until(partial(count_reports, times), timeout_s=30.0)
            await headless.send(Stop())
            await headless.advance_until(lambda: slack(headless.ring), timeout_s=60.0)
            assert isinstance(await headless.send(Reset()), Accepted)
        headless.close()

    asyncio.run(session())


# Each column of a sample holds the quantity of its name: readings, written voltages, commands.


class Witness(Simulator):
    """Records each reading and command per tick, with a card that reads different values each time."""

    def __init__(self, parameters: PlantParameters) -> None:
        super().__init__(parameters)
        self.said: list[Measurement] = []
        self.told: list[MotorCommand] = []

    def read(self) -> Measurement:
        self.said.append(super().read())
        return self.said[-1]

    def write(self, command: MotorCommand) -> None:
        self.told.append(command)
        self.raw = self.card(len(self.told))
        super().write(command)

    @staticmethod
    def card(ticks: int) -> RawReading:
        return RawReading(1.0 + 1e-6 * ticks, 2.0 + 1e-6 * ticks, 3e6 + ticks, 4e6 + ticks, 5e6 + ticks)


class Session:
    """Wound up, run 7 at rest, then both references moved at once, with a push; and what the plant saw of it."""

    def __init__(self) -> None:
        parameters = load_parameters("lab")
        self.plant = Witness(parameters)
        self.bench = BenchTop(parameters, make_tuning_command(parameters, TuningParameters(0.3, 0.5)), self.plant)
        self.bench.run(run=7)
        self.bench.advance(2.0)
        self.begun = len(self.bench.samples.rows)
        self.plant.push(3.0)
        self.bench.send(SetReferences(0.4, 12.0))
        for _ in range(300):
            self.bench.loop.tick(lateness_s=2e-5, overruns=2)
        self.middle = len(self.bench.samples.rows)
        for _ in range(4000):
            self.bench.loop.tick(overruns=2)

    def column(self, name: str) -> np.ndarray:
        return self.bench.column(name)


@pytest.fixture(scope="module")
def session() -> Session:
    return Session()


@pytest.mark.parametrize("name", ["q", "F_A", "F_B", "S_true", "F_push", "F_wall"])
def test_measured_columns_hold_the_readings_of_the_plant(session: Session, name: str) -> None:
    said = [getattr(m, name) for m in session.plant.said[-1000:]]  # one more was said at the start, before a tick
    np.testing.assert_array_equal(session.column(name)[-1000:], said)


def test_stiffness_is_unknown_before_the_first_pretension(session: Session) -> None:
    """The motor positions are unknown until then."""
    S = session.column("S")
    assert np.isnan(S[0])
    assert np.isfinite(S[session.begun :]).all()


@pytest.mark.parametrize("side", ["A", "B"])
def test_motor_angles_are_relative_to_the_pretensioned_position(session: Session, side: str) -> None:
    said = np.array([getattr(m, f"theta_{side}") for m in session.plant.said[-4000:]])
    counted = session.column(f"theta_{side}")[-4000:]
    assert np.ptp(counted) > 0.5
    assert np.ptp(counted - said) == pytest.approx(0.0, abs=1e-12)
    assert counted[-500:] == pytest.approx(session.column(f"theta_{side}_ref")[-500:], abs=0.05)


@pytest.mark.parametrize("name", ["u_A", "u_B"])
def test_voltage_columns_hold_the_voltages_written_to_the_plant(session: Session, name: str) -> None:
    told = [getattr(command, name) for command in session.plant.told]
    np.testing.assert_array_equal(session.column(name), told)
    assert np.ptp(told) > 0.5


@pytest.mark.parametrize("name", RawReading._fields)
def test_raw_columns_hold_the_readings_of_the_card_unchanged(session: Session, name: str) -> None:
    rows = len(session.bench.samples.rows)
    read = [getattr(Witness.card(tick + 1), name) for tick in range(rows)]  # it is asked after the write
    np.testing.assert_array_equal(session.column(name), read)


def test_reference_columns_hold_commanded_and_governed_references(session: Session) -> None:
    for name, after in (("q_ref", 0.4), ("S_ref", 12.0)):
        asked, governed = session.column(name), session.column(f"{name}_gov")
        assert set(asked[session.begun :]) == {after}
        assert asked[session.begun - 1] < governed[session.begun] < after
        assert governed[-1] == pytest.approx(after, abs=1e-9)


def test_speed_and_stiffness_columns_describe_the_joint(session: Session) -> None:
    moving = slice(session.begun, session.middle + 1000)
    q, q_dot = session.column("q")[moving], session.column("q_dot")[moving]
    assert np.sum(q_dot) * 1e-3 == pytest.approx(q[-1] - q[0], abs=0.02)
    assert session.column("S")[-500:] == pytest.approx(session.column("S_true")[-500:], abs=0.3)
    assert np.mean(session.column("S")[-500:]) == pytest.approx(12.0, abs=0.05)


def test_time_run_and_tuning_columns_hold_the_active_values(session: Session) -> None:
    rows = len(session.bench.samples.rows)
    np.testing.assert_array_equal(session.column("tick"), np.arange(rows))
    assert session.column("t") == pytest.approx(np.arange(rows) * 1e-3, abs=1e-12)
    running = session.column("mode") == MODE_CODE[Mode.RUN]
    assert running[session.begun :].all()
    np.testing.assert_array_equal(session.column("run"), np.where(running, 7, 0))
    assert set(session.column("lam_q")) == {0.3}
    assert set(session.column("lam_S")) == {0.5}
    assert set(session.column("bank_entry")) == {0.0}
    assert set(session.column("fault")) == {FAULT_CODE[Fault.NONE]}


def test_lateness_and_overrun_columns_hold_the_values_of_the_tick(session: Session) -> None:
    late = np.zeros(len(session.bench.samples.rows))
    late[session.begun : session.middle] = 2e-5
    np.testing.assert_array_equal(session.column("lateness_s"), late)
    np.testing.assert_array_equal(session.column("overruns"), np.where(np.arange(late.size) < session.begun, 0, 2))


def test_an_active_limit_sets_its_bit(session: Session) -> None:
    limits = session.column("limits").astype(int)
    governed = limits[session.begun] & Limit.GOVERNOR
    assert governed
    assert limits[-1] == 0


def test_a_latched_fault_writes_its_number() -> None:
    bench = BenchTop(load_parameters("lab"))
    bench.run()
    bench.send(Stop())
    bench.advance(2.0)
    assert bench.column("fault")[-1] == FAULT_CODE[Fault.STOP_PRESSED]
    assert bench.column("mode")[-1] == MODE_CODE[Mode.TRIPPED]


def test_every_column_is_covered() -> None:
    seen = "tick t mode run q q_ref q_ref_gov q_dot S S_ref S_ref_gov S_true theta_A theta_A_ref theta_B theta_B_ref"
    seen += " F_A F_B u_A u_B F_push F_ext_hat F_wall V_A V_B n_q n_A n_B"
    seen += " lam_q lam_S bank_entry limits fault lateness_s overruns"
    assert tuple(seen.split()) == NAMES
