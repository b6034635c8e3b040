"""What a λ would do before it is sent: robustness and step on the high-order model, voltage and tension simulated."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from backend.controllers import i_p
from backend.refusal import require_within
from backend.tuning.closed_loop import run
from backend.tuning.formulas import TuningError, motor_gains, printed_outer_gains
from backend.tuning.gains import (
    cascade_tuning,
    motor_loops,
    position_gains,
    position_process,
    stiffness_gains,
    stiffness_process,
)
from backend.tuning.linear_model import decoupled_model
from backend.tuning.models import LAM_MAX, Lambdas, MotorModel, PointModel, designed_point, motor_model
from backend.tuning.motor_loop import common_range, motor_lambda, motor_robustness
from backend.tuning.plan_budget import plan_range, require_budget
from backend.tuning.remembered import remembered
from backend.tuning.robustness import M_S_MAX, OuterProcess, Robustness, safe_lambda
from plant.interface import T_s
from plant.parameter_sections import SIDES
from plant.parameters import PlantParameters

STEP_Q = np.pi / 3.0
"""Step of q_ref whose peak voltage and least tension the preview shows [rad]: half of the paper's largest."""

STEP_S = (8.0, 14.0)
"""Step of S_ref that has to stay within the voltage [N·m/rad]: the pulses of the paper."""

LAM_RESOLUTION = 1e-3
"""How finely the end of the range is found where the voltage decides [s]."""

_POINTS = 200


@dataclass(frozen=True)
class LoopPreview:
    """One outer loop: robustness, unit step response y (n,) over t (n,) [s], and the range of λ offered [s].

    ``printed`` and ``printed_y`` (n,) are what the printed formula of table 2 would give (erratum E1).
    """

    robustness: Robustness
    lam_min: float
    lam_max: float
    t: NDArray[np.float64]
    y: NDArray[np.float64]
    printed: Robustness
    printed_y: NDArray[np.float64]


class SimulatedStep(NamedTuple):
    """``peak_voltage`` [V] and ``least_tension`` [N] of a step; when q is 90 % there [s], nan where it never is."""

    peak_voltage: float
    least_tension: float
    rise_s: float


@dataclass(frozen=True)
class Preview:
    """All loops at one bank point, and a ``step`` of STEP_Q at its S; ``motor`` is the less robust of the two loops."""

    motor: Robustness
    position: LoopPreview
    stiffness: LoopPreview
    step: SimulatedStep


class Previewer:
    """Previews at the points of a bank; keeps the high-order models, which depend on λ_motor and the point only.

    ``b`` counts where the range ends by the voltage: a reference that is felt at once takes more of it.
    Raises OutOfRangeError for a ``lam_motor`` [s] that is not offered.
    """

    def __init__(
        self,
        parameters: PlantParameters,
        points: Sequence[PointModel] = (),
        motor: MotorModel | None = None,
        lam_motor: float = Lambdas().lam_motor,
        b: float = 0.0,
    ) -> None:
        self._parameters = parameters
        self._motor = motor
        self._motors = [motor] if motor else [motor_model(parameters, side) for side in SIDES]
        require_within("lam_motor", lam_motor, *self.motor_range(), "s")
        self.points = sorted(points or (designed_point(parameters, lam_motor),), key=lambda point: point.S_nominal)
        self._lam_motor, self._b = lam_motor, b
        self._ranges = [
            remembered(("outer ranges", parameters, motor, point, lam_motor, b), 2, partial(self._safe_ranges, entry))
            for entry, point in enumerate(self.points)
        ]

    @cached_property
    def _processes(self) -> list[tuple[OuterProcess, OuterProcess]]:
        """What the outer loops of q and S control, by point."""
        gains = motor_loops(self._parameters, self._lam_motor, self._motor)
        models = [decoupled_model(self._parameters, gains, point.S_nominal) for point in self.points]
        return [(OuterProcess(model[0, 0]), OuterProcess(model[1, 1])) for model in models]

    @cached_property
    def _motor_robustness(self) -> Robustness:
        return self.motor_at(self._lam_motor)

    def safe_range(self) -> tuple[float, float]:
        """Smallest lam_q and lam_S [s] that are robust and leave the voltage unclipped at every point of the bank."""
        return max(q for q, _ in self._ranges), max(S for _, S in self._ranges)

    def motor_range(self) -> tuple[float, float]:
        """Smallest and largest lam_motor [s] that are offered for both motors. Raises TuningError."""
        return common_range(self._motors)

    def is_for(self, lam_motor: float, b: float) -> bool:
        """Return whether its models and ranges are those of this λ_motor [s] and weight b."""
        return (self._lam_motor, self._b) == (lam_motor, b)

    def motor_at(self, lam_motor: float) -> Robustness:
        """Robustness of the less robust of the two motor loops. Raises OutOfRangeError for a λ that is not offered."""
        require_within("lam_motor", lam_motor, *self.motor_range(), "s")
        loops = [motor_robustness(known, motor_gains(known.K_m, known.T_m, lam_motor)) for known in self._motors]
        return max(loops, key=lambda loop: loop.M_s)

    def plan_range(self) -> tuple[float, float]:
        """Smallest and largest budget of a plan [V] that are offered beside 0."""
        return plan_range(self._parameters)

    def require_safe(self, lambdas: Lambdas, u_plan: float = 0.0) -> None:
        """Raise OutOfRangeError unless both λ and the budget of the plan [V] lie in the offered range."""
        require_budget(self._parameters, u_plan)
        lam_q_min, lam_S_min = self.safe_range()
        remedy = "below it the loop's sensitivity peak M_s exceeds 1.7 or a step takes all of the voltage"
        require_within("lam_q", lambdas.lam_q, lam_q_min, LAM_MAX, "s", remedy)
        require_within("lam_S", lambdas.lam_S, lam_S_min, LAM_MAX, "s", remedy)

    def preview(self, lambdas: Lambdas, entry: int = 0, u_plan: float = 0.0) -> Preview:
        """Preview at one point of the bank, with a plan of ``u_plan`` [V] or by the governor.

        Raises TuningError for a λ that has no gains.
        """
        lambdas = replace(lambdas, lam_motor=self._lam_motor, b=self._b)
        point = self.points[entry]
        process_q, process_S = self._processes[entry]
        lam_q_min, lam_S_min = self.safe_range()
        q = position_gains(self._parameters, point, lambdas)
        S = stiffness_gains(self._parameters, point, lambdas)
        held = (point.S_nominal, point.S_nominal)
        step = self._simulated(lambdas, point, (0.0, STEP_Q), held, lambdas.lam_q, u_plan)
        return Preview(
            self._motor_robustness,
            _loop_preview(process_q, q, position_process(self._parameters, point), lambdas.lam_q, lam_q_min),
            _loop_preview(process_S, S, stiffness_process(self._parameters, point), lambdas.lam_S, lam_S_min),
            step,
        )

    def sensitivity(self, lambdas: Lambdas) -> tuple[float, float]:
        """Sensitivity peaks M_s of the loops of q and S, each the largest of all points of the bank."""
        lambdas = replace(lambdas, lam_motor=self._lam_motor, b=self._b)
        return (
            max(
                process.sensitivity_peak(position_gains(self._parameters, point, lambdas))
                for point, (process, _) in zip(self.points, self._processes, strict=True)
            ),
            max(
                process.sensitivity_peak(stiffness_gains(self._parameters, point, lambdas))
                for point, (_, process) in zip(self.points, self._processes, strict=True)
            ),
        )

    def lambdas_for(self, M_s: float) -> dict[str, float | TuningError]:
        """Smallest λ [s] by name with which each loop, at every point of the bank, keeps its sensitivity peak at M_s.

        Where no λ that is offered does, the error that says why. lam_q and lam_S are for λ_motor as it is.
        """
        lam_q_min, lam_S_min = self.safe_range()

        def position() -> float:
            lam = max(self._robust_q(entry, M_s) for entry in range(len(self.points)))
            return _within_offer("λ_q", lam, lam_q_min, M_s)

        def stiffness() -> float:
            lam = max(self._robust_S(entry, M_s) for entry in range(len(self.points)))
            return _within_offer("λ_S", lam, lam_S_min, M_s)

        def inner() -> float:
            return max(motor_lambda(known, M_s) for known in self._motors)

        return {"lam_motor": _found(inner), "lam_q": _found(position), "lam_S": _found(stiffness)}

    def _safe_ranges(self, entry: int) -> tuple[float, float]:
        point = self.points[entry]
        S, u_max = point.S_nominal, self._parameters.motor.u_max

        def voltage_q(lam: float) -> float:
            return self._simulated(self._lambdas(lam_q=lam), point, (-STEP_Q, STEP_Q), (S, S), lam).peak_voltage

        def voltage_S(lam: float) -> float:
            return self._simulated(self._lambdas(lam_S=lam), point, (0.0, 0.0), STEP_S, lam).peak_voltage

        return (
            _unsaturated(self._robust_q(entry), voltage_q, u_max),
            _unsaturated(self._robust_S(entry), voltage_S, u_max),
        )

    def _robust_q(self, entry: int, M_s: float = M_S_MAX) -> float:
        parameters, point = self._parameters, self.points[entry]
        return safe_lambda(
            self._processes[entry][0], lambda lam: position_gains(parameters, point, Lambdas(lam_q=lam)), M_s
        )

    def _robust_S(self, entry: int, M_s: float = M_S_MAX) -> float:
        parameters, point = self._parameters, self.points[entry]
        return safe_lambda(
            self._processes[entry][1], lambda lam: stiffness_gains(parameters, point, Lambdas(lam_S=lam)), M_s
        )

    def _lambdas(self, **chosen: float) -> Lambdas:
        return Lambdas(lam_motor=self._lam_motor, b=self._b, **chosen)

    def _simulated(
        self,
        lambdas: Lambdas,
        point: PointModel,
        q_step: tuple[float, float],
        S_step: tuple[float, float],
        lam: float,
        u_plan: float = 0.0,
    ) -> SimulatedStep:
        """Simulate steps from the first to the second reference, for 6 λ and more."""
        tuning = cascade_tuning(self._parameters, lambdas, [point], self._motor, u_plan=u_plan)
        ticks = 100, round((0.9 + 6.0 * lam) / T_s)
        trajectory = run(self._parameters, tuning, np.repeat(q_step, ticks), np.repeat(S_step, ticks))
        voltage = np.nanmax(np.abs([trajectory.u_A, trajectory.u_B]))
        far = q_step[1] - q_step[0]
        there = np.sign(far) * (trajectory.q[ticks[0] :] - q_step[0]) >= 0.9 * abs(far)
        rise_s = float(np.argmax(there)) * T_s if far and there.any() else np.nan
        return SimulatedStep(float(voltage), float(np.nanmin([trajectory.F_A, trajectory.F_B])), rise_s)


def _found(search: Callable[[], float]) -> float | TuningError:
    try:
        return search()
    except TuningError as error:
        return error


def _within_offer(name: str, lam: float, least: float, M_s: float) -> float:
    if lam < least:
        raise TuningError(
            f"M_s = {M_s:g} would take {name} = {lam:.3f} s, and what is offered begins at {least:.3f} s: "
            "choose a smaller M_s"
        )
    return lam


def _unsaturated(robust: float, voltage: Callable[[float], float], u_max: float) -> float:
    """Smallest λ [s], from ``robust`` on, whose peak ``voltage`` [V] stays below u_max [V]. Raises TuningError."""
    if voltage(robust) < u_max:
        return robust
    if voltage(LAM_MAX) >= u_max:
        raise TuningError(f"even λ = {LAM_MAX:g} s takes all of {u_max:g} V: check K_m, T_m and u_max")
    low, high = robust, LAM_MAX
    while high - low > LAM_RESOLUTION:
        middle = 0.5 * (low + high)
        low, high = (low, middle) if voltage(middle) < u_max else (middle, high)
    return high


def _loop_preview(
    process: OuterProcess, gains: i_p.Gains, first_order: tuple[float, float], lam: float, lam_min: float
) -> LoopPreview:
    t = np.linspace(0.0, 8.0 * lam, _POINTS)
    printed = printed_outer_gains(*first_order, lam)
    return LoopPreview(
        process.robustness(gains),
        lam_min,
        LAM_MAX,
        t,
        _step(process, gains, t),
        process.robustness(printed),
        _step(process, printed, t),
    )


def _step(process: OuterProcess, gains: i_p.Gains, t: NDArray[np.float64]) -> NDArray[np.float64]:
    import control

    return np.asarray(control.step_response(process.closed_loop(gains), t).outputs)
