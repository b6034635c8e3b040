"""Stored runs: samples, results, flight records, event log, replay, conversion."""

import asyncio
import json
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from backend import wire
from backend.analysis import reevaluate_run, require_evaluable, select_used_settings
from backend.banks import MODEL_NAMES, build_point_model, parse_changes
from backend.errors import RequestRejectedError
from backend.event_bus import EventBus
from backend.experiments import (
    FORMAT,
    LAWS,
    PART_MIN_TICKS,
    Column,
    ExperimentPlan,
    IdentificationPlan,
    RecordedParts,
    ReferenceChange,
    approximate_columns,
    build_profile,
    find_commanded_range,
    forecast_identification,
    parse_stored_plan,
)
from backend.models import (
    LAMBDA,
    RunCriterion,
    StoredLoopSettings,
    StoredWall,
    UnreadableDocumentError,
    find_headline,
    find_wall_at,
    judge_run,
)
from backend.realtime import MAX_TUNINGS, MAX_WALLS, Law, Mode
from backend.recording import AT_HAND_SAMPLES, SampleEnvelope, read_envelope, read_flight_columns, read_samples, reader
from backend.reports import judge_stored_run
from backend.sample import FIELDS, INDEX, NAMES, STORED_NAMES
from backend.schemas import (
    BankEntryView,
    BankView,
    Criterion,
    DryRunView,
    EvaluationView,
    EventNote,
    ExperimentView,
    FlightList,
    FlightView,
    PlannedLine,
    PlannedPart,
    PlannedSignals,
    RecordedExperiment,
    RunList,
    RunMark,
    RunView,
    SamplesView,
    SettingValue,
    SignalEnvelope,
    TaskView,
    Timeline,
)
from backend.services import record_messages
from backend.services.lineage import load_marks
from backend.storage import (
    All,
    Bank,
    Compare,
    Database,
    EndState,
    EventKind,
    Extent,
    Flight,
    LogQuery,
    Op,
    Query,
    Recording,
    Result,
    Run,
    RunKind,
    Session,
    UnknownRecordError,
    Value,
    Word,
    banks,
    flights,
    identifications,
    origins,
    parse_query,
    recordings,
    require_printable,
    results,
    run_experiment_name,
    run_title,
    runs,
    tags,
    timeline,
)
from backend.storage import search as run_search
from backend.workers import WorkerProcess
from plant import ErrorCode, Obstacle, ParameterError, T_s, parse_parameters

# Evaluations ---------------------------------------------------------------------------------------


@dataclass(frozen=True)
class RunReevaluated:
    """A stored run has a new result."""

    run: int


class Evaluations:
    """Evaluates stored runs again, one evaluation per run at a time.

    ``task`` returns what the service is executing. Publishes RunReevaluated.
    """

    def __init__(
        self, database: Database, worker: WorkerProcess, task: Callable[[], TaskView | None], events: EventBus
    ) -> None:
        self._events = events
        self._database = database
        self._worker = worker
        self._task = task
        self._active: set[int] = set()

    def is_evaluating(self, run_id: int) -> bool:
        """Whether a run is being evaluated."""
        return run_id in self._active

    async def evaluate_again(self, run_id: int) -> None:
        """Compute and store the result of a run, or store the reason why there is none.

        Raises that reason, UnknownRecordError, NotEvaluableError, WorkerDiedError, and RequestRejectedError while the
        run is being evaluated.
        """
        require_evaluable(await asyncio.to_thread(self._load_run, run_id))
        task = self._task()
        if self.is_evaluating(run_id) or (task is not None and task.run == run_id):
            raise RequestRejectedError(ErrorCode.NOT_NOW, record_messages.run_is_being_evaluated(run=run_id))
        self._active.add(run_id)
        try:
            await self._worker.run(reevaluate_run, self._database, run_id)
        except Exception as error:
            await asyncio.to_thread(self._store_problem, run_id, f"{type(error).__name__}: {error}")
            raise
        finally:
            self._active.discard(run_id)
        self._events.publish(RunReevaluated(run_id))

    def _load_run(self, run_id: int) -> Run:
        with self._database.reading() as session:
            return runs.get(session, run_id)

    def _store_problem(self, run_id: int, problem: str) -> None:
        with self._database.session() as session:
            runs.set_evaluation_problem(session, run_id, problem)


# Planned signals -----------------------------------------------------------------------------------


EMPTY_PLAN = PlannedSignals(t=[], lines=[], parts=[])
_UNITS = {field.name: field.unit for field in FIELDS}


def read_planned_run(database: Database, run_id: int) -> PlannedSignals:
    """Return the planned references of a run over its whole duration.

    The plan may be an imported text, so this runs in a worker process. Raises UnknownRecordError, SettingError,
    OutOfRangeError, ExperimentError.
    """
    with database.reading() as session:
        run = runs.get(session, run_id)
        try:
            stored = run.set_to.plan
        except UnreadableDocumentError:
            return EMPTY_PLAN
        if stored is None:
            return EMPTY_PLAN
        plan = parse_stored_plan(run.kind, stored)
        followed = ("theta_A_ref", "theta_B_ref") if isinstance(plan, IdentificationPlan) else ("q_ref", "S_ref")
        first_references = _read_first_references(session, run_id, *followed)
    if isinstance(plan, IdentificationPlan):
        try:
            timetable = forecast_identification(
                plan, parse_parameters(run.parameters_name, run.parameters), first_references
            )
        except ParameterError:
            return EMPTY_PLAN
        parts = [
            PlannedPart(title=f"{timetable.title(one)}, {one.stage}", start_s=one.begin * T_s, end_s=one.end * T_s)
            for one in timetable.intervals
        ]
        return PlannedSignals(t=timetable.t.tolist(), lines=_build_lines(timetable.signals), parts=parts)
    program = plan.program()
    if not program.segments:
        return EMPTY_PLAN
    first = program.segments[0]
    found = build_profile(program, *(first_references or (first.q_ref, first.S_ref)))
    pushed = {"F_push": found.F_push} if found.F_push.any() else {}
    return PlannedSignals(
        t=found.t.tolist(),
        lines=_build_lines({"q_ref": found.q_ref, "S_ref": found.S_ref, **pushed}),
        parts=[PlannedPart(title=part.title, start_s=part.start_s, end_s=part.end_s) for part in plan.phases()],
    )


def _build_lines(signals: dict[str, NDArray[np.float64]]) -> list[PlannedLine]:
    return [
        PlannedLine(
            name=name, unit=_UNITS[name], values=[value if math.isfinite(value) else None for value in values.tolist()]
        )
        for name, values in signals.items()
    ]


def _read_first_references(session: Session, run_id: int, one: str, other: str) -> tuple[float, float] | None:
    """Return the references at the start of a run, None if there are none."""
    try:
        samples = read_samples(session, run_id, (one, other), 0.0, T_s)
    except UnknownRecordError:
        return None
    if not len(samples.t):
        return None
    values = float(samples.columns[one][0]), float(samples.columns[other][0])
    return values if math.isfinite(sum(values)) else None


# Conversion of a run to an experiment --------------------------------------------------------------
# The experiment repeats references, pushes, obstacles and changes of the tuning as recorded.


_COLUMNS = ("q_ref", "S_ref", "F_push", "lam_q", "lam_S")
_LAM = ("lam_q", "lam_S")
_DECIMALS = 6
_EVENTS_OF_PARTS = (
    "push",
    *(
        f"{cause}{event}"
        for cause in ("", "by the program: ")
        for event in ("obstacle above ", "obstacle below ", "no obstacle", "wall ", "no wall")
    ),
)
"""First words of events that samples or the stored obstacles reproduce as parts; earlier versions wrote "wall"."""


def build_recorded_experiment(database: Database, run_id: int) -> RecordedExperiment:
    """Return a run as an experiment, with a list of what it does not repeat.

    Raises UnknownRecordError, and ExperimentError if there are no references.
    """
    with database.reading() as session:
        samples = read_samples(session, run_id, _COLUMNS)
        run = runs.get(session, run_id)
        marks = load_marks(session, run_id).marks
        bank = _find_own_bank(session, run)
    columns = {name: column.astype(float) for name, column in samples.columns.items()}
    first, end = find_commanded_range(columns["q_ref"], columns["S_ref"])
    cut = {name: column[first:end] for name, column in columns.items()}
    t = samples.t[first:end]
    made = _RunConversion(t, cut, run, marks, bank)
    found = approximate_columns(cut["q_ref"], cut["S_ref"], np.nan_to_num(cut["F_push"]), made.collect_changes())
    made.report_missing_pushes(found, cut["F_push"])
    document = {
        "format": FORMAT,
        "name": f"as_run_{run_id}",
        "title": record_messages.title_of_recorded_experiment(run=run_id),
        "description": _describe_recorded(run_id, found),
        **({} if made.law is Law.CASCADE else {"law": str(made.law)}),
        "phases": [{"name": "recorded", "title": "Recorded", "parts": found.parts}],
    }
    text = json.dumps(document, ensure_ascii=False, indent=1)
    return RecordedExperiment(text=text, document=document, left_out=made.left_out)


def _describe_recorded(run_id: int, found: RecordedParts) -> str:
    return record_messages.recorded_references(
        run=run_id,
        deviation_q=found.deviation_q_rad,
        deviation_S=found.deviation_S,
        deviation_F=found.deviation_F_N if any(part["do"] == "push" for part in found.parts) else None,
        delay_ticks=found.delay_ticks,
    )


def _find_own_bank(session: Session, run: Run) -> int | None:
    """Return this station's number of the bank at the start of a run.

    0 stands for geometric gains, None for a bank that this station does not have.
    """
    if run.set_to.loop.bank in (None, 0):
        return run.set_to.loop.bank
    try:
        return None if run.bank_id is None else banks.own(session, run.bank_id).id
    except UnknownRecordError:
        return None


class _RunConversion:
    """Converts tuning, obstacles and events of a run into parts of an experiment.

    ``left_out`` lists what cannot be repeated.
    """

    def __init__(
        self,
        t: np.ndarray[Any, np.dtype[np.float64]],
        columns: Mapping[str, Column],
        run: Run,
        marks: Sequence[RunMark],
        bank: int | None,
    ) -> None:
        self._t, self._columns, self._run, self._marks, self._bank = t, columns, run, marks, bank
        self.left_out: list[str] = []
        self.law = _select_law(run)
        missing = round((t[-1] - t[0]) / T_s) + 1 - len(t)
        if missing > 0:
            self.left_out.append(record_messages.samples_missing(count=missing))

    def collect_changes(self) -> list[ReferenceChange]:
        """Return changes of tuning and obstacle in order of their ticks."""
        tunings = self._limit_count(self._collect_tunings(), MAX_TUNINGS, "tuning")
        walls = self._limit_count(self._collect_walls(), MAX_WALLS, "obstacle")
        self._report_missing_marks()
        self._report_missing_program()
        return sorted([*tunings, *walls], key=lambda change: change.tick)

    def report_missing_pushes(self, found: RecordedParts, F_push: Column) -> None:
        """Add to ``left_out`` the pushes that the experiment lacks."""
        for begin, end in found.unpushed:
            force, begins, ends = F_push[begin], self._t[begin], self._t[min(end, len(self._t) - 1)]
            self.left_out.append(record_messages.push_not_repeated(F_push=force, begin_s=begins, end_s=ends))

    def _limit_count(self, changes: list[ReferenceChange], most: int, subject: str) -> list[ReferenceChange]:
        if len(changes) > most:
            message = record_messages.too_many_changes(subject=subject, count=len(changes), maximum=most)
            self.left_out.append(message)
        return changes[:most]

    def _collect_tunings(self) -> list[ReferenceChange]:
        """Return the first tuning and all changes: λ from samples, the rest from events."""
        parts: dict[int, dict[str, Any]] = {0: self._build_first_tuning()}
        for name in _LAM:
            column = np.round(self._columns[name], _DECIMALS)
            for change in np.flatnonzero(np.diff(column)) + 1:
                parts.setdefault(int(change), {})[name] = float(column[change])
        for mark in self._marks:
            changed = parse_changes(mark.text) if mark.kind == EventKind.TUNING else None
            tick = self._find_tick(mark.t)
            if changed is None or tick is None:
                continue
            others = {name: value for name, value in changed.items() if name not in _LAM}
            for name in ("k_ext", "bank"):
                if name in others and others.pop(name):
                    self.left_out.append(record_messages.event_not_repeated(t=mark.t, event=mark.text))
            if others:
                parts.setdefault(tick, {}).update(others)
        return [ReferenceChange(tick, {"do": "tuning", **parts[tick]}) for tick in sorted(parts) if parts[tick]]

    def _build_first_tuning(self) -> dict[str, Any]:
        loop: StoredLoopSettings = self._run.set_to.loop
        known = {name: value for name, value in loop.get_known_values().items() if name != "seed"}
        if loop.motion == LAMBDA:
            known.pop("u_plan", None)
        if known.pop("k_ext", 0.0):
            self.left_out.append(record_messages.bias_not_recorded())
        if known.pop("bank", 0) and self._bank is None:
            self.left_out.append(record_messages.bank_of_other_station(bank=loop.bank))
        if self._bank is not None:
            known["bank"] = self._bank
        first = {name: round(float(self._columns[name][0]), _DECIMALS) for name in _LAM}
        return {**known, **{name: value for name, value in first.items() if np.isfinite(value)}}

    def _collect_walls(self) -> list[ReferenceChange]:
        """Return the changes of the obstacle, without obstacles beyond which q_ref lies."""
        due: dict[int, StoredWall] = {}
        for stored in self._run.set_to.walls or ():
            tick = int(np.searchsorted(self._t, stored.t - 0.5 * T_s))
            if tick < len(self._t):
                due[max(tick, PART_MIN_TICKS)] = stored  # the first part moves the joint to its start
        found: list[ReferenceChange] = []
        has_obstacle = False
        for tick, stored in sorted(due.items()):
            wall = stored.obstacle
            q_ref = float(self._columns["q_ref"][min(tick, len(self._t)) - 1])
            if wall is not None and stored.side * (q_ref - stored.q_wall) >= 0.0:
                begin_s = float(self._t[tick])
                self.left_out.append(
                    record_messages.obstacle_not_repeated(q_wall=stored.q_wall, begin_s=begin_s, q_ref=q_ref)
                )
                wall = None
            if wall is not None:
                side = "above" if wall.side > 0.0 else "below"
                part = {"do": "wall", "q_wall": wall.q_wall, "side": side, "k_wall": wall.k_wall, "c_wall": wall.c_wall}
                found.append(ReferenceChange(tick, part))
            elif has_obstacle:
                found.append(ReferenceChange(tick, {"do": "no_wall"}))
            has_obstacle = wall is not None
        return found

    def _report_missing_marks(self) -> None:
        """Add to ``left_out`` the events that no part reproduces."""
        for mark in self._marks:
            if mark.kind in (EventKind.MODE, EventKind.REFERENCES) or self._find_tick(mark.t) is None:
                continue
            reproduced = mark.kind == EventKind.NOTE and mark.text.startswith(_EVENTS_OF_PARTS)
            reproduced |= mark.kind == EventKind.TUNING and (
                parse_changes(mark.text) is not None or mark.text.startswith("by the program")
            )
            if not reproduced:
                self.left_out.append(record_messages.event_not_repeated(t=mark.t, event=mark.text))

    def _report_missing_program(self) -> None:
        """Add to ``left_out`` what the program did without a record of it."""
        stored = self._run.set_to.plan
        if stored is None or self._run.set_to.experiment is None:
            return
        try:
            plan = parse_stored_plan(self._run.kind, stored)
        except (ValueError, UnreadableDocumentError):
            self.left_out.append(record_messages.program_not_readable())
            return
        if not isinstance(plan, ExperimentPlan):
            return
        compiled = plan.compiled
        if any(segment.load_A or segment.load_B for segment in compiled.segments):
            self.left_out.append(record_messages.loads_not_recorded())
        if compiled.contact_detections:
            self.left_out.append(record_messages.contact_not_repeated())
        others = {name for change in compiled.changes for name in change if name not in _LAM}
        if others:
            self.left_out.append(record_messages.changes_not_recorded(names=sorted(others)))

    def _find_tick(self, t: float) -> int | None:
        """Return the tick of a time [s] within the references, None outside of them."""
        if not self._t[0] - 0.5 * T_s <= t <= self._t[-1] + 0.5 * T_s:
            return None
        return min(int(np.searchsorted(self._t, t - 0.5 * T_s)), len(self._t) - 1)


def _select_law(run: Run) -> Law:
    """Return the control law with which an experiment repeats a run."""
    if run.set_to.mode == Mode.COMPLIANCE:
        return Law.COMPLIANCE
    law = run.set_to.law
    return Law(law) if law in LAWS else Law.CASCADE


# Replay in the 3D view -----------------------------------------------------------------------------
# All clients share one view; it shows the moment that was requested last.


_REPLAY_COLUMNS = ("q", "q_ref", "S", "theta_A", "theta_B", "F_A", "F_B", "F_push", "F_ext_hat", "F_wall")


class ReplayView:
    """Stores one row of a recording, as a sample, and the obstacle at that time.

    Requests write it from their threads, the 3D view reads it from its own.
    """

    def __init__(self, database: Database) -> None:
        self._database = database
        self._shown: tuple[NDArray[np.float64] | None, Obstacle | None] = None, None

    def get_row(self) -> NDArray[np.float64] | None:
        """Return the shown sample, one value per field; None before the first request."""
        return self._shown[0]

    def get_wall(self) -> Obstacle | None:
        """Return the obstacle at the shown moment; None for none or unknown."""
        return self._shown[1]

    def show(self, run_id: int, t: float) -> None:
        """Show the sample at ``t`` [s] of a run. Raises UnknownRecordError.

        Beyond the end of the run the view does not change.
        """
        shown = self._read(run_id, t)
        if shown is not None:
            self._shown = shown

    def show_flight(self, event_id: int, t: float) -> None:
        """Show the sample of a flight record nearest to ``t`` [s] from its trip.

        Raises UnknownRecordError.
        """
        columns = read_flight_columns(self._database, event_id)
        if columns["t"].size:
            nearest = int(np.argmin(np.abs(columns["t"] - t)))
            self._shown = (
                _build_row({name: columns[name][nearest] for name in _REPLAY_COLUMNS if name in columns}),
                None,
            )

    def _read(self, run_id: int, t: float) -> tuple[NDArray[np.float64], Obstacle | None] | None:
        with self._database.reading() as session:
            samples = read_samples(session, run_id, _REPLAY_COLUMNS, t, t + T_s)
            walls = runs.get(session, run_id).set_to.walls or ()
        if not len(samples.t):
            return None
        row = _build_row({name: column[0] for name, column in samples.columns.items()})
        return row, find_wall_at(walls, float(samples.t[0]) + 0.5 * T_s)


def _build_row(values: Mapping[str, float]) -> NDArray[np.float64]:
    row = np.full(len(NAMES), np.nan)
    for name, value in values.items():
        row[INDEX[name]] = value
    return row


# Event log -----------------------------------------------------------------------------------------


class StoredTimeline:
    """Reads the event log of one station from the database."""

    def __init__(self, database: Database) -> None:
        self._database = database

    def load_page(self, query: LogQuery, limit: int) -> Timeline:
        """Return the newest entries of a query."""
        with self._database.reading() as session:
            found, more_before = timeline.find(session, query, limit)
            total = len(found) if more_before is None else timeline.count(session, query)
        return Timeline(entries=found, total=total, more_before=more_before)

    def set_remark(self, event_id: int, note: EventNote, who: str) -> None:
        """Set note and tags of an event.

        Raises UnknownRecordError, TagError, RequestRejectedError.
        """
        with self._database.session() as session:
            timeline.remark(session, event_id, note.note.strip(), note.tags, who)


# Views ---------------------------------------------------------------------------------------------
# Build the interface's schemas from stored records.


def build_run_view(
    run: Run,
    evaluation: EvaluationView,
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
    """Return a run with the extent of its recording.

    ``fits`` are the fits [%] of the channels that were identified from it. Unreadable settings become the evaluation
    problem.
    """
    judged = result is not None or not (run.kind == RunKind.SESSION or run.end_state == EndState.RUNNING)
    metrics, criteria = (None, ()) if result is None else (result.metrics, result.criteria)
    headline = find_headline(metrics, criteria, fits)
    settings, problem = [], run.evaluation_problem
    try:
        settings = list(select_used_settings(run))
    except UnreadableDocumentError as error:
        problem = problem or str(error)
    return RunView(
        id=run.id,
        kind=run.kind,
        title=run_title(run),
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
        outcome=judge_run(metrics, criteria) if judged else None,
        headline=headline,
    )


def build_samples_view(run_id: int, envelope: reader.SampleEnvelope, *, raw: bool) -> SamplesView:
    """Return an envelope of samples; NaN becomes null."""
    return SamplesView(
        run=run_id,
        raw=raw,
        width_s=envelope.width_s,
        t=envelope.t.tolist(),
        signals={
            name: SignalEnvelope(
                unit=envelope.units[name],
                minimum=_replace_nan(envelope.minimum[name]),
                maximum=_replace_nan(envelope.maximum[name]),
            )
            for name in envelope.minimum
        },
    )


def build_bank_view(
    bank: Bank, runs_of: Mapping[int, int | None], positions: Mapping[int, float], in_use: int | None
) -> BankView:
    """Return a bank with the runs and joint positions of its estimates.

    ``runs_of`` and ``positions`` map the number of an estimate to its run and its joint position; ``in_use`` is the
    active bank.
    """
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
                **{name: getattr(build_point_model(entry), name) for name in MODEL_NAMES},
            )
            for entry in bank.entries
        ],
    )


def build_experiment_view(run: Run, result: Result | None, progress: float) -> ExperimentView:
    """Return an experiment run with its metrics and criteria, if computed."""
    return ExperimentView(
        id=run.id,
        name=run_experiment_name(run),
        title=run_title(run),
        status=run.end_state,
        created=run.started_at,
        progress=progress,
        settings={name: value for name, value in run.set_to.get_values().items() if name != "experiment"},
        **_build_judgement(run, result),
        message=build_run_message(run, result),
    )


def build_dry_run_view(
    run: Run,
    result: Result | None,
    curves: reader.SampleEnvelope | None,
    duration_s: float,
    settings: dict[str, SettingValue],
) -> DryRunView:
    """Return the result of a dry run; its run is not stored."""
    samples = None if curves is None else build_samples_view(run.id, curves, raw=False)
    return DryRunView(
        status=run.end_state,
        message=build_run_message(run, result),
        duration_s=duration_s,
        settings=settings,
        **_build_judgement(run, result),
        samples=samples,
    )


def _build_judgement(run: Run, result: Result | None) -> dict[str, Any]:
    metrics, criteria = (None, ()) if result is None else (result.metrics, result.criteria)
    running = "" if run.ended_at is not None else record_messages.run_still_in_progress()
    found = judge_stored_run(metrics, criteria, run.evaluation_problem or running)
    return {
        "outcome": found.outcome,
        "verdict": found.sentence,
        "metrics": list(metrics.figures if metrics else ()),
        "criteria": [_build_criterion(item) for item in criteria],
    }


def _build_criterion(item: RunCriterion) -> Criterion:
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


def build_run_message(run: Run, result: Result | None) -> str:
    """Return how a run ended, or why it has no result."""
    if result is None and run.evaluation_problem:
        return ". ".join(filter(None, (run.end_detail, record_messages.not_evaluated(reason=run.evaluation_problem))))
    return run.end_detail or ("" if result is None else result.metrics.problem)


def _replace_nan(values: NDArray[np.float32]) -> list[float | None]:
    return [value if math.isfinite(value) else None for value in values.tolist()]


def build_flight_view(flight: Flight) -> FlightView:
    """Return a flight record with its duration before and after the trip or trigger."""
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


# Stored runs ---------------------------------------------------------------------------------------


@dataclass(frozen=True)
class SampleSlice:
    """Signals of a recording between two times [s], in about ``points`` buckets."""

    run: int
    from_s: float
    to_s: float
    points: int
    signals: Sequence[str]


@dataclass(frozen=True)
class RunQuery:
    """Filter, page and station of a list of runs."""

    kinds: Sequence[str] = ()
    """Kinds of runs; empty: all."""

    search: str = ""
    """Words that the runs contain, separated by spaces."""

    where: Sequence[str] = ()
    """Queries that the runs fit, all of them."""

    everywhere: bool = False
    """Whether runs of all stations are found, not of this one only."""

    limit: int = 100
    offset: int = 0

    def build_query(self) -> Query:
        """Return the filter as one query.

        Raises RequestRejectedError for an unknown kind, QueryError.
        """
        for unknown in (one for one in self.kinds if one not in set(RunKind)):
            message = record_messages.unknown_kind_of_runs(kind=unknown)
            raise RequestRejectedError(ErrorCode.BAD_VALUE, message, legal=[str(known) for known in RunKind])
        of_kind = [Compare(Value("kind", 0), Op.EQUAL, tuple(Value(kind, 0) for kind in self.kinds))]
        words = [Word(Value(word, 0)) for word in self.search.split()]
        require_printable(self.search)
        return All((*map(parse_query, self.where), *(of_kind if self.kinds else []), *words))


class StoredRuns:
    """Reads and writes the runs of the database.

    Methods that are not coroutines wait for the disk: the event loop calls them in a thread. ``task`` returns what the
    service is executing, ``is_evaluated`` whether a run's result is being computed. Reads of very many samples run in
    ``worker``, if there is one.
    """

    def __init__(
        self,
        database: Database,
        task: Callable[[], TaskView | None],
        is_evaluated: Callable[[int], bool],
        worker: WorkerProcess | None = None,
    ) -> None:
        self._database = database
        self._worker = worker
        self._task = task
        self._is_evaluated = is_evaluated

    def find_runs(self, query: RunQuery) -> RunList:
        """Return a page of runs, newest first.

        Raises RequestRejectedError for an unknown kind, QueryError.
        """
        search_query = query.build_query()
        with self._database.reading() as session:
            page = run_search.search(
                session, search_query, everywhere=query.everywhere, limit=query.limit, offset=query.offset
            )
            views = self._build_views(session, runs.of_numbers(session, page.run_ids))
            return RunList(runs=views, total=page.total)

    def load_run(self, run_id: int) -> RunView:
        """Return one run. Raises UnknownRecordError."""
        with self._database.reading() as session:
            return self._build_views(session, [runs.get(session, run_id)])[0]

    def set_note(self, run_id: int, note: str) -> RunView:
        """Set the note of a run. Raises UnknownRecordError."""
        with self._database.session() as session:
            runs.set_note(session, run_id, note)
        return self.load_run(run_id)

    def list_flights(self) -> FlightList:
        """Return the newest flight records."""
        with self._database.reading() as session:
            return FlightList(flights=[build_flight_view(flight) for flight in flights.find(session)])

    def load_experiment(self, run_id: int) -> ExperimentView:
        """Return an experiment run with its result. Raises UnknownRecordError."""
        with self._database.reading() as session:
            run = runs.get(session, run_id)
            return build_experiment_view(run, results.newest(session, run_id), self.compute_progress(run))

    async def load_samples(self, query: SampleSlice) -> SamplesView:
        """Return samples or their envelope. Raises UnknownRecordError, UnknownSignalError."""
        envelope, raw = await self._read_envelope(query)
        return await asyncio.to_thread(partial(build_samples_view, query.run, envelope, raw=raw))

    async def pack_samples(self, query: SampleSlice) -> bytes:
        """Return the same in the binary format of ``backend.wire``. Raises the same."""
        envelope, raw = await self._read_envelope(query)
        return await asyncio.to_thread(_pack_envelope, envelope, raw, query.signals)

    async def _read_envelope(self, query: SampleSlice) -> tuple[SampleEnvelope, bool]:
        if self._worker is not None and await asyncio.to_thread(self._count_samples, query) > AT_HAND_SAMPLES:
            return await self._worker.run(read_slice_envelope, self._database, query)
        return await asyncio.to_thread(read_slice_envelope, self._database, query)

    def _count_samples(self, query: SampleSlice) -> float:
        """Return how many samples must be read, 0 if stored summaries suffice."""
        if all(name in STORED_NAMES for name in query.signals):
            return 0.0
        with self._database.reading() as session:
            recording, span = recordings.get(session, query.run), recordings.span(session, query.run)
        length_s = (span.end_tick - span.first_tick) * recording.period_s
        return (min(query.to_s, length_s) - min(query.from_s, length_s)) / recording.period_s

    def _build_views(self, session: Session, found: Sequence[Run]) -> list[RunView]:
        """Return runs with their tags and the extents of their recordings."""
        numbers = [run.id for run in found]
        newest, tagged = results.load_newest(session, numbers), tags.of_runs(session, numbers)
        fits = identifications.fits_of_runs(session, numbers)
        recorded, imported = recordings.of_runs(session, numbers), origins.of_runs(session, numbers)

        def view_of(run: Run) -> RunView:
            origin = imported[run.id].sentence if run.id in imported else ""
            evaluation = self._get_evaluation_state(run, run.id in newest)
            tagged_with, result = tagged.get(run.id, []), newest.get(run.id)
            reproduced = partial(build_run_view, tags=tagged_with, origin=origin, result=result, fits=fits.get(run.id))
            view = partial(reproduced, run, evaluation)
            return _add_extent(view, recorded.get(run.id))

        return [view_of(run) for run in found]

    def _get_evaluation_state(self, run: Run, has_result: bool) -> EvaluationView:
        task = self._task()
        if run.kind == RunKind.SESSION or run.end_state == EndState.RUNNING:
            return EvaluationView.NONE
        if self._is_evaluated(run.id) or (task is not None and task.run == run.id):
            return EvaluationView.UNDER_WAY
        return EvaluationView.DONE if has_result else EvaluationView.MISSING

    def compute_progress(self, run: Run) -> float:
        """Return the progress of a run, from 0 to 1."""
        task = self._task()
        if task is None or task.run != run.id:
            return 1.0
        return min(0.99, task.elapsed_s / task.duration_s)


def read_slice_envelope(database: Database, query: SampleSlice) -> tuple[SampleEnvelope, bool]:
    """Return the envelope of a slice, and whether its buckets are single samples.

    Raises as ``load_samples`` does.
    """
    with database.reading() as session:
        period_s = recordings.get(session, query.run).period_s
        envelope = read_envelope(
            session=session,
            run_id=query.run,
            points=query.points,
            names=query.signals,
            from_s=query.from_s,
            to_s=query.to_s,
        )
    return envelope, envelope.width_s <= 1.5 * period_s


def _pack_envelope(envelope: SampleEnvelope, raw: bool, signals: Sequence[str]) -> bytes:
    first = round(float(envelope.t[0]) / envelope.width_s) if envelope.t.size else 0
    extremes = (envelope.minimum,) if raw else (envelope.minimum, envelope.maximum)
    return wire.pack_curves(first, envelope.width_s, [[part[name] for part in extremes] for name in signals])


def _add_extent(view: Callable[..., RunView], recorded: tuple[Recording, Extent | None] | None) -> RunView:
    """Return the view of a run with the extent of its recording."""
    if recorded is None:
        return view(samples=0, duration_s=0.0, missed=0)
    recording, extent = recorded
    if extent is None:
        return view(0, 0.0, recording.missed, recording.removed_at)
    duration_s = (extent.end_tick - extent.first_tick) * recording.period_s
    return view(extent.count, duration_s, recording.missed, recording.removed_at)
