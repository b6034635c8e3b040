"""From stored records to what the interface shows of them; no record is changed here."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from datetime import datetime
from typing import Any

import numpy as np
from numpy.typing import NDArray

from backend.analysis.evaluation import used_settings
from backend.banks.builder import MODEL_NAMES, point_of
from backend.models.document import UnreadableDocumentError
from backend.models.run import Criterion as Judged
from backend.models.run import headline_of, outcome_of
from backend.recording import reader
from backend.reports.provenance import verdict_of
from backend.schemas.experiment import Criterion, DryRunView, ExperimentView, MeasuredMetric, SettingValue
from backend.schemas.run import Envelope, Evaluation, FlightView, Headline, RunView, SamplesView, UsedSetting
from backend.schemas.tuning import BankEntryView, BankView
from backend.storage.banks import Bank
from backend.storage.flights import Flight
from backend.storage.results import Result
from backend.storage.runs import EndState, Run, RunKind, experiment_of, title_of
from plant.interface import T_s


def run_view(
    run: Run,
    evaluation: Evaluation,
    samples: int,
    duration_s: float,
    missed: int,
    samples_deleted: datetime | None = None,
    *,
    tags: Sequence[str] = (),
    origin: str = "",
    result: Result | None = None,
    fits: Mapping[str, float] | None = None,
) -> RunView:
    """Return a run with the extent of what was recorded of it; one whose settings cannot be read says so.

    ``fits`` are those of the channels [%] that were identified from it.
    """
    judged = result is not None or not (run.kind == RunKind.SESSION or run.end_state == EndState.RUNNING)
    metrics, criteria = (None, ()) if result is None else (result.metrics, result.criteria)
    headline = headline_of(metrics, criteria, fits)
    settings, problem = [], run.evaluation_problem
    try:
        settings = [UsedSetting(**asdict(item)) for item in used_settings(run)]
    except UnreadableDocumentError as error:
        problem = problem or str(error)
    return RunView(
        id=run.id,
        kind=run.kind,
        title=title_of(run),
        plant=run.plant,
        parameters=run.parameters_name,
        who=run.who,
        started=run.started_at,
        ended=run.ended_at,
        end_state=run.end_state,
        end_reason=run.end_detail,
        duration_s=duration_s,
        samples=samples,
        missing_samples=None if run.end_state == EndState.SERVICE_DIED else missed,
        samples_deleted=samples_deleted,
        settings=settings,
        note=run.note,
        tags=list(tags),
        station=run.station,
        origin=origin,
        evaluation=evaluation,
        evaluation_problem=problem,
        outcome=outcome_of(metrics, criteria) if judged else None,
        headline=None if headline is None else Headline(**asdict(headline)),
    )


def samples_view(run_id: int, envelope: reader.SampleEnvelope, *, raw: bool) -> SamplesView:
    """Return an envelope of samples; nan is null."""
    return SamplesView(
        run=run_id,
        raw=raw,
        width_s=envelope.width_s,
        t=envelope.t.tolist(),
        signals={
            name: Envelope(
                unit=envelope.units[name],
                minimum=_plain(envelope.minimum[name]),
                maximum=_plain(envelope.maximum[name]),
            )
            for name in envelope.minimum
        },
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
                tension_N=entry.known.tension_N,
                S_nominal=entry.S_nominal,
                q_nominal=None if entry.identification_id is None else positions.get(entry.identification_id),
                **{name: getattr(point_of(entry), name) for name in MODEL_NAMES},
            )
            for entry in bank.entries
        ],
    )


def experiment_view(run: Run, result: Result | None, progress: float) -> ExperimentView:
    """Return an experiment run with metrics and criteria, where they have been computed."""
    return ExperimentView(
        id=run.id,
        name=experiment_of(run),
        title=title_of(run),
        status=run.end_state,
        created=run.started_at,
        progress=progress,
        settings={name: value for name, value in run.set_to.told().items() if name != "experiment"},
        **_judgement(run, result),
        message=message_of(run, result),
    )


def dry_run_view(
    run: Run,
    result: Result | None,
    curves: reader.SampleEnvelope | None,
    duration_s: float,
    settings: dict[str, SettingValue],
) -> DryRunView:
    """Return what a dry run with these settings gave; its run is stored nowhere."""
    samples = None if curves is None else samples_view(run.id, curves, raw=False)
    return DryRunView(
        status=run.end_state,
        message=message_of(run, result),
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


def message_of(run: Run, result: Result | None) -> str:
    """Return what is to be said of a run beside its verdict: how it ended, or why there is no result."""
    if result is None and run.evaluation_problem:
        return ". ".join(filter(None, (run.end_detail, f"not evaluated: {run.evaluation_problem}")))
    return run.end_detail or ("" if result is None else result.metrics.problem)


def _plain(values: NDArray[np.float32]) -> list[float | None]:
    return [value if math.isfinite(value) else None for value in values.tolist()]


def flight_view(flight: Flight) -> FlightView:
    """Return a flight record with its extent around the trip or trigger."""
    before = flight.trip_tick - flight.first_tick
    return FlightView(
        id=flight.event_id,
        at=flight.at,
        kind="trip" if flight.trigger is None else "trigger",
        who=flight.who,
        fault=flight.fault,
        text=flight.text,
        run=flight.run_id,
        tick=flight.trip_tick,
        before_s=before * T_s,
        after_s=(flight.count - before) * T_s,
    )
