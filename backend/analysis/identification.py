"""Estimates models from the samples of identification runs and builds the records to store."""

import hashlib
import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass

import numpy as np
from numpy.typing import NDArray

from backend.analysis import messages
from backend.analysis.step_metrics import NoSamplesError, declare_metric
from backend.control import build_decoupler, stiffness_slope
from backend.experiments import (
    ActuatorIdentificationPlan,
    MotorIdentificationPlan,
    SpringIdentificationPlan,
    parse_stored_plan,
)
from backend.identification import (
    COLUMNS,
    ActuatorGeometry,
    ActuatorIdentification,
    Candidates,
    DataFileError,
    DecimalMark,
    Estimate,
    FileFault,
    Grade,
    IdentificationError,
    LoadFrictionResult,
    Method,
    MotorIdentification,
    RecordError,
    SpringIdentification,
    TensionRun,
    VoltageStepRecord,
    estimate_load_friction,
    identify_motor,
    identify_spring,
    joint_method_name,
    not_utf_8,
    read_load_sweep,
    steady_speed,
    turn_from_rest,
)
from backend.identification import identify_actuator as estimate_actuator
from backend.models import (
    ACTUATOR_MODEL,
    ACTUATOR_QUALITY,
    MOTOR_MODELS,
    MOTOR_QUALITIES,
    SPRING_MODELS,
    SPRING_QUALITIES,
    ActuatorModel,
    ActuatorQuality,
    ArxEstimate,
    ChannelModel,
    ChannelQuality,
    Document,
    FailedCandidate,
    IdentifiedMotor,
    MissingArxEstimate,
    MotorConstants,
    MotorFit,
    MotorModels,
    MotorQualities,
    MotorQuality,
    RefusedStep,
    SpringModel,
    SpringModels,
    SpringQualities,
    SpringQuality,
    StepRuleEstimate,
    StoredSpringFit,
    StoredStepCurve,
    TableReading,
    TriedStructure,
    UnreadableDocumentError,
)
from backend.plain_text import PlainTextError, check_plain_text, check_single_line
from backend.realtime import Excitation
from backend.recording import Columns, count_missing_ticks, read_recorded_columns
from backend.storage import Database, EndState, NewIdentification, Run, RunKind
from plant import (
    SIDES,
    Message,
    PlantParameters,
    Side,
    T_s,
)

# Actuator identification ---------------------------------------------------------------------------


ActuatorColumns = Mapping[str, NDArray[np.float64]]

_COUNTS_WHERE_EXACT = 4000, 8000
"""Counts per turn of the paper's encoders, used for parameter sets with ideal sensors."""


@dataclass(frozen=True)
class ActuatorMetrics:
    """Loads of the actuator during the excitation."""

    motion_counts: float = declare_metric(
        "1", "Joint motion", "peak-to-peak motion during the excitation, in encoder counts"
    )
    min_tension_N: float = declare_metric(
        "N", "Smallest tension", "smallest reading of both load cells during the excitation"
    )
    max_tension_N: float = declare_metric(
        "N", "Largest tension", "largest reading of both load cells during the excitation"
    )
    peak_voltage_V: float = declare_metric("V", "Peak voltage", "largest |u_A|, |u_B| during the excitation")


def find_excitation_start(columns: ActuatorColumns, excitation: Excitation) -> int:
    """Return the index of the first excited sample of a complete run.

    The duration of the motion to the operating point varies, so the excitation is located from the end of the run.
    Raises NoSamplesError if there are fewer samples than the excitation has.
    """
    chip_ticks = max(round(excitation.chip_s / T_s), 1)
    ticks = excitation.periods * len(excitation.levels) * chip_ticks
    start = columns["t"].size - ticks
    if start < 0:
        raise NoSamplesError(messages.fewer_samples_than_excitation(samples=columns["t"].size, needed=ticks))
    return start


def identify_actuator(
    columns: ActuatorColumns, excitation: Excitation, parameters: PlantParameters, method: Method = Method.DEFAULT
) -> ActuatorIdentification:
    """Estimate G_q and G_S from theta_A_ref, q and S of a completed run. Raises NoSamplesError, ValueError."""
    geometry, sensors = parameters.geometry, parameters.sensors
    q_counts, theta_counts = _COUNTS_WHERE_EXACT
    slope = stiffness_slope(build_decoupler(parameters), float(np.mean(columns["S"])))
    known = ActuatorGeometry(
        geometry.r_m,
        geometry.r_j,
        slope / (2.0 * geometry.r_j**2 * geometry.r_m),
        round(sensors.joint_counts) or q_counts,
        round(sensors.motor_counts) or theta_counts,
    )
    return estimate_actuator(columns, T_s, known, find_excitation_start(columns, excitation), method=method)


def compute_actuator_metrics(
    columns: ActuatorColumns, excitation: Excitation, estimate: ActuatorIdentification
) -> ActuatorMetrics:
    """Return the metrics of an actuator identification."""
    excited = slice(find_excitation_start(columns, excitation), None)
    tensions = np.concatenate([columns[name][excited] for name in ("F_A", "F_B")])
    voltages = np.concatenate([columns[name][excited] for name in ("u_A", "u_B")])
    return ActuatorMetrics(
        motion_counts=estimate.motion_counts,
        min_tension_N=float(tensions.min()),
        max_tension_N=float(tensions.max()),
        peak_voltage_V=float(np.abs(voltages).max()),
    )


def build_actuator_record(
    run: Run,
    plan: ActuatorIdentificationPlan,
    columns: ActuatorColumns,
    estimate: ActuatorIdentification,
    software: str,
) -> NewIdentification:
    """Return the record to store: model, quality, and the samples that it was estimated from."""
    start = find_excitation_start(columns, plan.excitation())
    signals = {"input": "theta_A_ref", "outputs": ["q", "S"]}
    channels = {"G_q": estimate.G_q, "G_S": estimate.G_S}
    return NewIdentification(
        kind="actuator",
        run_id=run.id,
        data={**signals, "first_sample": start, "samples": columns["t"].size - start, "period_s": T_s},
        method=joint_method_name({name: channel.method for name, channel in channels.items()}),
        options={**asdict(plan), "structures": {name: channel.model.structure for name, channel in channels.items()}},
        model=ACTUATOR_MODEL.write(
            ActuatorModel(
                S_nominal=estimate.S_nominal,
                q_nominal=estimate.q_nominal,
                G_q=_actuator_model(estimate.G_q),
                G_S=_actuator_model(estimate.G_S),
            )
        ),
        quality=ACTUATOR_QUALITY.write(
            ActuatorQuality(
                motion_counts=estimate.motion_counts,
                G_q=_actuator_quality(estimate.G_q, estimate.candidates_q, estimate.arx_q),
                G_S=_actuator_quality(estimate.G_S, estimate.candidates_S, estimate.arx_S),
            )
        ),
        usable=estimate.verdict.grade is not Grade.UNUSABLE,
        verdict=estimate.verdict.sentence,
        who=run.who,
        software=software,
    )


def _actuator_model(channel: Estimate) -> ChannelModel:
    return ChannelModel(
        structure=channel.model.structure,
        parameters=channel.model.parameters,
        std_errors=dict(channel.std_errors),
        covariance=tuple(tuple(row) for row in channel.covariance.tolist()),
        noise=channel.noise,
        method=channel.method,
        first_order=channel.first_order,
    )


def _actuator_quality(channel: Estimate, candidates: Candidates, arx: Estimate | str) -> ChannelQuality:
    return ChannelQuality(
        fit_percent=channel.fit_percent,
        fit_all_percent=channel.fit_all_percent,
        gain_geometry=channel.gain_geometry,
        gain_error_percent=channel.gain_error_percent,
        y_resolution=channel.y_resolution,
        residuals=channel.residuals,
        frequency=channel.frequency,
        usable=channel.verdict.grade is not Grade.UNUSABLE,
        grade=channel.verdict.grade,
        verdict=channel.verdict.sentence,
        candidates=_summarize_candidates(candidates),
        arx=_summarize_arx(arx),
    )


def _summarize_arx(found: Estimate | str) -> ArxEstimate | MissingArxEstimate:
    """Return the estimate of the paper's method on the same record, or the reason for none."""
    if isinstance(found, str):
        return MissingArxEstimate(found)
    return ArxEstimate(method=found.method, fit_percent=found.fit_percent, **asdict(found.first_order))


def _summarize_candidates(candidates: Candidates) -> tuple[TriedStructure | FailedCandidate, ...]:
    """Return a summary of all tried structures, best first, then those that failed."""
    ranked = [
        TriedStructure(
            structure=candidate.model.structure,
            parameters=candidate.model.parameters,
            K=candidate.first_order.K,
            T=candidate.first_order.T,
            fit_percent=candidate.fit_percent,
            BIC=candidate.residuals.BIC,
            grade=candidate.verdict.grade,
        )
        for candidate in candidates.ranked
    ]
    return (*ranked, *(FailedCandidate(name, problem) for name, problem in candidates.failed.items()))


# Motor identification ------------------------------------------------------------------------------
# K_m, T_m and Coulomb friction of both motors from voltage steps.


Array = NDArray[np.float64]
MotorColumns = Mapping[str, Array]

MOTOR_COUNTS_WHERE_EXACT = 8000
"""Counts per turn of the paper's motor encoder, used for parameter sets with ideal sensors."""

_MOTOR_CURVE_POINTS = 120


@dataclass(frozen=True)
class SideSteps:
    """Usable steps of one motor, and the rejected ones: (voltage [V], reason)."""

    steps: tuple[VoltageStepRecord, ...]
    refused: tuple[tuple[float, str], ...]


@dataclass(frozen=True)
class MotorMetrics:
    """Estimates of both motors, and their loads."""

    K_m_A: float = declare_metric("rad/(V·s)", "K_m of motor A", "least-squares fit of the position over all steps")
    K_m_B: float = declare_metric("rad/(V·s)", "K_m of motor B", "least-squares fit of the position over all steps")
    T_m_A: float = declare_metric("s", "T_m of motor A", "least-squares fit of the position over all steps")
    T_m_B: float = declare_metric("s", "T_m of motor B", "least-squares fit of the position over all steps")
    u_c_A: float = declare_metric("V", "Coulomb voltage of motor A", "voltage that overcomes Coulomb friction")
    u_c_B: float = declare_metric("V", "Coulomb voltage of motor B", "voltage that overcomes Coulomb friction")
    turn_rad: float = declare_metric("rad", "Largest rotation", "largest |θ| of both motors")
    load_N: float = declare_metric("N", "Largest load", "largest of F_A and F_B during the steps")
    peak_voltage_V: float = declare_metric("V", "Peak voltage", "largest voltage step of both motors")


def find_open_loop_intervals(columns: MotorColumns) -> list[slice]:
    """Return the intervals without position loop: zero volts, a step, braking."""
    open_loop = np.isnan(columns["theta_A_ref"])
    edges = np.flatnonzero(np.diff(np.concatenate(([False], open_loop, [False])).astype(int)))
    return [slice(int(first), int(end)) for first, end in zip(edges[::2], edges[1::2], strict=True)]


def extract_side_steps(columns: MotorColumns, side: Side, parameters: PlantParameters) -> SideSteps:
    """Return the steps of one motor in a run, with reasons for unusable ones.

    Raises NoSamplesError for a run without steps.
    """
    steps: list[VoltageStepRecord] = []
    refused: list[tuple[float, str]] = []
    for interval in find_open_loop_intervals(columns):
        u = columns[f"u_{side}"][interval]
        driven = np.flatnonzero(u)
        if not driven.size:
            continue
        voltage, first = float(u[driven[0]]), int(driven[0])
        changed = np.flatnonzero(u[first:] != u[first])
        end = first + int(changed[0]) if changed.size else u.size
        try:
            steps.append(
                VoltageStepRecord(
                    period_s=T_s,
                    u=u[:end],
                    theta=columns[f"theta_{side}"][interval][:end],
                    u_max=parameters.select_motor(side).u_max,
                    count_rad=_compute_count_rad(parameters),
                    tension_N=columns[f"F_{side}"][interval][:end],
                )
            )
        except RecordError as error:
            refused.append((voltage, error.message))
    if not steps and not refused:
        raise NoSamplesError(messages.no_voltage_step())
    return SideSteps(tuple(steps), tuple(refused))


def identify_motors(
    columns: MotorColumns, parameters: PlantParameters
) -> dict[Side, tuple[SideSteps, MotorIdentification]]:
    """Identify both motors. Raises NoSamplesError, or ValueError with the motor."""
    found: dict[Side, tuple[SideSteps, MotorIdentification]] = {}
    for side in SIDES:
        cut = extract_side_steps(columns, side, parameters)
        try:
            found[side] = cut, identify_motor(cut.steps)
        except IdentificationError as error:
            unusable = tuple(reason for _, reason in cut.refused)
            raise ValueError(
                messages.motor_not_identified(side=side, reason=error.message, unusable_steps=unusable)
            ) from None
    return found


def compute_motor_metrics(
    columns: MotorColumns, found: Mapping[Side, tuple[SideSteps, MotorIdentification]]
) -> MotorMetrics:
    """Return the metrics of a motor identification."""
    driven = find_open_loop_intervals(columns)
    A, B = (found[side][1] for side in SIDES)
    return MotorMetrics(
        K_m_A=A.K_m,
        K_m_B=B.K_m,
        T_m_A=A.T_m,
        T_m_B=B.T_m,
        u_c_A=A.u_c,
        u_c_B=B.u_c,
        turn_rad=max(float(np.abs(columns[f"theta_{side}"]).max()) for side in SIDES),
        load_N=max(float(columns[f"F_{side}"][interval].max()) for side in SIDES for interval in driven),
        peak_voltage_V=max(abs(step.voltage) for side in SIDES for step in found[side][0].steps),
    )


def build_motor_record(
    run: Run,
    plan: MotorIdentificationPlan,
    found: Mapping[Side, tuple[SideSteps, MotorIdentification]],
    parameters: PlantParameters,
    software: str,
) -> NewIdentification:
    """Return the record to store: models, quality, and the samples that they were estimated from."""
    verdicts = {side: result.verdict for side, (_, result) in found.items()}
    return NewIdentification(
        kind="motor",
        run_id=run.id,
        data={"input": "u", "outputs": ["theta_A", "theta_B"], "period_s": T_s},
        method=messages.least_squares_on_position(),
        options=asdict(plan),
        model=MOTOR_MODELS.write(
            MotorModels(A=_motor_model(found["A"][1], parameters, "A"), B=_motor_model(found["B"][1], parameters, "B"))
        ),
        quality=MOTOR_QUALITIES.write(MotorQualities(A=_motor_quality(*found["A"]), B=_motor_quality(*found["B"]))),
        usable=all(verdict.grade is not Grade.UNUSABLE for verdict in verdicts.values()),
        verdict=" ".join(
            messages.verdict_of_motor(side=side, verdict=verdict.sentence) for side, verdict in verdicts.items()
        ),
        who=run.who,
        software=software,
    )


def _motor_model(result: MotorIdentification, parameters: PlantParameters, side: Side) -> IdentifiedMotor:
    known = parameters.select_identified(side)
    return IdentifiedMotor(
        parameters=MotorFit(result.K_m, result.T_m, result.u_c),
        std_errors=MotorFit(*result.std_errors),
        coulomb=result.coulomb,
        rule=tuple(StepRuleEstimate(**asdict(item)) for item in result.rule),
        rule_mean=MotorConstants(*result.rule_mean),
        rule_spread=MotorConstants(*result.rule_spread),
        before=MotorConstants(known.K_m, known.T_m),
    )


def _motor_quality(cut: SideSteps, result: MotorIdentification) -> MotorQuality:
    return MotorQuality(
        rms_counts=result.rms_counts,
        grade=result.verdict.grade,
        verdict=result.verdict.sentence,
        refused=tuple(RefusedStep(voltage, reason) for voltage, reason in cut.refused),
        steps=tuple(_build_step_curve(step, result) for step in cut.steps),
    )


def _build_step_curve(step: VoltageStepRecord, result: MotorIdentification) -> StoredStepCurve:
    """Return points of a measured and a predicted step for a plot: t [s], angle [rad]."""
    t = np.arange(step.u.size - step.first) * step.period_s
    model = turn_from_rest(t, steady_speed(step.voltage, result.K_m, result.u_c), result.T_m)
    turned = step.theta[step.first :] - step.theta[step.first]
    shown = np.unique(np.linspace(0, t.size - 1, _MOTOR_CURVE_POINTS).astype(int))
    return StoredStepCurve(
        voltage=step.voltage,
        t=_round_values_6(t[shown]),
        measured=_round_values_6(turned[shown]),
        model=_round_values_6((model + np.mean(turned - model))[shown]),
    )


def _round_values_6(values: Sequence[float] | Array) -> tuple[float, ...]:
    return tuple(round(float(value), 6) for value in values)


def _compute_count_rad(parameters: PlantParameters) -> float:
    return 2.0 * math.pi / (round(parameters.sensors.motor_counts) or MOTOR_COUNTS_WHERE_EXACT)


# Spring identification -----------------------------------------------------------------------------
# Characteristics of the springs from a tension sweep, or from an imported table.


SpringColumns = Mapping[str, Array]

PAIR_S = 0.1
"""Averaging time of a pair of elongation and force [s], which reduces noise and correlation between pairs."""

MAX_ERROR_N = 2.5
"""Largest error of a usable characteristic [N]: 5 % of the range of 50 N."""

_SPRING_CURVE_POINTS = 60


@dataclass(frozen=True)
class LoadSweep:
    """Pairs of one spring: elongation ``x`` [m], force ``F`` [N], and whether tension was ``rising``; each (n,)."""

    x: Array
    F: Array
    rising: NDArray[np.bool_]

    def hysteresis(self) -> Array:
        """Return the force while rising minus that while falling [N], at elongations that both have."""
        if self.rising.all() or not self.rising.any():
            return np.empty(0)
        up, down = (np.argsort(self.x[mask]) for mask in (self.rising, ~self.rising))
        x_up, F_up = self.x[self.rising][up], self.F[self.rising][up]
        x_down, F_down = self.x[~self.rising][down], self.F[~self.rising][down]
        x = np.linspace(max(x_up[0], x_down[0]), min(x_up[-1], x_down[-1]), _SPRING_CURVE_POINTS)
        return np.asarray(_average_locally(x, x_up, F_up) - _average_locally(x, x_down, F_down))


@dataclass(frozen=True)
class SpringMetrics:
    """Estimates of both springs, and their loads."""

    rms_A_N: float = declare_metric("N", "Error of spring A", "RMS of measured minus fitted force, recommended order")
    rms_B_N: float = declare_metric("N", "Error of spring B", "RMS of measured minus fitted force, recommended order")
    max_error_N: float = declare_metric(
        "N", "Largest error", "largest |measured − fitted force| of both springs, recommended order"
    )
    hysteresis_N: float = declare_metric(
        "N", "Hysteresis", "largest difference between the averaged forces of loading and unloading"
    )
    min_tension_N: float = declare_metric(
        "N", "Smallest tension", "smallest reading of both load cells during the sweep"
    )
    max_tension_N: float = declare_metric("N", "Largest tension", "largest reading of both load cells during the sweep")
    q_deviation: float = declare_metric(
        "rad", "Joint deviation", "largest |q| during the sweep; 0 would be perfect antagonism"
    )


def extract_load_sweep(
    columns: SpringColumns, plan: SpringIdentificationPlan, side: Side, parameters: PlantParameters
) -> LoadSweep:
    """Return the pairs of one spring (equations 1 and 2). Raises NoSamplesError.

    Elongations count from the zero that the pretension set.
    """
    swept = _find_sweep(columns, plan)
    g = parameters.geometry
    sign = -1.0 if side == "A" else 1.0
    x = g.r_m * columns[f"theta_{side}"][swept] + sign * g.r_j * columns["q"][swept]
    F = columns[f"F_{side}"][swept]
    width, leg = round(PAIR_S / T_s), round(plan.sweep_s / T_s)
    count = x.size // width
    middle = (np.arange(count) + 0.5) * width
    x, F = (values[: count * width].reshape(count, width).mean(axis=1) for values in (x, F))
    return LoadSweep(x, F, (middle // leg) % 2 == 0)


def identify_springs(
    columns: SpringColumns, plan: SpringIdentificationPlan, parameters: PlantParameters
) -> dict[Side, tuple[LoadSweep, SpringIdentification]]:
    """Fit both springs. Raises NoSamplesError, IdentificationError."""
    sweeps = {side: extract_load_sweep(columns, plan, side, parameters) for side in SIDES}
    return {side: (sweep, identify_spring(sweep.x, sweep.F)) for side, sweep in sweeps.items()}


def compute_spring_metrics(
    columns: SpringColumns,
    plan: SpringIdentificationPlan,
    found: Mapping[Side, tuple[LoadSweep, SpringIdentification]],
) -> SpringMetrics:
    """Return the metrics of a spring identification."""
    swept = _find_sweep(columns, plan)
    tensions = np.concatenate([columns[f"F_{side}"][swept] for side in SIDES])
    (sweep_A, A), (sweep_B, B) = (found[side] for side in SIDES)
    return SpringMetrics(
        rms_A_N=A.best.rms_N,
        rms_B_N=B.best.rms_N,
        max_error_N=max(A.best.max_N, B.best.max_N),
        hysteresis_N=max(_max_magnitude(sweep_A.hysteresis()), _max_magnitude(sweep_B.hysteresis())),
        min_tension_N=float(tensions.min()),
        max_tension_N=float(tensions.max()),
        q_deviation=float(np.abs(columns["q"][swept]).max()),
    )


def build_spring_record(
    run: Run,
    plan: SpringIdentificationPlan,
    found: Mapping[Side, tuple[LoadSweep, SpringIdentification]],
    parameters: PlantParameters,
    software: str,
) -> NewIdentification:
    """Return the record to store: polynomials, quality, and the samples that they were estimated from."""
    before = {str(side): tuple(parameters.select_identified(side).k) for side in SIDES}
    return _build_spring_record(
        {messages.spring_of_side(side=side): pair for side, pair in found.items()},
        {str(side): pair for side, pair in found.items()},
        before,
        run_id=run.id,
        data={"inputs": ["theta_A", "theta_B", "q"], "outputs": ["F_A", "F_B"], "pair_s": PAIR_S, "period_s": T_s},
        options=asdict(plan),
        who=run.who,
        software=software,
    )


def fit_spring_table(
    name: str,
    text: str,
    who: str,
    software: str,
    header: int | None = None,
    decimal: str | None = None,
) -> NewIdentification:
    """Fit an imported table with columns ``x [m]`` or ``x [mm]`` and ``F [N]``.

    ``header`` is the line with the names of the columns, ``decimal`` is "point" or "comma"; both are detected if not
    given. Raises IdentificationError.
    """
    for part, words, require in (
        (messages.name_of_table(), name, check_single_line),
        (messages.content_of_table(), text, check_plain_text),
    ):
        try:
            require(words.removeprefix("\ufeff"))
        except PlainTextError as error:
            raise IdentificationError(messages.invalid_text(part=part, reason=error.message)) from None
    if "\ufffd" in text:
        raise DataFileError(not_utf_8(file=name), FileFault.ENCODING)
    mark = None if decimal is None else DecimalMark(decimal)
    x, F, columns = read_load_sweep(text, header=header, decimal=mark)
    reading = TableReading(
        columns.units["x"],
        columns.units["F"],
        columns.layout,
        {name: reason for name, reason in columns.not_read().items() if name not in ("x", "F")},
        tuple(columns.notes),
    )
    rising = np.ones(x.size, dtype=bool)
    pair = LoadSweep(x, F, rising), identify_spring(x, F)
    digest = hashlib.sha256(text.encode()).hexdigest()
    return _build_spring_record(
        {messages.spring_of_table(): pair},
        {"table": pair},
        {},
        run_id=None,
        data={"file": name, "sha256": digest, "points": int(x.size), "read": asdict(reading)},
        options={},
        who=who,
        software=software,
    )


def _build_spring_record(
    named: Mapping[str, tuple[LoadSweep, SpringIdentification]],
    found: Mapping[str, tuple[LoadSweep, SpringIdentification]],
    before: Mapping[str, tuple[float, ...]],
    *,
    run_id: int | None,
    data: Document,
    options: Document,
    who: str,
    software: str,
) -> NewIdentification:
    models = {key: _spring_model(result, before.get(key)) for key, (_, result) in found.items()}
    qualities = {key: _spring_quality(sweep, result) for key, (sweep, result) in found.items()}
    return NewIdentification(
        kind="spring",
        run_id=run_id,
        data=data,
        method=messages.least_squares_polynomials(),
        options=options,
        model=SPRING_MODELS.write(SpringModels(models.get("A"), models.get("B"), models.get("table"))),
        quality=SPRING_QUALITIES.write(SpringQualities(qualities.get("A"), qualities.get("B"), qualities.get("table"))),
        usable=all(_is_usable(result) for _, result in found.values()),
        verdict=" ".join(
            messages.verdict_of_spring(name=name, verdict=_build_verdict(*pair)) for name, pair in named.items()
        ),
        who=who,
        software=software,
    )


def _spring_model(result: SpringIdentification, before: tuple[float, ...] | None) -> SpringModel:
    fits = tuple(
        StoredSpringFit(
            order=fit.order,
            k=tuple(fit.k),
            std_errors=tuple(fit.std_errors),
            rms_N=fit.rms_N,
            max_N=fit.max_N,
            cross_validation_N=fit.cross_validation_N,
            rising=fit.rising,
        )
        for fit in result.fits
    )
    return SpringModel(result.recommended, result.reason, fits, before)


def _spring_quality(sweep: LoadSweep, result: SpringIdentification) -> SpringQuality:
    order = np.argsort(sweep.x)
    shown = order[np.unique(np.linspace(0, order.size - 1, 4 * _SPRING_CURVE_POINTS).astype(int))]
    x = np.linspace(sweep.x.min(), sweep.x.max(), _SPRING_CURVE_POINTS)
    hysteresis = sweep.hysteresis()
    return SpringQuality(
        pairs=int(sweep.x.size),
        hysteresis_N=_max_magnitude(hysteresis) if hysteresis.size else None,
        x=_round_values_7(sweep.x[shown]),
        F=_round_values_7(sweep.F[shown]),
        rising=tuple(bool(value) for value in sweep.rising[shown]),
        errors={str(fit.order): _round_values_7(fit.errors[shown]) for fit in result.fits},
        curve={"x": _round_values_7(x), **{str(fit.order): _round_values_7(fit.force(x)) for fit in result.fits}},
    )


def _is_usable(result: SpringIdentification) -> bool:
    return result.best.rising and result.best.max_N <= MAX_ERROR_N


def _build_verdict(sweep: LoadSweep, result: SpringIdentification) -> Message:
    best = result.best
    if not best.rising:
        return messages.polynomial_decreases(order=best.order)
    if best.max_N > MAX_ERROR_N:
        return messages.polynomial_deviates(order=best.order, error_N=best.max_N, maximum_N=MAX_ERROR_N)
    hysteresis = sweep.hysteresis()
    hysteresis_N = _max_magnitude(hysteresis) if hysteresis.size else None
    return messages.polynomial_usable(order=best.order, error_N=best.max_N, hysteresis_N=hysteresis_N)


def _find_sweep(columns: SpringColumns, plan: SpringIdentificationPlan) -> slice:
    """Return the samples of the sweep, located from the end because the duration of the motion to its start varies."""
    ticks = 2 * plan.cycles * round(plan.sweep_s / T_s)
    start = columns["t"].size - ticks
    if start < 0:
        raise NoSamplesError(messages.fewer_samples_than_sweep(samples=columns["t"].size, needed=ticks))
    return slice(start, None)


def _average_locally(x: Array, x_measured: Array, F_measured: Array) -> Array:
    """Return the force at ``x`` by local linear fits over a tenth of the range of scattered pairs."""
    half = 0.05 * (x_measured[-1] - x_measured[0])
    values = []
    for centre in x:
        near = np.abs(x_measured - centre) <= half
        line = np.polyfit(x_measured[near] - centre, F_measured[near], 1) if near.sum() > 2 else (0.0, np.nan)
        values.append(line[1])
    return np.array(values)


def _max_magnitude(values: Array) -> float:
    return float(np.nanmax(np.abs(values)))


def _round_values_7(values: Array) -> tuple[float, ...]:
    return tuple(round(float(value), 7) for value in values)


# Load friction -------------------------------------------------------------------------------------
# Load-dependent Coulomb friction from stored actuator identifications at several tensions; the
# estimate is not stored.


MOTOR_B = messages.friction_of_motor_B_not_measured()


def estimate_run_friction(played: Sequence[tuple[Run, Columns]]) -> LoadFrictionResult:
    """Return c0 and c1 of motor A from actuator identifications among runs with their samples.

    Runs with another plant, station or other parameters than the newest one are left out.
    """
    identification_runs = [(run, columns) for run, columns in played if run.kind == RunKind.ACTUATOR_IDENTIFICATION]
    if not identification_runs:
        return estimate_load_friction((), 0.0)
    newest = max((run for run, _ in identification_runs), key=lambda run: run.id)
    usable: list[TensionRun] = []
    left_out: list[str] = []
    for run, columns in identification_runs:
        if _get_rig_identity(run) != _get_rig_identity(newest):
            left_out.append(messages.run_with_other_plant(run=run.id, newest=newest.id))
            continue
        try:
            usable.append(_build_tension_run(run, columns))
        except (NoSamplesError, UnreadableDocumentError) as error:
            left_out.append(messages.run_left_out(run=run.id, reason=str(error)))
    found = estimate_load_friction(usable, newest.number("geometry", "r_m"))
    return LoadFrictionResult(found.estimate, found.problem, (*left_out, *found.left_out))


def estimate_newest_load_friction(database: Database, identification_runs: Sequence[Run]) -> LoadFrictionResult:
    """Return c0 and c1 of motor A from the newest completed run at each tension."""
    newest: dict[object, Run] = {}
    for run in sorted(identification_runs, key=lambda run: run.id, reverse=True):
        if run.end_state == EndState.COMPLETED:
            newest.setdefault((run.set_to.plan or {}).get("tension_N"), run)
    chosen = sorted(newest.values(), key=lambda run: run.id)
    return estimate_run_friction([(run, read_recorded_columns(database, run.id)[0]) for run in chosen])


def build_friction_document(found: LoadFrictionResult) -> Document:
    """Return the document of a friction estimate, in SI units, with its sentence."""
    return {
        "estimate": None if found.estimate is None else asdict(found.estimate),
        "problem": found.problem,
        "sentence": found.sentence,
        "left_out": [*found.left_out],
    }


def _get_rig_identity(run: Run) -> tuple[str, str, Document]:
    return run.plant, run.station, run.parameters


def _build_tension_run(run: Run, columns: Columns) -> TensionRun:
    plan = parse_stored_plan(run.kind, run.set_to.plan or {})
    if not isinstance(plan, ActuatorIdentificationPlan):
        raise NoSamplesError(messages.run_without_excitation())
    if run.end_state != EndState.COMPLETED:
        raise NoSamplesError(messages.run_not_completed(end_state=run.end_state))
    start = find_excitation_start(columns, plan.excitation())
    if count_missing_ticks({"t": columns["t"][start:]}):
        raise NoSamplesError(messages.excitation_samples_missing())
    return TensionRun(run.id, T_s, {name: columns[name][start:] for name in COLUMNS if name in columns})
