"""Motions of the commissioning: homing and the direction test of a motor."""

import asyncio
import math
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from backend.banks.builder import build_tuning_command
from backend.control import pid
from backend.control.motion_types import NO_REFERENCE, MotorLoopState
from backend.experiments.plans import LoopSettings
from backend.faults import Fault
from backend.realtime import messages
from backend.realtime.commands import (
    Accepted,
    Home,
    ModeChanged,
    Refused,
    Reset,
    SetMode,
    SimulateManualInput,
    Stop,
    SwitchDrives,
    TryMotor,
)
from backend.realtime.commissioning_motions import (
    HOMING_MAX_V,
    TENSION_MAX_N,
    TIME_MAX_S,
    TRIAL_MAX_V,
    ModuleTrial,
    MotorTrial,
    compute_switch_travel,
)
from backend.realtime.gains import build_cascade_tuning
from backend.realtime.headless import SimulatedLoop
from backend.realtime.modes import MODE_CODE, HomingEnd, Mode
from backend.realtime.program import SetTuning
from backend.sample import INDEX
from backend.tuning.gains import collect_plant_knowledge
from plant.dynamics import PlantState
from plant.factory import make_plant
from plant.interface import Measurement, PlantChoice, PlantKind, T_s
from plant.manual_input import NO_MANUAL_INPUT, ManualInput
from plant.messages import directions_not_proven
from plant.parameters import load_parameters
from plant.simulator import Simulator
from plant.virtual_daq import VirtualRig
from tests.commissioning.rigs import WIRING, with_entries
from tests.reasons import assert_reason

# The joint is driven to the virtual card's end switch: the zero it takes, and whatever may keep it from there.

PARAMETERS = load_parameters("lab")
COUNT_RAD = 2.0 * math.pi / WIRING.encoder_q.counts_per_rev


class Bench:
    """A loop on a virtual card that is wired as ``true`` says, its joint at ``q`` [rad], its directions proven."""

    def __init__(self, tuning: SetTuning, q: float, declared: dict[str, Any], true: dict[str, Any]) -> None:
        out = -abs(q) * PARAMETERS.geometry.r_j / PARAMETERS.geometry.r_m if abs(q) > 1.0 else 0.0  # else taut
        start = PlantState(*Simulator(PARAMETERS).x)._replace(q=q, theta_A=out, theta_B=out)
        self.simulator = Simulator(PARAMETERS, 0, start)
        wired, really = with_entries(WIRING, **declared), with_entries(WIRING, **true)
        self.rig = VirtualRig(wired, self.simulator, None, really, directions_proven=True, load_cells_measured=True)
        self.loop = SimulatedLoop(self.rig, PARAMETERS, tuning)
        self.ends: list[str] = []
        self.loop.listen(self._hear)
        asyncio.run(self.loop.advance(0.05))

    def _hear(self, event: object) -> None:
        if isinstance(event, ModeChanged) and event.before is Mode.IDENTIFY:
            self.ends.append(event.cause)

    def homed(self, position: float, hand: ManualInput | None = None) -> NDArray[np.float64]:
        """Run homing, with the action ``hand`` once the tendons are taut; return its samples [n, fields]."""

        async def play() -> None:
            assert not isinstance(answer := await self.loop.send(Home(position)), Refused), answer
            if hand is not None:
                await self.loop.advance(5.0)
                await self.loop.send(SimulateManualInput(hand))
            await self.loop.advance_until(lambda: bool(self.ends), TIME_MAX_S + 1.0)
            await self.loop.advance(0.3)

        first = self.loop.ring.count
        asyncio.run(play())
        _, rows, _ = self.loop.ring.read(first, self.loop.ring.capacity)
        self.loop.close()
        at_rest = rows[rows[:, INDEX["mode"]] != MODE_CODE[Mode.IDENTIFY]]
        assert not at_rest[:, [INDEX["u_A"], INDEX["u_B"]]].any()
        return np.asarray(rows[rows[:, INDEX["mode"]] == MODE_CODE[Mode.IDENTIFY]])


@pytest.mark.parametrize(("position", "start"), [(0.5, -0.2), (-0.4, 0.1), (0.5, 0.52)])
def test_homing_sets_the_zero_at_the_end_switch(tuning: SetTuning, position: float, start: float) -> None:
    entries = {"end_switch": {"position": position}}
    bench = Bench(tuning, start, entries, entries)
    way = bench.homed(position)
    assert bench.ends == [HomingEnd.HOMED]
    newest = bench.loop.ring.newest()
    assert newest is not None
    assert newest[INDEX["q"]] == pytest.approx(bench.simulator.x.q, abs=2.0 * COUNT_RAD)
    assert abs(newest[INDEX["q"]]) < 0.05
    assert np.abs(way[:, [INDEX["u_A"], INDEX["u_B"]]]).max() <= HOMING_MAX_V
    assert way[:, [INDEX["F_A"], INDEX["F_B"]]].max() <= TENSION_MAX_N
    assert np.ptp(way[:, INDEX["q"]]) < compute_switch_travel(position)


ELSEWHERE = {"end_switch": {"position": 0.4, "line": "port0/line5"}}
AT = {"end_switch": {"position": 0.4}}
SURPRISES: list[tuple[str, dict[str, Any], dict[str, Any], ManualInput | None, HomingEnd]] = [
    ("the switch never closes", ELSEWHERE, AT, None, HomingEnd.NOT_REACHED),
    (
        "the switch is stuck closed",
        {"end_switch": {"position": 0.4, "line": "port0/line5", "active": "low"}},
        AT,
        None,
        HomingEnd.STUCK_CLOSED,
    ),
    ("the joint's encoder goes backwards", AT, AT | {"encoder_q": {"direction": -1.0}}, None, HomingEnd.WRONG_WAY),
    (
        "the motors were exchanged",
        AT,
        AT | {"motor_A": {"channel": "ao1"}, "motor_B": {"channel": "ao0"}},
        None,
        HomingEnd.MOTOR_OFF,
    ),
    ("a motor turns backwards", AT, AT | {"motor_A": {"gain": -1.0}}, None, HomingEnd.MOTOR_OFF),
    ("a load cell says too little", AT | {"load_cell_A": {"slope": 1.0}}, AT, None, HomingEnd.SLACK),
    ("a hand holds the joint", AT, AT, ManualInput(q=0.15), HomingEnd.JOINT_HELD),
    ("a weight hangs on a load cell", AT, AT, ManualInput(pull_A=7.0), HomingEnd.TENSION),
]


@pytest.mark.parametrize(
    ("declared", "true", "hand", "end"), [case[1:] for case in SURPRISES], ids=[case[0] for case in SURPRISES]
)
def test_unexpected_events_end_homing_at_zero_volts_with_the_reason(
    tuning: SetTuning, declared: dict[str, Any], true: dict[str, Any], hand: ManualInput | None, end: HomingEnd
) -> None:
    bench = Bench(tuning, 0.15, declared, true)
    way = bench.homed(0.4, hand)
    assert bench.ends == [end]
    assert np.abs(way[:, [INDEX["u_A"], INDEX["u_B"]]]).max() <= HOMING_MAX_V
    assert np.ptp(way[:, INDEX["q"]]) < compute_switch_travel(0.4)
    newest = bench.loop.ring.newest()
    assert newest is not None
    assert newest[INDEX["q"]] == pytest.approx(way[-1, INDEX["q"]], abs=0.1)  # no zero was taken: it would be 0.15 off


FAR = {"end_switch": {"position": -0.4}}


@pytest.mark.parametrize("known", [False, True], ids=["no zero is known", "a zero is known"])
def test_homing_from_outside_the_range_works_only_before_the_joint_is_zeroed(tuning: SetTuning, known: bool) -> None:
    """The joint is at 1.3 rad and reads -1.7 rad during homing; its range is 1.57 rad in either direction."""
    bench = Bench(tuning, 1.3, FAR, FAR)
    asyncio.run(bench.loop.send(SimulateManualInput(ManualInput(q=0.0, theta_A=0.0, theta_B=0.0))))
    asyncio.run(bench.loop.advance(3.0))
    asyncio.run(bench.loop.send(SimulateManualInput(NO_MANUAL_INPUT)))
    bench.rig.zeroed = known
    way = bench.homed(-0.4)
    if known:
        assert bench.ends == [Fault.JOINT_LIMIT]
        return
    assert bench.ends == [HomingEnd.HOMED]
    assert way[:, INDEX["q"]].min() < -1.6
    newest = bench.loop.ring.newest()
    assert newest is not None
    assert newest[INDEX["q"]] == pytest.approx(bench.simulator.x.q, abs=2.0 * COUNT_RAD)


def test_a_stop_during_such_homing_can_be_reset_at_the_current_position(tuning: SetTuning) -> None:
    bench = Bench(tuning, 1.3, FAR, FAR)
    asyncio.run(bench.loop.send(SimulateManualInput(ManualInput(q=0.0, theta_A=0.0, theta_B=0.0))))
    asyncio.run(bench.loop.advance(3.0))
    asyncio.run(bench.loop.send(SimulateManualInput(NO_MANUAL_INPUT)))
    bench.rig.zeroed = False

    def newest(name: str) -> float:
        row = bench.loop.ring.newest()
        assert row is not None
        return float(row[INDEX[name]])

    assert isinstance(asyncio.run(bench.loop.send(Home(-0.4))), Accepted)
    asyncio.run(bench.loop.advance_until(lambda: newest("q") < -1.6, TIME_MAX_S))
    assert newest("q") < -1.6
    asyncio.run(bench.loop.send(Stop(Fault.STOP_PRESSED, hard=True)))
    asyncio.run(bench.loop.advance(1.0))
    assert isinstance(answer := asyncio.run(bench.loop.send(Reset())), Accepted), answer
    assert isinstance(asyncio.run(bench.loop.send(TryMotor("A"))), Accepted)
    asyncio.run(bench.loop.advance(0.1))
    assert newest("mode") == MODE_CODE[Mode.IDENTIFY]  # tried, and not stopped for where the encoder counts from
    bench.loop.close()


def test_homing_is_rejected_until_it_is_safe(tuning: SetTuning) -> None:
    bench = Bench(tuning, 0.0, AT, AT | {"encoder_A": {"direction": -1.0}})

    def refused(position: float = 0.4) -> str:
        answer = asyncio.run(bench.loop.send(Home(position)))
        assert isinstance(answer, Refused)
        return answer.reason

    bench.rig.prove_directions(proven=False)
    assert directions_not_proven() in refused()
    bench.rig.prove_directions(proven=True)
    assert messages.travel_to_switch() in refused(0.01)
    asyncio.run(bench.loop.send(SwitchDrives(on=False)))
    assert_reason(refused(), "drives_switched_off")
    asyncio.run(bench.loop.send(SwitchDrives(on=True)))
    asyncio.run(bench.loop.send(SimulateManualInput(ManualInput(pull_B=12.0))))
    asyncio.run(bench.loop.advance(0.1))
    assert_reason(refused(), "tendons_too_taut", maximum_N=10.0)
    bench.loop.close()


@pytest.mark.parametrize(
    ("command", "mode"),
    [(SetMode(Mode.STOPPING), Mode.OFF), (Stop(Fault.OPERATOR_LOST, hard=False), Mode.TRIPPED), (Stop(), Mode.TRIPPED)],
)
def test_a_stop_during_homing_sets_zero_volts_at_once(tuning: SetTuning, command: SetMode | Stop, mode: Mode) -> None:
    bench = Bench(tuning, 0.0, AT, AT)
    asyncio.run(bench.loop.send(Home(0.4)))
    asyncio.run(bench.loop.advance(0.5))
    first = bench.loop.ring.count
    asyncio.run(bench.loop.send(command))
    asyncio.run(bench.loop.advance(0.1))
    _, rows, _ = bench.loop.ring.read(first, bench.loop.ring.capacity)
    bench.loop.close()
    assert (rows[:, INDEX["mode"]] == MODE_CODE[mode]).all()
    assert not rows[:, [INDEX["u_A"], INDEX["u_B"]]].any()


def test_homing_aborts_at_its_time_limit(tuning: SetTuning, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("backend.realtime.commissioning_motions.TIME_MAX_S", 0.5)
    bench = Bench(tuning, 0.1, AT, AT)
    way = bench.homed(0.4)
    assert bench.ends == [HomingEnd.TOO_LONG]
    assert len(way) == 500


# A motor that is tried may turn either way: nothing closes a loop on it, however the trial ends.

PARAMETERS_TRIAL = load_parameters("ideal")


def tried(tuning: SetTuning) -> SimulatedLoop:
    """Return a loop on the virtual card during the direction test of motor A."""
    loop = SimulatedLoop(make_plant(PlantChoice(PlantKind.VIRTUAL_CARD), PARAMETERS_TRIAL, 0), PARAMETERS_TRIAL, tuning)
    asyncio.run(loop.advance(0.01))
    assert isinstance(asyncio.run(loop.send(TryMotor("A"))), Accepted)
    asyncio.run(loop.advance(0.1))
    assert value(loop, "u_A") == pytest.approx(0.1, abs=0.01)
    return loop


def value(loop: SimulatedLoop, signal: str) -> float:
    newest = loop.ring.newest()
    assert newest is not None
    return float(newest[INDEX[signal]])


@pytest.mark.parametrize(
    ("command", "mode"),
    [
        (SetMode(Mode.STOPPING), Mode.OFF),
        (Stop(Fault.OPERATOR_LOST, hard=False), Mode.TRIPPED),
        (Stop(Fault.SERVICE_LOST, hard=False), Mode.TRIPPED),
        (Stop(), Mode.TRIPPED),
    ],
)
def test_an_aborted_direction_test_sets_zero_volts_without_braking(
    tuning: SetTuning, command: SetMode | Stop, mode: Mode
) -> None:
    loop = tried(tuning)
    before = loop.ring.count
    asyncio.run(loop.send(command))
    asyncio.run(loop.advance(0.2))
    _, rows, _ = loop.ring.read(before, loop.ring.count - before)
    assert not rows[1:, INDEX["u_A"]].any()
    assert not rows[:, INDEX["u_B"]].any()
    assert (rows[1:, INDEX["mode"]] == MODE_CODE[mode]).all()
    loop.close()


def test_only_stops_are_accepted_during_a_direction_test(tuning: SetTuning) -> None:
    loop = tried(tuning)
    refused = asyncio.run(loop.send(SetMode(Mode.PRETENSION)))
    assert isinstance(refused, Refused)
    assert_reason(refused.reason, "commissioning_motion_in_progress")
    loop.close()


def test_a_failed_direction_test_leaves_the_directions_unproven(tuning: SetTuning) -> None:
    loop = tried(tuning)
    asyncio.run(loop.send(SetMode(Mode.STOPPING)))
    asyncio.run(loop.advance(0.01))
    refused = asyncio.run(loop.send(SetMode(Mode.PRETENSION)))
    assert isinstance(refused, Refused)
    assert directions_not_proven() in refused.reason
    loop.close()


@pytest.mark.parametrize("silent", ["q", "theta_A", "theta_B", "F_A", "F_B"])
def test_a_nan_reading_ends_the_outward_motion(silent: str) -> None:
    m = Measurement(0.0, 0.0, 0.0, 2.0, 2.0, math.nan, 0.0, 0.0)
    gains = build_cascade_tuning(
        build_tuning_command(PARAMETERS_TRIAL, LoopSettings(), None), collect_plant_knowledge(PARAMETERS_TRIAL)
    )
    carry = MotorLoopState(pid.at_rest_motor_pair(gains.motors, 0.0, 0.0, 0.0, 0.0), gains.motors, 0.0, 0.0)
    trial = MotorTrial(carry, NO_REFERENCE, m, "A")
    rising = [trial.step(gains, m).u_A for _ in range(50)]
    assert rising == sorted(rising)
    after = [trial.step(gains, m._replace(**{silent: math.nan})).u_A for _ in range(50)]
    assert max(after) <= rising[-1]


def test_a_motor_returns_with_its_outward_voltages_and_rests_before_the_end() -> None:
    """The motor does not move here, so the outward motion ends at the largest voltage, after one second."""
    m = Measurement(0.0, 0.0, 0.0, 2.0, 2.0, math.nan, 0.0, 0.0)
    gains = build_cascade_tuning(
        build_tuning_command(PARAMETERS_TRIAL, LoopSettings(), None), collect_plant_knowledge(PARAMETERS_TRIAL)
    )
    carry = MotorLoopState(pid.at_rest_motor_pair(gains.motors, 0.0, 0.0, 0.0, 0.0), gains.motors, 0.0, 0.0)
    trial = MotorTrial(carry, NO_REFERENCE, m, "A")
    u_A: list[float] = []
    while not trial.done and len(u_A) < 5000:
        u_A.append(trial.step(gains, m).u_A)
    out, coast, back, pause = np.split(np.array(u_A), [999, 1200, 2200])
    np.testing.assert_allclose(out, np.arange(1, 1000) * TRIAL_MAX_V * T_s)
    np.testing.assert_array_equal(coast, 0.0)
    np.testing.assert_allclose(back, -np.arange(1, 1001) * TRIAL_MAX_V * T_s)
    np.testing.assert_array_equal(pause, np.zeros(301))


@pytest.mark.parametrize("silent", ["F_A", "F_B"])
def test_a_nan_tension_ends_the_test_of_the_safety_module(silent: str) -> None:
    m = Measurement(0.0, 0.0, 0.0, 10.0, 10.0, math.nan, 0.0, 1.0)
    gains = build_cascade_tuning(
        build_tuning_command(PARAMETERS_TRIAL, LoopSettings(), None), collect_plant_knowledge(PARAMETERS_TRIAL)
    )
    carry = MotorLoopState(pid.at_rest_motor_pair(gains.motors, 0.0, 0.0, 0.0, 0.0), gains.motors, 0.0, 0.0)
    trial = ModuleTrial(carry, NO_REFERENCE, m)
    trial.step(gains, m)
    assert not trial.done
    trial.step(gains, m._replace(**{silent: math.nan}))
    assert trial.done
