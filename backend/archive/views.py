"""From stored records to what the interface shows of them; no record is changed here."""

import math
from collections.abc import Mapping
from dataclasses import asdict
from datetime import datetime
from typing import Any

import numpy as np
from numpy.typing import NDArray

from backend.documents.actuator import ChannelName
from backend.documents.edge import UnreadableDocumentError
from backend.documents.motor import Fitted, Pair
from backend.documents.motor_grade import grade_of
from backend.documents.result import Criterion as Judged
from backend.experiments.results.used_settings import used_settings
from backend.messages.bank import BankEntryView, BankView
from backend.messages.experiment import Criterion, DryRunView, ExperimentView, MeasuredMetric, SettingValue
from backend.messages.flight import FlightView
from backend.messages.identification import (
    IdentificationView,
    ModelView,
    MotorEstimate,
    MotorView,
    SpringFitView,
    SpringTableView,
    SpringView,
)
from backend.messages.run import Envelope, Evaluation, RunView, SamplesView, UsedSetting
from backend.recording import reader
from backend.reports.verdict import verdict_of
from backend.sample import STORED
from backend.storage.banks import Bank
from backend.storage.flights import Flight
from backend.storage.identifications import Identification
from backend.storage.results import Result
from backend.storage.runs import Run
from plant.interface import T_s
from plant.parameter_sections import SIDES

_UNITS = {field.name: field.unit for field in STORED}


def run_view(
    run: Run,
    evaluation: Evaluation,
    samples: int,
    duration_s: float,
    missed: int,
    samples_deleted: datetime | None = None,
) -> RunView:
    """Return a run with the extent of what was recorded of it."""
    return RunView(
        id=run.id,
        kind=run.kind,
        plant=run.plant,
        parameters=run.parameters_name,
        who=run.who,
        started=run.started_at,
        ended=run.ended_at,
        end_state=run.end_state,
        end_reason=run.end_detail,
        duration_s=duration_s,
        samples=samples,
        missing_samples=missed,
        samples_deleted=samples_deleted,
        settings=[UsedSetting(**item) for item in used_settings(run.settings)],
        note=run.note,
        evaluation=evaluation,
        evaluation_problem=run.evaluation_problem,
    )


def samples_view(run_id: int, envelope: reader.Envelope, *, raw: bool) -> SamplesView:
    """Return an envelope of samples; nan is null."""
    return SamplesView(
        run=run_id,
        raw=raw,
        width_s=envelope.width_s,
        t=envelope.t.tolist(),
        signals={
            name: Envelope(
                unit=_UNITS[name], minimum=_plain(envelope.minimum[name]), maximum=_plain(envelope.maximum[name])
            )
            for name in envelope.minimum
        },
    )


def identification_view(run: Run, estimate: Identification | None, progress: float) -> IdentificationView:
    """Return an identification run with its models, where it has any."""
    plan = run.settings.get("plan", {})
    kind = run.kind.removesuffix("_identification")
    actuator = estimate if kind == "actuator" else None
    return IdentificationView(
        id=run.id,
        run=run.id,
        kind=kind,
        status=run.end_state,
        created=run.started_at,
        progress=progress,
        tension_N=plan.get("tension_N"),
        S_nominal=None if actuator is None else actuator.actuator.model.S_nominal,
        settings={**plan, **run.settings.get("loop", {})},
        estimate=None if estimate is None else estimate.id,
        usable=estimate is not None and estimate.usable,
        G_q=None if actuator is None else _model_view(actuator, "G_q"),
        G_S=None if actuator is None else _model_view(actuator, "G_S"),
        motors=_motors(estimate) if estimate is not None and kind == "motor" else [],
        springs=_springs(estimate) if estimate is not None and kind == "spring" else [],
        message=_message(run, None) if estimate is None else estimate.verdict,
    )


def spring_table_view(found: Identification) -> SpringTableView:
    """Return a spring that was identified from a table."""
    return SpringTableView(
        id=found.id,
        file=found.table.file,
        sha256=found.table.sha256,
        created=found.created_at,
        who=found.who,
        usable=found.usable,
        spring=_springs(found)[0],
        message=found.verdict,
    )


def bank_view(
    bank: Bank, runs_of: Mapping[int, int | None], positions: Mapping[int, float], in_use: int | None
) -> BankView:
    """Return a bank; its estimates are mapped to the runs they came from and the joint positions they were made at."""
    return BankView(
        id=bank.id,
        name=bank.name,
        version=bank.version,
        created=bank.created_at,
        who=bank.who,
        note=bank.note,
        active=bank.id == in_use,
        entries=[
            BankEntryView(
                identification=None if entry.identification_id is None else runs_of.get(entry.identification_id),
                tension_N=entry.model.get("tension_N"),
                S_nominal=entry.S_nominal,
                q_nominal=None if entry.identification_id is None else positions.get(entry.identification_id),
                **{name: entry.model[name] for name in ("K_q", "T_q", "K_S", "T_S")},
            )
            for entry in bank.entries
        ],
    )


def experiment_view(run: Run, result: Result | None, progress: float) -> ExperimentView:
    """Return an experiment run with metrics and criteria, where they have been computed."""
    return ExperimentView(
        id=run.id,
        name=run.kind,
        status=run.end_state,
        created=run.started_at,
        progress=progress,
        settings={**run.settings.get("plan", {}), **run.settings.get("loop", {})},
        **_judgement(run, result),
        message=_message(run, result),
    )


def dry_run_view(
    run: Run,
    result: Result | None,
    curves: reader.Envelope | None,
    duration_s: float,
    settings: dict[str, SettingValue],
) -> DryRunView:
    """Return what a dry run with these settings gave; its run is stored nowhere."""
    samples = None if curves is None else samples_view(run.id, curves, raw=False)
    return DryRunView(
        status=run.end_state,
        message=_message(run, result),
        duration_s=duration_s,
        settings=settings,
        **_judgement(run, result),
        samples=samples,
    )


def _judgement(run: Run, result: Result | None) -> dict[str, Any]:
    metrics, criteria = (None, ()) if result is None else (result.metrics, result.criteria)
    running = "" if run.ended_at is not None else "the run is not over"
    found = verdict_of(metrics, criteria, run.evaluation_problem or running)
    return {
        "outcome": found.outcome,
        "verdict": found.sentence,
        "metrics": [MeasuredMetric(**asdict(item)) for item in (metrics.figures if metrics else ())],
        "criteria": [_criterion(item) for item in criteria],
    }


def _criterion(item: Judged) -> Criterion:
    return Criterion(
        name=item.name,
        label=item.title,
        value=item.figure,
        relation=item.relation,
        bound=item.bound,
        unit=item.unit,
        passed=item.passed,
        reason=item.reason,
    )


def _message(run: Run, result: Result | None) -> str:
    if result is None and run.evaluation_problem:
        return ". ".join(filter(None, (run.end_detail, f"not evaluated: {run.evaluation_problem}")))
    return run.end_detail or ("" if result is None else result.metrics.problem)


def _model_view(estimate: Identification, name: ChannelName) -> ModelView:
    channel = estimate.actuator.channel(name)
    model, quality = channel.model, channel.quality
    return ModelView(
        structure=model.structure,
        method=estimate.method if model.method is None else model.method,
        parameters=model.parameters,
        std_errors=model.std_errors,
        fit_percent=quality.fit_percent,
        gain_geometry=_needed(quality.gain_geometry, estimate, "gain_geometry"),
        K=model.first_order.K,
        T=model.first_order.T,
        grade=quality.grade,
        usable=quality.usable,
        verdict=quality.verdict,
    )


def _motors(estimate: Identification) -> list[MotorView]:
    views = []
    for side in SIDES:
        found = estimate.motors.side(side)
        model, quality = found.model, found.quality
        views.append(
            MotorView(
                side=side,
                u_c=_needed(model.parameters.u_c, estimate, "u_c"),
                u_c_std=_needed(model.std_errors.u_c, estimate, "std_errors.u_c"),
                fitted=_motor_estimate(model.parameters, estimate),
                std_errors=_motor_estimate(model.std_errors, estimate),
                rule_mean=_motor_estimate(model.rule_mean, estimate),
                rule_spread=_motor_estimate(model.rule_spread, estimate),
                before=_motor_estimate(model.before, estimate),
                rms_counts=_needed(quality.rms_counts, estimate, "rms_counts"),
                refused=[f"{item.voltage:g} V: {item.reason}" for item in quality.refused],
                grade=grade_of(found),
                verdict=quality.verdict,
            )
        )
    return views


def _motor_estimate(found: Fitted | Pair, estimate: Identification) -> MotorEstimate:
    return MotorEstimate(K_m=_needed(found.K_m, estimate, "K_m"), T_m=_needed(found.T_m, estimate, "T_m"))


def _needed(value: float | None, estimate: Identification, name: str) -> float:
    if value is None:
        raise UnreadableDocumentError(f"run {estimate.run_id}: the estimate {estimate.id} has no figure for {name}")
    return value


def _springs(estimate: Identification) -> list[SpringView]:
    return [
        SpringView(
            name=name,
            recommended=found.model.recommended,
            reason=found.model.reason,
            pairs=found.quality.pairs,
            hysteresis_N=found.quality.hysteresis_N,
            fits=[SpringFitView(**asdict(fit)) for fit in found.model.fits],
        )
        for name, found in estimate.springs.items()
    ]


def _plain(values: NDArray[np.float32]) -> list[float | None]:
    return [value if math.isfinite(value) else None for value in values.tolist()]


def flight_view(flight: Flight) -> FlightView:
    """Return a flight record with its extent around the trip."""
    before = flight.trip_tick - flight.first_tick
    return FlightView(
        id=flight.event_id,
        at=flight.at,
        fault=flight.fault,
        text=flight.text,
        run=flight.run_id,
        before_s=before * T_s,
        after_s=(flight.count - before) * T_s,
    )
