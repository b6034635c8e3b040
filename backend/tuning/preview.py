"""Preview of a tuning: range of λ, voltage limit, simulated steps and pushes."""

import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache, partial
from typing import Any

import numpy as np

from backend.control import build_decoupler, cascade, compute_bounds, decoupler, pid
from backend.errors import check_range
from backend.tuning import messages
from backend.tuning.gains import (
    LAM_MAX,
    MotorModel,
    PointModel,
    TuningError,
    TuningParameters,
    collect_plant_knowledge,
    designed_point,
    make_cascade_tuning,
    make_motor_loops,
    motor_gains,
    motor_model,
    position_gains,
    position_process,
    printed_outer_gains,
    rejection,
    stiffness_gains,
    stiffness_process,
)
from backend.tuning.robustness import (
    M_S_MAX,
    OuterProcess,
    Robustness,
    cached,
    common_lambda_range,
    decoupled_model,
    motor_lambda,
    motor_robustness,
    safe_lambda,
)
from backend.tuning.simulation import (
    PUSH_N,
    PushForecast,
    Sampled,
    SimulatedRig,
    StepForecast,
    expected_plant,
    forecast_push,
    held_plant,
    make_simulated_rig,
    simulate_cascade,
    step_forecast,
)
from plant import SIDES, PlantParameters, T_s, find_root

# Voltage limit -------------------------------------------------------------------------------------
# Voltage limit of time-optimal motion: the remaining voltage is reserved for load, friction and feedback.


LEAST, MOST, USUAL = 0.2, 0.9, 0.85
"""Fractions of the output range: least and largest permitted, and the default."""


def plan_range(parameters: PlantParameters) -> tuple[float, float]:
    """Return the smallest and largest permitted voltage limit [V]."""
    u_max = parameters.motor.u_max
    return round(LEAST * u_max, 3), round(MOST * u_max, 3)


def usual_budget(parameters: PlantParameters) -> float:
    """Return the default voltage limit [V]."""
    return round(USUAL * parameters.motor.u_max, 3)


def require_budget(parameters: PlantParameters, u_plan: float) -> None:
    """Raise OutOfRangeError unless ``u_plan`` [V] is permitted.

    0 V is ``lambda`` motion, which has no limit.
    """
    if u_plan != 0.0:
        check_range("u_plan", u_plan, *plan_range(parameters), "V", messages.remedy_for_u_plan())


# Preview -------------------------------------------------------------------------------------------
# Effect of a tuning before it is applied: robustness on the high-order model, simulated steps.
#
# It applies to one stiffness, that of the current reference, and to the active motion: in `lambda` a step takes the
# time that λ gives, in `time-optimal` that of its trajectory.


STEP_Q = np.pi / 3.0
"""Default step of q_ref in the preview [rad]: half of the paper's largest."""

SHOWN_STEP_S = 2.0
"""Default step of S_ref in the preview [N·m/rad]: up, or down near the end of the range."""

STEP_S = (8.0, 14.0)
"""Step of S_ref that must stay within the voltage [N·m/rad]: the pulses of the paper."""

LAM_RESOLUTION = 1e-3
"""Resolution of the end of the range if the voltage limits it [s]."""

Job = Callable[[], object]

_CACHED_STIFFNESSES = 32
"""Number of stiffnesses with cached high-order models: making one takes longer than the rest of a preview."""


@dataclass(frozen=True)
class Steps:
    """Steps of q_ref [rad] and S_ref [N·m/rad], from the first to the second value.

    Each reference steps alone, while the other one is constant.
    """

    q: tuple[float, float]
    S: tuple[float, float]


@dataclass(frozen=True)
class OuterLoopPreview:
    """One outer loop: its robustness and the permitted range of λ [s].

    ``printed``: the printed formula of table 2 (erratum E1) with its step in ``lambda`` motion; None if not requested.
    """

    robustness: Robustness
    lam_min: float
    lam_max: float
    printed: "Printed | None"


@dataclass(frozen=True)
class Printed:
    """The loop with the printed formula.

    ``step`` is None if λ does not form the steps.
    """

    robustness: Robustness
    step: StepForecast | None


@dataclass(frozen=True)
class Preview:
    """All loops at stiffness ``S`` [N·m/rad], a step of each reference, and pushes.

    ``pushes`` has one forecast per rejection gain. ``motor``: the less robust of the two motor loops.
    """

    S: float
    motor: Robustness
    position: OuterLoopPreview
    stiffness: OuterLoopPreview
    step_q: StepForecast
    step_S: StepForecast
    pushes: tuple[PushForecast, ...]


class TuningPreviewer:
    """Previews at the operating points of a bank.

    Caches the high-order models, which depend only on λ_motor and the point. ``b`` affects the range if the voltage
    limits it: an immediate proportional response to the reference takes more voltage. ``ranges``: the smallest lam_q
    and lam_S [s] of each point, if known. Raises OutOfRangeError for a ``lam_motor`` [s] out of range.
    """

    def __init__(
        self,
        parameters: PlantParameters,
        points: Sequence[PointModel] = (),
        motor: MotorModel | None = None,
        lam_motor: float = TuningParameters().lam_motor,
        b: float = 0.0,
        ranges: Sequence[tuple[float, ...]] | None = None,
    ) -> None:
        self._parameters = parameters
        self._motor = motor
        self._motors = [motor] if motor else [motor_model(parameters, side) for side in SIDES]
        check_range("lam_motor", lam_motor, *self.motor_range(), "s")
        self.points = sorted(points or (designed_point(parameters, lam_motor),), key=lambda point: point.S_nominal)
        self._lam_motor, self._b = lam_motor, b
        self._models_at = lru_cache(_CACHED_STIFFNESSES)(self._new_models)
        self.ranges = ranges or [
            cached(("outer ranges", parameters, motor, point, lam_motor, b), 2, partial(self._safe_ranges, entry))
            for entry, point in enumerate(self.points)
        ]

    @cached_property
    def _processes(self) -> list[tuple[OuterProcess, OuterProcess]]:
        """Processes of the outer loops of q and S, by point."""
        return [self._models_at(point.S_nominal)[:2] for point in self.points]

    def _new_models(self, S: float) -> tuple[OuterProcess, OuterProcess, Sampled]:
        """Return the outer processes of q and S at S [N·m/rad], and the sampled plant."""
        gains = make_motor_loops(self._parameters, self._lam_motor, self._motor)
        model = decoupled_model(self._parameters, gains, S)
        held = held_plant(self._parameters, build_decoupler(self._parameters), S)
        return OuterProcess(model[0, 0]), OuterProcess(model[1, 1]), held

    @cached_property
    def _expected(self) -> tuple[PlantParameters, SimulatedRig]:
        """The simulated plant."""
        plant = expected_plant(self._parameters)
        return plant, make_simulated_rig(plant)

    @cached_property
    def _motor_robustness(self) -> Robustness:
        return self.motor_at(self._lam_motor)

    def safe_range(self) -> tuple[float, float]:
        """Return the smallest permitted lam_q and lam_S [s].

        With them, all points of the bank are robust and the voltage is not clipped.
        """
        return max(q for q, _ in self.ranges), max(S for _, S in self.ranges)

    def motor_range(self) -> tuple[float, float]:
        """Return the smallest and largest permitted lam_motor [s] for both motors.

        Raises TuningError.
        """
        return common_lambda_range(self._motors)

    def is_for(self, lam_motor: float, b: float) -> bool:
        """Return whether models and ranges are those of this λ_motor [s] and weight b."""
        return (self._lam_motor, self._b) == (lam_motor, b)

    def motor_at(self, lam_motor: float) -> Robustness:
        """Return the robustness of the less robust motor loop.

        Raises OutOfRangeError for a λ out of range.
        """
        check_range("lam_motor", lam_motor, *self.motor_range(), "s")
        loops = [motor_robustness(motor, motor_gains(motor.K_m, motor.T_m, lam_motor)) for motor in self._motors]
        return max(loops, key=lambda loop: loop.M_s)

    def plan_range(self) -> tuple[float, float]:
        """Return the smallest and largest permitted voltage limit [V], apart from 0."""
        return plan_range(self._parameters)

    def require_safe(self, lambdas: TuningParameters, u_plan: float = 0.0) -> None:
        """Raise OutOfRangeError unless both λ and the voltage limit [V] are permitted."""
        require_budget(self._parameters, u_plan)
        lam_q_min, lam_S_min = self.safe_range()
        remedy = messages.remedy_for_lambda()
        check_range("lam_q", lambdas.lam_q, minimum=lam_q_min, maximum=LAM_MAX, unit="s", remedy=remedy)
        check_range("lam_S", lambdas.lam_S, minimum=lam_S_min, maximum=LAM_MAX, unit="s", remedy=remedy)

    def steps_at(self, S: float) -> Steps:
        """Return the default steps, from q = 0 and S [N·m/rad]."""
        up = compute_bounds(self._parameters).S_max >= S + SHOWN_STEP_S
        return Steps((0.0, STEP_Q), (S, S + (SHOWN_STEP_S if up else -SHOWN_STEP_S)))

    def preview(
        self,
        lambdas: TuningParameters,
        S: float | None = None,
        entry: float = -1.0,
        *,
        interpolate: bool = False,
        u_plan: float = 0.0,
        shares: Sequence[float] = (0.0,),
        steps: Steps | None = None,
        F_push: float = PUSH_N,
        printed: bool = False,
        each: Callable[[Callable[[Job], object], Iterable[Job]], Iterable[object]] = map,
    ) -> Preview:
        """Return the preview at S [N·m/rad] (default: the first point's).

        The motion is the one that ``u_plan`` [V] selects. ``entry``: the active one, −1 for the one nearest to S;
        ``shares`` [1]: gains of the disturbance rejection; ``steps``: by default those of ``steps_at``; ``F_push`` [N];
        ``printed``: include the printed formula; ``each``: ``map``, or a parallel one, as compiled simulations release
        the GIL. Raises TuningError for a λ without gains.
        """
        lambdas = replace(lambdas, lam_motor=self._lam_motor, b=self._b)
        S = self.points[0].S_nominal if S is None else S
        steps = steps or self.steps_at(S)
        tuning = make_cascade_tuning(
            parameters=self._parameters,
            lambdas=lambdas,
            points=self.points,
            motor=self._motor,
            interpolate=interpolate,
            u_plan=u_plan,
        )
        plant_model = collect_plant_knowledge(self._parameters)
        active = decoupler.select_entry(tuning.schedule, entry, S)
        gains = decoupler.interpolate_gains(tuning.schedule, active)
        process_q, process_S, held = self._models_at(S)
        processes = process_q, process_S
        plant, rig = self._expected

        def compute_step_forecast(number: int, tuning: cascade.CascadeTuning) -> StepForecast:
            lam = (lambdas.lam_q, lambdas.lam_S)[number]
            seconds = 2.0 + (3.0 if u_plan else 9.0) * lam
            q, S_ref = ((steps.q, (S, S)), ((steps.q[0], steps.q[0]), steps.S))[number]
            return step_forecast(plant=plant, tuning=tuning, q=q, S=S_ref, seconds=seconds, entry=active, rig=rig)

        def compute_push_forecast(share: float) -> PushForecast:
            rejecting = tuning._replace(disturbance_feedforward=rejection(plant_model, tuning.motors, share))
            return forecast_push(
                self._parameters, rejecting, S, lambdas.lam_q, F_push, entry=active, rig=rig, held=held
            )

        def printed_loop(number: int) -> Printed:
            as_printed = self._printed_gains(lambdas)[round(active)][number]
            step = None if u_plan else compute_step_forecast(number, self._with_printed(tuning, lambdas))
            return Printed(processes[number].robustness(as_printed), step)

        jobs: list[Job] = [partial(compute_step_forecast, 0, tuning), partial(compute_step_forecast, 1, tuning)]
        jobs += [partial(compute_push_forecast, share) for share in shares]
        jobs += [partial(printed_loop, number) for number in (0, 1) if printed]
        done: Iterator[Any] = iter(each(_do, jobs))
        step_q, step_S = next(done), next(done)
        pushes = tuple(next(done) for _ in shares)
        position, stiffness = (
            OuterLoopPreview(process.robustness(k), lam_min, LAM_MAX, next(done, None))
            for process, k, lam_min in zip(processes, gains, self.safe_range(), strict=True)
        )
        return Preview(
            S=S,
            motor=self._motor_robustness,
            position=position,
            stiffness=stiffness,
            step_q=step_q,
            step_S=step_S,
            pushes=pushes,
        )

    def _printed_gains(self, lambdas: TuningParameters) -> list[tuple[pid.IPGains, pid.IPGains]]:
        """Return the gains of the printed formula for the loops of q and S, by point."""
        return [
            (
                printed_outer_gains(*position_process(self._parameters, point), lambdas.lam_q),
                printed_outer_gains(*stiffness_process(self._parameters, point), lambdas.lam_S),
            )
            for point in self.points
        ]

    def _with_printed(self, tuning: cascade.CascadeTuning, lambdas: TuningParameters) -> cascade.CascadeTuning:
        entries = tuning.schedule.entries.copy()
        for row, (q, S) in zip(entries, self._printed_gains(lambdas), strict=True):
            row[1:] = q.k_p, q.k_i, q.k_r, S.k_p, S.k_i, S.k_r
        return tuning._replace(schedule=tuning.schedule._replace(entries=entries))

    def lambdas_for(self, M_s: float) -> dict[str, float | TuningError]:
        """Return the smallest λ [s] by name that keeps each loop's sensitivity peak within M_s.

        This applies to every point of the bank. If no permitted λ does so, the value is the error with the reason.
        lam_q and lam_S are for the current λ_motor.
        """
        lam_q_min, lam_S_min = self.safe_range()

        def position() -> float:
            lam = max(self._robust_q(entry, M_s) for entry in range(len(self.points)))
            return _within_offer("λ_q", lam, lam_q_min, M_s)

        def stiffness() -> float:
            lam = max(self._robust_S(entry, M_s) for entry in range(len(self.points)))
            return _within_offer("λ_S", lam, lam_S_min, M_s)

        def inner() -> float:
            return max(motor_lambda(motor, M_s) for motor in self._motors)

        return {
            "lam_motor": _search_or_error(inner),
            "lam_q": _search_or_error(position),
            "lam_S": _search_or_error(stiffness),
        }

    def _safe_ranges(self, entry: int) -> tuple[float, float]:
        point = self.points[entry]
        S, u_max = point.S_nominal, self._parameters.motor.u_max

        def voltage_q(lam: float) -> float:
            return self._peak_voltage(self._lambdas(lam_q=lam), point, (-STEP_Q, STEP_Q), (S, S), lam)

        def voltage_S(lam: float) -> float:
            return self._peak_voltage(self._lambdas(lam_S=lam), point, (0.0, 0.0), STEP_S, lam)

        return (
            _find_unsaturated_lambda(self._robust_q(entry), voltage_q, u_max),
            _find_unsaturated_lambda(self._robust_S(entry), voltage_S, u_max),
        )

    def _robust_q(self, entry: int, M_s: float = M_S_MAX) -> float:
        parameters, point = self._parameters, self.points[entry]
        return safe_lambda(
            self._processes[entry][0], lambda lam: position_gains(parameters, point, TuningParameters(lam_q=lam)), M_s
        )

    def _robust_S(self, entry: int, M_s: float = M_S_MAX) -> float:
        parameters, point = self._parameters, self.points[entry]
        return safe_lambda(
            self._processes[entry][1], lambda lam: stiffness_gains(parameters, point, TuningParameters(lam_S=lam)), M_s
        )

    def _lambdas(self, **chosen: float) -> TuningParameters:
        return TuningParameters(lam_motor=self._lam_motor, b=self._b, **chosen)

    def _peak_voltage(
        self,
        lambdas: TuningParameters,
        point: PointModel,
        q_step: tuple[float, float],
        S_step: tuple[float, float],
        lam: float,
    ) -> float:
        """Simulate steps between references for at least 6 λ; return the peak voltage [V]."""
        tuning = make_cascade_tuning(self._parameters, lambdas, [point], self._motor)
        ticks = 100, round((0.9 + 6.0 * lam) / T_s)
        trajectory = simulate_cascade(self._parameters, tuning, np.repeat(q_step, ticks), np.repeat(S_step, ticks))
        return float(np.nanmax(np.abs([trajectory.u_A, trajectory.u_B])))


def _do(job: Job) -> object:
    return job()


def _search_or_error(search: Callable[[], float]) -> float | TuningError:
    try:
        return search()
    except TuningError as error:
        return error


def _within_offer(symbol: str, lam: float, least: float, M_s: float) -> float:
    if lam < least:
        raise TuningError(messages.M_s_needs_smaller_lambda(M_s=M_s, symbol=symbol, lam=lam, minimum_s=least))
    return lam


def _find_unsaturated_lambda(robust: float, voltage: Callable[[float], float], u_max: float) -> float:
    """Return the smallest λ [s] >= ``robust`` with ``voltage`` [V] below u_max [V].

    Raises TuningError.
    """
    if voltage(robust) < u_max:
        return robust
    if voltage(LAM_MAX) >= u_max:
        raise TuningError(messages.step_saturates(maximum_s=LAM_MAX, u_max=u_max))
    low, high = robust, LAM_MAX
    while high - low > LAM_RESOLUTION:
        middle = 0.5 * (low + high)
        low, high = (low, middle) if voltage(middle) < u_max else (middle, high)
    return high


# Speed bound ---------------------------------------------------------------------------------------
# Limit of a position step's speed by the motors' speed and acceleration, for any control law.


def least_reach_time(parameters: PlantParameters, step: float, share: float = 0.9) -> float:
    """Return the time [s] in which the motors can turn the joint by a part of a step.

    The part is the ``share`` of a ``step`` [rad], unloaded at full voltage. A motor at rest under u_max turns by K_m
    u_max (t − T_m (1 − exp(−t/T_m))) (equation 17); the slower motor counts, and it need not stop. Both reels turn
    r_j/r_m times as far as the joint (equations 18, 19).
    """
    g = parameters.geometry
    turn = share * abs(step) * g.r_j / g.r_m
    motors = [motor_model(parameters, side) for side in SIDES]
    return max(_time(turn, parameters.motor.u_max * motor.K_m, motor.T_m) for motor in motors)


def _time(turn: float, speed: float, T_m: float) -> float:
    if turn == 0.0:
        return 0.0

    def compute_remaining(t: float) -> float:
        return speed * (t - T_m * (1.0 - math.exp(-t / T_m))) - turn

    return find_root(compute_remaining, 0.0, turn / speed + T_m)
