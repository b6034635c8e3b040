"""Views of stored identifications: curves, validation on records, trend over stiffness."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from backend.analysis import messages
from backend.analysis.identification import (
    build_friction_document,
    estimate_newest_load_friction,
    extract_side_steps,
    find_excitation_start,
)
from backend.analysis.step_metrics import NoSamplesError
from backend.control import compute_bounds
from backend.experiments import (
    ActuatorIdentificationPlan,
    parse_stored_plan,
)
from backend.identification import (
    RESIDUAL_LEVEL,
    CorrelationTest,
    FrequencyCheck,
    IdentificationError,
    Method,
    Model,
    ModelComparison,
    Record,
    VoltageStepRecord,
    count_fitted_samples,
    find_structure,
    fit_parameters,
    fit_percent,
    identify_motor,
    read_whiteness_test,
    split_last_part,
    validate_held_out,
    validate_motor_step,
    validate_on_record,
)
from backend.models import (
    CHANNELS,
    ChannelModel,
    ChannelName,
    Document,
    FailedCandidate,
    IdentifiedChannel,
    MotorResult,
    SpringQuality,
    TriedStructure,
    UnreadableDocumentError,
)
from backend.recording import Columns, read_recorded_columns
from backend.storage import Database, Identification, Run, identifications, runs
from backend.tuning import PointModel, TuningError, linearize_one_motor, make_motor_loops
from plant import SIDES, ErrorCode, ParameterError, PlantParameters, Side, SinewError, T_s, parse_parameters

# Identification curves -----------------------------------------------------------------------------
# Curves of a stored identification: responses of its models, residual tests, errors.


OMEGA = np.geomspace(0.1, 60.0, 160)
"""Frequencies of the plotted responses [rad/s]."""

_STEP_POINTS = 200


def build_curves(found: Identification) -> Document:
    """Return the curves of one identification by kind: ``channels``, ``motors``, ``springs``."""
    curves: Document = {"channels": [], "motors": [], "springs": []}
    match found.kind:
        case "actuator":
            curves["channels"] = [_build_channel_curves(name, found.actuator.channel(name)) for name in CHANNELS]
        case "motor":
            curves["motors"] = [_build_motor_curves(side, found.motors.side(side)) for side in SIDES]
        case "spring":
            curves["springs"] = [_build_spring_curves(name, spring.quality) for name, spring in found.springs.items()]
        case _:
            raise ValueError(messages.kind_without_curves(identification=found.id, kind=found.kind))
    return curves


def _build_motor_curves(side: Side, found: MotorResult) -> Document:
    return {"side": side, "steps": list(found.quality.steps)}


def _build_channel_curves(name: ChannelName, channel: IdentifiedChannel) -> Document:
    from scipy.signal import step

    model, quality = channel.model, channel.quality
    found = Model(model.structure, model.parameters)
    K, T = model.first_order.K, model.first_order.T
    t = np.linspace(0.0, 6.0 * T, _STEP_POINTS)
    _, y = step(([found.gain], found.denominator[::-1]), T=t)
    return {
        "name": name,
        "model": _build_bode(found.response(OMEGA)),
        "first_order": _build_bode(np.asarray(K / (1j * OMEGA * T + 1.0), dtype=np.complex128)),
        "measured": _build_measured_lines(quality.frequency),
        "step_t": t.tolist(),
        "step_model": y.tolist(),
        "step_first_order": (K * (1.0 - np.exp(-t / T))).tolist(),
        "whiteness": _build_correlation(quality.residuals.whiteness),
        "input_correlation": _build_correlation(quality.residuals.input_correlation),
        "candidates": [_build_candidate(item) for item in quality.candidates],
    }


def _build_bode(response: NDArray[np.complex128]) -> Document:
    phase = np.degrees(np.unwrap(np.angle(response)))
    return {"omega": OMEGA.tolist(), "magnitude": np.abs(response).tolist(), "phase_deg": phase.tolist()}


def _build_measured_lines(frequency: FrequencyCheck | None) -> Document | None:
    """Return the plotted lines of the non-parametric estimate; None for an old run without one."""
    if frequency is None:
        return None
    shown_lines = [line for line, omega in enumerate(frequency.omega) if OMEGA[0] <= omega <= OMEGA[-1]]
    columns = {name: getattr(frequency, name) for name in ("omega", "magnitude", "phase_deg", "coherence")}
    return {name: [column[line] for line in shown_lines] for name, column in columns.items()}


def _build_correlation(test: CorrelationTest) -> Document:
    found = read_whiteness_test(test)
    outcome = {"bound": list(found.bound), "statistic": found.statistic, "critical": found.critical}
    return {
        "lags_s": list(test.lags_s),
        "correlation": list(test.correlation),
        **outcome,
        "level": RESIDUAL_LEVEL,
        "passed": found.passed,
    }


def _build_candidate(item: TriedStructure | FailedCandidate) -> Document:
    figures = {name: getattr(item, name, None) for name in ("K", "T", "fit_percent", "BIC")}
    grade = item.grade if isinstance(item, TriedStructure) else ""
    return {"structure": item.structure, "grade": grade, "problem": item.problem, **figures}


def _build_spring_curves(name: str, quality: SpringQuality) -> Document:
    orders = [
        {"order": int(order), "errors": list(errors), "force": list(quality.curve[order])}
        for order, errors in quality.errors.items()
    ]
    pairs = {"x": list(quality.x), "F": list(quality.F), "rising": list(quality.rising)}
    return {"name": name, **pairs, "curve_x": list(quality.curve_x), "orders": orders}


# Validation ----------------------------------------------------------------------------------------
# Compares identified models with validation data: the last third of a record of an actuator, or
# each voltage step of a motor. On its own record, a model is estimated again without the data that
# it predicts: from the first two thirds, or from all other steps.


PLOT_POINTS = 400
"""Maximum number of plotted samples of an interval; fit and residual use all samples."""

OUTPUTS = {"G_q": ("q", "rad"), "G_S": ("S", "N·m/rad")}


class NotComparableError(SinewError, ValueError):
    """The identification and the record cannot be compared."""

    category = ErrorCode.BAD_VALUE


@dataclass(frozen=True)
class _ComparedInterval:
    label: str
    t: NDArray[np.float64]
    comparison: ModelComparison


def validate_on_run(database: Database, run_id: int, of: int) -> Document:
    """Compare the newest estimate of a run with the record of the run ``of``.

    Raises UnknownRecordError, NotComparableError.
    """
    with database.reading() as session:
        estimate, source = identifications.of_run(session, run_id), runs.get(session, of)
    kind = source.kind.removesuffix("_identification")
    if estimate.kind != kind or kind not in ("actuator", "motor"):
        raise NotComparableError(
            messages.different_kinds(estimate_run=run_id, estimate_kind=estimate.kind, run=of, run_kind=source.kind)
        )
    columns, _ = read_recorded_columns(database, of)
    parameters = parse_parameters(source.parameters_name, source.parameters)
    own = run_id == of
    outputs = _compare_channels(estimate, source, columns, own=own) if kind == "actuator" else None
    documents = list(outputs or _compare_motors(estimate, columns, parameters, own=own))
    return {"run": run_id, "of": of, "own": own, "kind": kind, "outputs": documents}


def _compare_channels(estimate: Identification, source: Run, columns: Columns, *, own: bool) -> Iterator[Document]:
    plan = parse_stored_plan(source.kind, source.set_to.plan or {})
    if not isinstance(plan, ActuatorIdentificationPlan):
        raise NotComparableError(messages.compared_run_without_excitation(run=source.id))
    for name in CHANNELS:
        signal, unit = OUTPUTS[name]
        try:
            start = find_excitation_start(columns, plan.excitation())
            record = Record(T_s, columns["theta_A_ref"][start:], columns[signal][start:])
            method = Method(estimate.actuator_options.estimator or Method.DEFAULT)
            comparison = _compare_channel(estimate.actuator.channel(name).model, record, method, own=own)
            first = start + count_fitted_samples(record) + comparison.first
            yield _build_output(
                name,
                signal,
                unit,
                [_ComparedInterval("", columns["t"][first : first + comparison.measured.size], comparison)],
            )
        except (IdentificationError, NoSamplesError, np.linalg.LinAlgError) as error:
            yield _build_failed_output(name, signal, unit, str(error))


def _compare_channel(model: ChannelModel, record: Record, method: Method, *, own: bool) -> ModelComparison:
    if own:
        return validate_held_out(fit_parameters(record, find_structure(model.structure), method))
    return validate_on_record(Model(model.structure, model.parameters), split_last_part(record))


def _compare_motors(
    estimate: Identification, columns: Columns, parameters: PlantParameters, *, own: bool
) -> Iterator[Document]:
    for side in SIDES:
        try:
            steps = extract_side_steps(columns, side, parameters).steps
            compared = [_compare_step(estimate, side, steps, number, own=own) for number in range(len(steps))]
            yield _build_output(side, f"theta_{side}", "rad", compared)
        except (IdentificationError, NoSamplesError) as error:
            yield _build_failed_output(side, f"theta_{side}", "rad", str(error))


def _compare_step(
    estimate: Identification, side: Side, steps: tuple[VoltageStepRecord, ...], number: int, *, own: bool
) -> _ComparedInterval:
    step = steps[number]
    if own:
        found = identify_motor([other for other in steps if other is not step])
        known = found.K_m, found.T_m, found.u_c
    else:
        fitted = estimate.motors.side(side).model.parameters
        if fitted.K_m is None or fitted.T_m is None or fitted.u_c is None:
            raise IdentificationError(messages.motor_not_estimated(side=side))
        known = fitted.K_m, fitted.T_m, fitted.u_c
    comparison = validate_motor_step(step, *known)
    label = messages.voltage_of_step(voltage_V=step.voltage)
    return _ComparedInterval(label, np.asarray(np.arange(comparison.measured.size) * T_s), comparison)


def _build_output(name: str, signal: str, unit: str, intervals: list[_ComparedInterval]) -> Document:
    if not intervals:
        return _build_failed_output(name, signal, unit, messages.nothing_to_compare_with())
    each = [interval.comparison for interval in intervals]
    error = np.concatenate([item.measured - item.predicted for item in each])
    motion = np.concatenate([item.measured - np.mean(item.measured) for item in each])
    return {
        "name": name,
        "signal": signal,
        "unit": unit,
        "fit_percent": fit_percent(error, motion),
        "rms": float(np.sqrt(np.mean(error**2))),
        "samples": int(error.size),
        "problem": "",
        "stretches": [_build_plot(interval) for interval in intervals],
    }


def _build_plot(interval: _ComparedInterval) -> Document:
    every = slice(None, None, max(1, -(-interval.t.size // PLOT_POINTS)))
    columns = {"t": interval.t, "measured": interval.comparison.measured, "predicted": interval.comparison.predicted}
    return {"label": interval.label, **{name: column[every].tolist() for name, column in columns.items()}}


def _build_failed_output(name: str, signal: str, unit: str, problem: str) -> Document:
    figures: Document = {"fit_percent": None, "rms": None, "samples": 0, "stretches": []}
    return {"name": name, "signal": signal, "unit": unit, "problem": problem, **figures}


# Trend over stiffness ------------------------------------------------------------------------------
# Identified gains and lags over S, compared with predictions from geometry, springs and motor loops.


_STIFFNESS_CURVE_POINTS = 13


def compute_trend(database: Database, parameters: PlantParameters, lam_motor: float) -> Document:
    """Return the newest estimate of each actuator identification by stiffness, and the predicted curves.

    The curves are those of the active ``parameters`` and ``lam_motor`` [s].
    """
    with database.reading() as session:
        newest: dict[int, Identification] = {}
        for found in identifications.find(session, kind="actuator"):
            if found.run_id is not None:
                newest.setdefault(found.run_id, found)
        estimates = [(found, runs.get(session, number)) for number, found in newest.items()]
    friction = estimate_newest_load_friction(database, [run for _, run in estimates])
    rows, left_out = [], []
    for found, run in estimates:
        try:
            rows.append(_build_row(found, run))
        except (UnreadableDocumentError, ParameterError, TuningError, ValueError) as error:
            left_out.append(messages.run_left_out(run=run.id, reason=str(error)))
    bounds = compute_bounds(parameters)
    S = np.linspace(bounds.S_min, bounds.S_max, _STIFFNESS_CURVE_POINTS)
    return {
        "rows": sorted(rows, key=lambda row: float(row["S"])),
        "predicted": _build_trend_curves(S.tolist(), [predict_point(parameters, lam_motor, at) for at in S.tolist()]),
        "left_out": left_out,
        "friction": build_friction_document(friction),
    }


def predict_point(parameters: PlantParameters, lam_motor: float, S: float) -> PointModel:
    """Return the predicted gains and sums of lags from one motor reference at stiffness S [N·m/rad]."""
    return linearize_one_motor(parameters, make_motor_loops(parameters, lam_motor), S)


def _build_row(found: Identification, run: Run) -> Document:
    lam_motor = run.set_to.loop.lam_motor
    if lam_motor is None:
        raise ValueError(messages.motor_lambda_not_stored())
    S = found.actuator.model.S_nominal
    point = predict_point(parse_parameters(run.parameters_name, run.parameters), lam_motor, S)
    return {
        "run": run.id,
        "S": S,
        "G_q": _compare_stiffness_channel(found, "G_q", point.K_q, point.T_q),
        "G_S": _compare_stiffness_channel(found, "G_S", point.K_S, point.T_S),
    }


def _compare_stiffness_channel(found: Identification, name: ChannelName, K: float, T: float) -> Document:
    channel: IdentifiedChannel = found.actuator.channel(name)
    model = channel.model.first_order
    gain, lag = _compare(model.K, model.K_std, K), _compare(model.T, model.T_std, T)
    return {"K": gain, "T": lag, "grade": channel.quality.grade}


def _compare(identified: float, std: float | None, predicted: float) -> Document:
    off = 100.0 * (identified / predicted - 1.0)
    return {"identified": identified, "std": std, "predicted": predicted, "off_percent": off}


def _build_trend_curves(S: Sequence[float], points: Sequence[PointModel]) -> Document:
    return {"S": list(S), **{name: [getattr(at, name) for at in points] for name in ("K_q", "T_q", "K_S", "T_S")}}
