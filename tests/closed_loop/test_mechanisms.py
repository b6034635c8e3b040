"""The control loop on actuators without tendons: references, limits, and what needs load cells."""

import math

import numpy as np
import pytest
from numpy.typing import NDArray

from backend.banks.builder import build_tuning_command
from backend.control import build_decoupler, compute_bounds, decoupler
from backend.experiments.plans import LoopSettings
from backend.faults import Fault
from backend.realtime.commands import ApplyPush, Command, Inject, Refused, RunProgram, SetMode, SetReferences
from backend.realtime.control_loop import Loop
from backend.realtime.modes import Mode
from backend.realtime.program import Law, Program, Segment
from backend.realtime.ring_buffer import Ring
from backend.sample import INDEX
from plant.interface import InjectedFault, InjectedFaultKind, Sensor
from plant.mechanisms import elastic_torques
from plant.parameters import OF_OTHER_MECHANISMS, load_parameters
from plant.simulator import Simulator
from tests.reasons import assert_reason

sets = pytest.mark.parametrize("name", OF_OTHER_MECHANISMS)
HELD_S = 12.0
SLOW = LoopSettings(lam_q=0.8, lam_S=0.8)
"""With gains from geometry friction lets the faster default overshoot in S by 3 %."""


class Session:
    """A loop on a simulated actuator, in mode pretension."""

    def __init__(self, name: str) -> None:
        self.parameters = load_parameters(name)
        self.plant, self.ring = Simulator(self.parameters), Ring.create()
        self.loop = Loop(self.plant, self.parameters, self.ring, build_tuning_command(self.parameters, SLOW, None))
        self.send(SetMode(Mode.PRETENSION))
        while not self.loop.is_pretension_done:
            self.loop.tick()

    def send(self, command: Command) -> None:
        self.loop.handle(0, command)
        refused = [event for event in self.loop.drain_events() if isinstance(event, Refused)]
        assert not refused

    def go(self, q_ref: float, S_ref: float, duration_s: float = HELD_S) -> NDArray[np.float64]:
        """Set references; return the sample rows until the end."""
        self.send(SetReferences(q_ref, S_ref))
        left, parts = round(duration_s * 1000.0), []
        while left > 0:
            done = self.loop.run(min(left, 1000))
            _, rows, _ = self.ring.read(self.ring.count - done, done)
            parts.append(np.array(rows))
            left -= done
        return np.concatenate(parts)


@sets
def test_references_of_position_and_stiffness_are_reached(name: str) -> None:
    session = Session(name)
    bounds = compute_bounds(session.parameters)
    middle, count = 0.5 * (bounds.S_min + bounds.S_max), session.parameters.sensors.joint_step
    session.send(SetMode(Mode.RUN))
    q, S = 0.0, bounds.S_min
    for q_next, S_next in ((0.5, S), (0.5, middle), (-0.5, middle), (-0.5, bounds.S_max), (0.8, bounds.S_min)):
        rows = session.go(q_next, S_next)
        assert session.loop.mode is Mode.RUN
        assert rows[-1, INDEX["q"]] == pytest.approx(q_next, abs=2.0 * count)
        assert rows[-1, INDEX["S_true"]] == pytest.approx(S_next, abs=0.01 * bounds.S_max)
        assert np.isnan(rows[:, [INDEX["F_A"], INDEX["F_B"]]]).all()
        for column, before, after in (("q", q, q_next), ("S", S, S_next)):
            if after != before:
                travelled = (rows[:, INDEX[column]] - before) / (after - before)
                assert travelled.max() < 1.02, column
        q, S = q_next, S_next


@sets
def test_the_decoupler_gives_rest_at_the_position_and_stiffness(name: str) -> None:
    parameters = load_parameters(name)
    assert parameters.mechanism is not None
    d, mechanism = build_decoupler(parameters), parameters.mechanism.make_mechanism()
    for q in (-0.7, 0.0, 0.4):
        for S in np.linspace(parameters.mechanism.S_min, parameters.mechanism.S_max, 7):
            theta_A, theta_B = decoupler.motor_positions(d, q, S)
            tau, _, _, stiffness = elastic_torques(mechanism, q, theta_A, theta_B)
            assert tau == pytest.approx(0.0, abs=1e-5 * S)
            assert stiffness == pytest.approx(S, rel=1e-4)
            assert decoupler.stiffness(d, theta_A, theta_B) == pytest.approx(S, rel=1e-12)
            assert decoupler.equilibrium(d, theta_A, theta_B) == pytest.approx(q, abs=1e-12)
            h, rate_A, rate_B = 1e-6, 0.7, -1.3
            q_rate, S_rate = decoupler.rates(d, theta_A, theta_B, rate_A, rate_B)
            ahead, behind = (
                (
                    decoupler.equilibrium(d, theta_A + s * h * rate_A, theta_B + s * h * rate_B),
                    decoupler.stiffness(d, theta_A + s * h * rate_A, theta_B + s * h * rate_B),
                )
                for s in (1.0, -1.0)
            )
            assert (ahead[0] - behind[0]) / (2.0 * h) == pytest.approx(q_rate, rel=5e-3, abs=1e-4)
            assert (ahead[1] - behind[1]) / (2.0 * h) == pytest.approx(S_rate, rel=2e-2)


@sets
def test_a_push_is_estimated_from_the_deflection(name: str) -> None:
    session = Session(name)
    bounds = compute_bounds(session.parameters)
    session.send(SetMode(Mode.RUN))
    session.go(0.0, bounds.S_max)
    pushed_N = 0.05 * bounds.S_max / session.parameters.geometry.r_j  # deflects the springs by 0.05 rad
    session.send(ApplyPush(pushed_N, 3.0))
    rows = session.go(0.0, bounds.S_max, 2.5)
    assert rows[-1, INDEX["F_push"]] == pushed_N
    assert rows[-500:, INDEX["F_ext_hat"]].mean() == pytest.approx(pushed_N, rel=0.02)


@sets
def test_too_large_a_deflection_stops_the_motors(name: str) -> None:
    session = Session(name)
    session.send(SetMode(Mode.RUN))
    bounds = compute_bounds(session.parameters)
    session.plant.push(2.0 * bounds.S_min / session.parameters.geometry.r_j)
    for _ in range(2000):
        session.loop.tick()
    assert session.loop.mode is Mode.TRIPPED
    assert session.loop.fault in (Fault.FORCE_LIMIT, Fault.SAFETY_MODULE)


@sets
@pytest.mark.parametrize("sensor", [Sensor.Q, Sensor.THETA_A, Sensor.THETA_B])
def test_a_missing_encoder_reading_stops_the_motors(name: str, sensor: Sensor) -> None:
    session = Session(name)
    session.send(SetMode(Mode.RUN))
    session.send(Inject(InjectedFault(InjectedFaultKind.NO_NUMBER, sensor)))
    session.loop.tick()
    assert session.loop.mode is Mode.TRIPPED
    assert session.loop.fault is Fault.SENSOR_INVALID


def test_a_fault_of_a_load_cell_is_refused_without_load_cells() -> None:
    session = Session("qbmove")
    session.loop.drain_events()
    session.loop.handle(0, Inject(InjectedFault(InjectedFaultKind.STUCK, Sensor.F_A)))
    (answer,) = session.loop.drain_events()
    assert isinstance(answer, Refused)
    assert_reason(answer.reason, "load_cells_missing")


@pytest.mark.parametrize("law", [Law.FORCE_HOLD, Law.MOTOR_STEPS, Law.TENSION_SWEEP, Law.FEEDBACK_LINEARIZATION])
def test_a_program_that_needs_load_cells_is_refused(law: Law) -> None:
    session = Session("qbmove")
    session.loop.drain_events()
    session.loop.handle(0, RunProgram(Program(law, (Segment(1.0, 0.0, 0.5),)), 1))
    (answer,) = session.loop.drain_events()
    assert isinstance(answer, Refused)
    assert_reason(answer.reason, "law_requires_tendons")
    assert session.loop.mode is Mode.PRETENSION


def test_bounds_of_tendons_are_not_a_number_without_them() -> None:
    bounds = compute_bounds(load_parameters("awas2"))
    assert math.isnan(bounds.F_max)
    assert math.isnan(bounds.F_slack)
    assert (bounds.S_min, bounds.S_max) == (3.0, 40.0)
