"""Motions that follow references of position and stiffness: the cascade, and the baselines it is compared with."""

from collections.abc import Callable
from typing import Any, NamedTuple

from backend.controllers import cascade, decoupler, feedback_linearization, motors, single_loop
from backend.controllers.limits import Bounds
from backend.faults import Limit
from backend.loop.motion import Carry, Decision, clipped
from backend.loop.player import SegmentPlayer, Target
from backend.loop.program import Law, Segment
from backend.tuning.baselines import feedback_linearization_tuning, single_loop_tuning
from backend.tuning.models import Lambdas
from plant.compiled import Specialised
from plant.interface import NOT_MEASURED, Measurement
from plant.parameters import PlantParameters


class Tracking:
    """The cascade, following the operator's references or a program's segments."""

    def __init__(
        self,
        tuning: cascade.Tuning,
        carry: Carry,
        m: Measurement,
        bounds: Bounds,
        position_loop: bool,
        segments: tuple[Segment, ...] | None = None,
    ) -> None:
        self.done = False
        self._state = cascade.take_over(tuning, carry.state, carry.gains, carry.theta_A_ref, carry.theta_B_ref, m)
        self._law = Specialised(cascade.step, tuning, self._state, 0.0, 0.0, position_loop, NOT_MEASURED)
        self.target = _here(tuning, m, bounds)
        self._player = None if segments is None else SegmentPlayer(segments, self.target)
        self._position_loop = position_loop
        self._carry = carry

    def step(self, tuning: cascade.Tuning, m: Measurement) -> Decision:
        """One tick of the cascade."""
        if self._player is not None:
            target = self._player.step()
            self.done = target is None
            self.target = target or self.target
        q_ref, S_ref = self.target.q_ref, self.target.S_ref
        y, self._state = self._law(tuning, self._state, q_ref, S_ref, self._position_loop, m)
        self._carry = Carry(self._state.motors, tuning.motors, y.theta_A_ref, y.theta_B_ref)
        return _decision(y, self.target, pushes=self._player is not None)

    def carry(self) -> Carry:
        """Return the motor loops for the next motion."""
        return self._carry


class _Law(NamedTuple):
    """A baseline: its tuning from parameters and λ, the state that takes over, and the tick."""

    tuning: Callable[[PlantParameters, Lambdas], Any]
    take_over: Callable[..., Any]
    step: Callable[..., tuple[cascade.Output, Any]]


BASELINES: dict[Law, _Law] = {
    Law.SINGLE_LOOP: _Law(single_loop_tuning, single_loop.take_over, single_loop.step),
    Law.FEEDBACK_LINEARIZATION: _Law(
        feedback_linearization_tuning, feedback_linearization.take_over, feedback_linearization.step
    ),
}


class Baseline:
    """A law without cascade playing a program's segments; its gains stay as they were at the start."""

    def __init__(
        self,
        law: Law,
        parameters: PlantParameters,
        lambdas: Lambdas,
        tuning: cascade.Tuning,
        carry: Carry,
        m: Measurement,
        bounds: Bounds,
        segments: tuple[Segment, ...],
    ) -> None:
        """Raise TuningError where the law has no gains for these λ."""
        self.done = False
        baseline = BASELINES[law]
        self._tuning = baseline.tuning(parameters, lambdas)
        held, _ = motors.step(
            carry.gains, carry.state, carry.theta_A_ref, carry.theta_B_ref, m.theta_A, m.theta_B, tuning.u_max
        )
        self._state = baseline.take_over(self._tuning, held.u_A, held.u_B, m)
        self._law = Specialised(baseline.step, self._tuning, self._state, 0.0, 0.0, NOT_MEASURED)
        self.target = _here(tuning, m, bounds)
        self._player = SegmentPlayer(segments, self.target)
        self._carry = carry

    def step(self, tuning: cascade.Tuning, m: Measurement) -> Decision:
        """One tick of the law; the cascade's tuning is only what the next motion takes over."""
        target = self._player.step()
        self.done = target is None
        self.target = target or self.target
        y, self._state = self._law(self._tuning, self._state, self.target.q_ref, self.target.S_ref, m)
        state = motors.at_rest(tuning.motors, m.theta_A, m.theta_B, y.u_A, y.u_B)
        self._carry = Carry(state, tuning.motors, m.theta_A, m.theta_B)
        return _decision(y, self.target, pushes=True)

    def carry(self) -> Carry:
        """Return motor loops that hold the joint where the law has left it."""
        return self._carry


def acting(y: cascade.Output) -> Limit:
    """Limit flags of a tick."""
    flags = (
        (y.governed, Limit.GOVERNOR),
        (y.at_floor, Limit.TENSION_FLOOR),
        (y.at_ceiling, Limit.TENSION_CEILING),
        (y.at_range, Limit.JOINT_RANGE),
    )
    limits = clipped(y.clipped_A, y.clipped_B)
    for acts, flag in flags:
        if acts:
            limits |= flag
    return limits


def _decision(y: cascade.Output, target: Target, *, pushes: bool) -> Decision:
    return Decision(
        y.u_A,
        y.u_B,
        y.theta_A_ref,
        y.theta_B_ref,
        target,
        y.q_ref_gov,
        y.S_ref_gov,
        y.bank_entry,
        acting(y),
        pushes,
    )


def _here(tuning: cascade.Tuning, m: Measurement, bounds: Bounds) -> Target:
    """Return references where the joint is, as far as references may go."""
    S = decoupler.stiffness(tuning.decoupler, m.theta_A, m.theta_B)
    return Target(min(max(m.q, bounds.q_min), bounds.q_max), min(max(S, bounds.S_min), bounds.S_max), 0.0)
