"""What the loop does with the motors in each mode: a motion, begun here and stepped by the compiled tick.

Every motion hands the state of the motor loops on to the next one, so that no change of mode makes the voltages jump.
"""

from collections.abc import Callable
from typing import Any

from backend.control import baselines as feedback_linearization
from backend.control import baselines as single_loop
from backend.control import cascade, motion_primitives, pid, tracking
from backend.control import tracking as baselines
from backend.control.decoupler import Bounds
from backend.control.motion_types import NO_REFERENCE, Carry, Decision, Target, follow
from backend.control.step import Moving, Resting
from backend.loop.causes import Cause, Why
from backend.loop.program import Law, Program
from backend.loop.program_arrays import player_of
from backend.tuning.baselines import feedback_linearization_tuning, single_loop_tuning
from backend.tuning.models import Lambdas
from plant.compiled import Cell
from plant.interface import Measurement
from plant.parameters import PlantParameters


class Motion:
    """One way of moving. ``done`` tells that it has reached its end; it goes on holding there.

    It begins with ``first`` and goes on in the cell where it is laid.
    """

    def __init__(self, carry: Carry, state: Any, target: Target = NO_REFERENCE) -> None:
        self.done = False
        self.first = Moving(carry, target, state)
        self._cell: Cell[Moving] | None = None

    def lie_in(self, cell: Cell[Moving]) -> None:
        """Go on in a cell of its kind, in which nothing else moves any more."""
        cell.put(self.first)
        self._cell = cell

    @property
    def now(self) -> Moving:
        """As it stands now."""
        return self.first if self._cell is None else self._cell.get()

    def carry(self) -> Carry:
        """Return the motor loops for the next motion."""
        return self.now.carry

    def aim(self, target: Target) -> None:
        """Go for another target from the next tick on."""
        if self._cell is not None:
            self._cell.field("target").put(target)


def _held(carry: Carry, m: Measurement, u_max: float) -> tuple[float, float]:
    """Voltages [V] that the motor loops would go on with."""
    references = carry.theta_A_ref, carry.theta_B_ref
    held, _ = pid.step_motor_pair(carry.gains, carry.state, *references, m.theta_A, m.theta_B, u_max)
    return held.u_A, held.u_B


class Rest(Motion):
    """None: zero volts."""

    def __init__(self, gains: pid.MotorPairGains) -> None:
        super().__init__(Carry(pid.at_rest_motor_pair(gains, 0.0, 0.0, 0.0, 0.0), gains, 0.0, 0.0), Resting(0.0))


class Winding(Motion):
    """Pretension from slack: both motors wind until both load cells read the pretension."""

    def __init__(self, carry: Carry) -> None:
        super().__init__(carry, motion_primitives.begin_winding(carry))

    @property
    def tensions(self) -> tuple[float, float]:
        """Filtered load cell readings [N]."""
        wound = self.now.state.winding
        return wound.F_A, wound.F_B


class Travel(Motion):
    """Walk the motor references along a straight line to (theta_A, theta_B) [rad] and hold there."""

    def __init__(self, carry: Carry, theta_A: float, theta_B: float) -> None:
        super().__init__(carry, motion_primitives.TravelState(theta_A, theta_B, 0.0))


class Braking(Motion):
    """Soft stop: brake both motors and keep braking until the joint has come to rest under tension."""

    def __init__(self, carry: Carry, m: Measurement, u_max: float) -> None:
        super().__init__(carry, motion_primitives.begin_soft_stop(*_held(carry, m, u_max), m))


class ForceHold(Motion):
    """Actuator identification: tension held by motor A, the excitation on top (figure 5)."""


class TensionSweep(Motion):
    """Spring identification: both tensions wound evenly up and down."""


class MotorSteps(Motion):
    """Motor identification: voltage steps with slack tendons."""


class Tracking(Motion):
    """The cascade, following the operator's references or a program's segments."""

    def __init__(
        self,
        tuning: cascade.CascadeTuning,
        carry: Carry,
        m: Measurement,
        bounds: Bounds,
        position_loop: bool,
        program: Program | None = None,
        *,
        gives_way: bool = False,
    ) -> None:
        """Begin where nothing has to move; a joint that ``gives_way`` is to rest where it is now."""
        here = tracking.here(tuning, m, bounds, position_loop=position_loop or gives_way)
        player = player_of(() if program is None else program.segments, here)
        references = carry.theta_A_ref, carry.theta_B_ref
        law = cascade.take_over(tuning, carry.state, carry.gains, *references, m, here.q_ref)
        super().__init__(carry, tracking.TrackingState(law, position_loop, program is not None, player), here)


def _single_loop(parameters: PlantParameters, lambdas: Lambdas, u: tuple[float, float], m: Measurement) -> Any:
    tuning = single_loop_tuning(parameters, lambdas)
    return baselines.SingleLoop, tuning, single_loop.take_over_single_loop(tuning, *u, m)


def _feedback_linearization(
    parameters: PlantParameters, lambdas: Lambdas, u: tuple[float, float], m: Measurement
) -> Any:
    tuning = feedback_linearization_tuning(parameters, lambdas)
    return (
        baselines.FeedbackLinearization,
        tuning,
        feedback_linearization.take_over_feedback_linearization(tuning, *u, m),
    )


BASELINES: dict[Law, Callable[[PlantParameters, Lambdas, tuple[float, float], Measurement], Any]] = {
    Law.SINGLE_LOOP: _single_loop,
    Law.FEEDBACK_LINEARIZATION: _feedback_linearization,
}
"""Laws without cascade: kind, tuning from parameters and λ, and the state that takes over from voltages [V]."""


class Baseline(Motion):
    """A law without cascade playing a program's segments; its gains stay as they were at the start."""

    def __init__(
        self,
        program: Program,
        parameters: PlantParameters,
        lambdas: Lambdas,
        tuning: cascade.CascadeTuning,
        carry: Carry,
        m: Measurement,
        bounds: Bounds,
    ) -> None:
        """Raise TuningError where the law has no gains for these λ."""
        here = tracking.here(tuning, m, bounds)
        kind, own, law = BASELINES[program.law](parameters, lambdas, _held(carry, m, tuning.u_max), m)
        super().__init__(carry, kind(own, law, player_of(program.segments, here)), here)


class Interpreted(Motion):
    """What a bring-up plays: rare, short, and stepped by the interpreter."""

    def __init__(self, carry: Carry, target: Target) -> None:
        self.done = False
        self.target = target
        self._carry = carry

    def step(self, tuning: cascade.CascadeTuning, m: Measurement) -> Decision:
        """One tick: measurement to voltages."""
        raise NotImplementedError

    def carry(self) -> Carry:
        """Return the motor loops for the next motion."""
        return self._carry

    def follow(self, tuning: cascade.CascadeTuning, m: Measurement, theta_A_ref: float, theta_B_ref: float) -> Decision:
        """One tick of both motor loops towards motor references [rad]."""
        decision, self._carry = follow(tuning, self._carry, self.target, theta_A_ref, theta_B_ref, m, False)
        return decision


class Trial(Interpreted):
    """What the bring-up plays, from OFF to OFF: never braked, as nothing is proven yet, but ended at zero volts.

    ``cause`` says how it ended.
    """

    cause: Why = Cause.ASKED_FOR
