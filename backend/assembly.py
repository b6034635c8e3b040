"""All parts of the service, put together over what the loop starts from."""

import asyncio
from collections.abc import Callable, Coroutine
from contextlib import AsyncExitStack
from dataclasses import dataclass
from functools import partial
from typing import Any

from fastapi import APIRouter

from backend.analysis.evaluation import evaluate
from backend.api.auth import signed_in
from backend.api.service import Service
from backend.archive.downloads import Downloads
from backend.archive.evaluations import Evaluations
from backend.archive.figures import RecordedFigures
from backend.archive.formulas import Formulas
from backend.archive.history import History
from backend.archive.maintenance import Maintenance
from backend.archive.own_experiments import OwnExperiments
from backend.archive.played_recording import played_recording
from backend.archive.preferences import StoredPreferences
from backend.archive.replay import Replay
from backend.archive.retention import PART as RETENTION
from backend.archive.retention import Retention
from backend.archive.run_library import RunLibrary
from backend.archive.stored_banks import StoredBanks
from backend.archive.stored_identifications import StoredIdentifications
from backend.archive.stored_runs import StoredRuns
from backend.archive.timeline import StoredTimeline
from backend.auth.authentication import PART as TOKENS
from backend.auth.authentication import Authentication
from backend.auth.control_lease import PART as CONTROL
from backend.auth.control_lease import Control
from backend.auth.handover import PART as HAND_OVER
from backend.auth.handover import HandOver
from backend.data_folder import PART as FOLDER
from backend.data_folder import FolderWatch, HeldFolder
from backend.execution.runner import Station
from backend.faults import Fault
from backend.operating.actuator import Actuator
from backend.operating.applied import Applied
from backend.operating.bring_up import BringUp
from backend.operating.chart_sheets import ChartSheets
from backend.operating.dry_runs import DryRuns
from backend.operating.foundation import SEED, Foundation
from backend.operating.journal import PART as JOURNAL
from backend.operating.journal import Journal
from backend.operating.live_stream import PART as LIVE
from backend.operating.live_stream import LiveStream
from backend.operating.ordered_runs import OrderedRuns
from backend.operating.present_state import PresentState
from backend.operating.refusals import Refusals
from backend.operating.safe_stop import SafeStop
from backend.operating.saved_tunings import SavedTunings
from backend.operating.session_runs import SessionRuns
from backend.operating.studies_under_way import StudiesUnderWay
from backend.operating.text_work import TextWork
from backend.operating.triggers import Triggers
from backend.operating.tuning_in_use import TuningInUse
from backend.recording.flight import PART as FLIGHTS
from backend.recording.flight import FlightRecorder, Quota
from backend.recording.recorder import Recorder
from backend.recording.retention import Rule
from backend.recording.trigger import PART as TRIGGER
from backend.recording.trigger import Heard, Trigger
from backend.scene.model import PART as SCENE
from backend.scene.model import SceneMirror
from backend.scene.proxy import router as scene_router
from backend.schemas.state import EventMessage, MarkKind, StateMessage
from backend.settings import Settings
from backend.storage.events import EventKind
from backend.supervision import KeptThread, Part, Supervision
from backend.workers import SCIENCE, Processes
from plant.interface import PlantKind
from plant.parameters import PlantParameters


@dataclass(frozen=True)
class Assembled:
    """What serves, records and logs, the routes of the 3D views, and ``draw``, which shows these once that can wait."""

    service: Service
    recorder: Recorder
    journal: Journal
    scenes: list[APIRouter]
    draw: Callable[[], None]


def assemble(  # noqa: PLR0915  # a list of constructions, each in need of those above it
    settings: Settings,
    foundation: Foundation,
    folder: HeldFolder,
    authentication: Authentication,
    supervision: Supervision,
    stack: AsyncExitStack,
) -> Assembled:
    """Put all parts together, each taken down again by ``stack``, in reverse."""

    def keep(
        part: Part, work: Callable[[], Coroutine[Any, Any, None]], on_death: Callable[[], None] | None = None
    ) -> None:
        stack.push_async_callback(supervision.keep_task(part, work, on_death).end)

    parameters, database, kept, tuning = foundation.parameters, foundation.database, foundation.kept, foundation.tuning
    soundness, hands, supervisor = foundation.soundness, foundation.hands, foundation.supervisor
    recorder = Recorder(database, supervisor.ring)
    supervisor.listen(recorder.hear)

    quota = Quota(settings.flight_records, settings.flight_records_MB * 1_000_000)
    flights = FlightRecorder(database, lambda: supervisor.ring, quota, lambda fault: present.is_expected(fault))
    supervisor.listen(flights.hear)
    stack.callback(flights.close)
    keep(FLIGHTS, flights.run)

    trigger = Trigger(database, lambda: supervisor.ring, quota, lambda: _lengths(present))
    stack.callback(trigger.close)
    keep(TRIGGER, trigger.run)

    def problems() -> list[str]:
        first = watch, soundness, recorder, flights, trigger, journal
        sweep = actuator.touching.sweep
        parts = *first, supervisor.guard, retention, authentication.sessions, bring_up, hands, sweep
        return [*(part.problem for part in parts if part.problem), *supervision.problems, *ordered_runs.problems]

    retention = Retention(database, Rule(round(settings.recordings_GB * 1e9), settings.recordings_keep_days))
    keep(RETENTION, retention.run)

    journal = Journal(database)
    stack.callback(journal.close)
    keep(JOURNAL, journal.run)
    refusals = Refusals(journal, asyncio.get_running_loop().call_later)
    stack.callback(refusals.close)
    authentication.tell = partial(journal.record, EventKind.ACCESS)
    if foundation.said:
        journal.note(MarkKind.TUNING, foundation.said, tick=0)
    present = PresentState(supervisor, parameters, tuning, problems)
    supervision.listen(lambda death: journal.note(MarkKind.FAULT, death, present.tick))
    safe_stop = SafeStop(supervisor, present, supervision)
    sessions = SessionRuns(database, settings.plant_choice.name)
    choice = settings.plant_choice
    recording = played_recording(choice.recording, database) if choice.kind is PlantKind.REPLAY else None
    actuator = Actuator(supervisor, present, sessions, journal, kept, recorder.follow, supervision, hands, recording)
    control = Control(actuator.operator_lost, actuator.note_control)
    control.let_go = actuator.let_go
    control.holder_changed = partial(actuator.retuning.leave_trial, "as the holder of control has changed")

    def say_of_control(text: str, who: str) -> None:
        """Put on record what is asked and answered: nothing on the time axis, where control itself is a mark."""
        journal.record(EventKind.NOTE, text, who)
        actuator.changed()

    hand_over = HandOver(control, authentication.people, say_of_control)
    present.holder, present.people, present.wishes = control.view, authentication.people.view, hand_over.view
    keep(TOKENS, authentication.run)
    stack.push_async_callback(authentication.sessions.save)
    keep(CONTROL, control.run, lambda: safe_stop.begin(Fault.OPERATOR_LOST))
    keep(HAND_OVER, hand_over.run)
    live = LiveStream(lambda: supervisor.ring, lambda: StateMessage(**dict(present.state())))
    journal.on_mark(live.announce)
    actuator.on_change(live.state_changed)
    keep(LIVE, live.run)
    triggers = Triggers(trigger, actuator, journal, database)
    present.trigger = triggers.view

    def triggered(tick: int, text: str) -> None:
        live.announce(EventMessage(tick=tick, kind=MarkKind.TRIGGER, text=text))

    trigger.heard = Heard(triggered, actuator.changed)
    watch = FolderWatch((folder.problem, soundness.displaced, foundation.claim.problem), actuator.changed)
    keep(FOLDER, watch.run)
    soundness.start()

    history = History(database, parameters, lambda: _id_of_bank(present.operators_tuning))
    processes = Processes(supervision)
    stack.callback(processes.close)
    evaluations = Evaluations(database, processes.evaluations, lambda: present.task)
    downloads = Downloads(database, processes.reports, settings.data, evaluations.again)
    stored_runs = StoredRuns(
        database,
        lambda: present.task,
        lambda run: evaluations.includes(run) or ordered_runs.is_evaluating(run),
        processes.reports,
    )
    banks = StoredBanks(database, processes.computing, lambda: present.tuning)
    station = Station(supervisor, database, settings.plant_choice.name, parameters, processes.computing.run)

    def prepare() -> None:
        """Load what evaluation and report need while the program still plays."""
        processes.computing.prepare(evaluate, *SCIENCE)
        downloads.prepare()

    experiments = OwnExperiments(database)
    texts = TextWork(processes.texts, processes.viewers_texts)
    dry_runs = DryRuns(processes.dry_runs)
    ordered_runs = OrderedRuns(
        station, actuator, banks, experiments, prepare, SEED, dry_runs, texts, supervision, safe_stop
    )
    evaluations.done = ordered_runs.evaluated

    replay = Replay(database)
    mirrors = {
        "/scene": SceneMirror(parameters, lambda: supervisor.ring.newest(), lambda: present.wall),
        "/replay": SceneMirror(parameters, replay.row, replay.wall),
    }
    drawing: list[KeptThread] = []
    for mirror in mirrors.values():
        stack.callback(mirror.close)

    def clear_away() -> None:
        for kept in drawing:
            kept.end(2.0)

    stack.callback(clear_away)

    def draw() -> None:
        drawing.extend(supervision.keep_thread(SCENE, mirror.run, mirror.end) for mirror in mirrors.values())

    scenes = [scene_router(signed_in, mirror, path) for path, mirror in mirrors.items()]
    bring_up = BringUp(actuator, supervisor, database, parameters, hands)
    stack.push_async_callback(bring_up.close)
    studies = StudiesUnderWay(
        database, parameters, lambda: present.operators_tuning.choice, processes.studies, processes.reports, texts
    )
    stack.push_async_callback(studies.close)

    def use(changed: PlantParameters) -> None:
        station.parameters = changed
        for heard in (history.use, bring_up.use, studies.use, *(mirror.use for mirror in mirrors.values())):
            heard(changed)

    service = Service(
        applied=Applied(actuator, supervisor, database, kept, foundation.base, use),
        actuator=actuator,
        control=control,
        hand_over=hand_over,
        ordered_runs=ordered_runs,
        experiments=experiments,
        saved_tunings=SavedTunings(database),
        bring_up=bring_up,
        live=live,
        refusals=refusals,
        runs=stored_runs,
        figures=RecordedFigures(database),
        run_library=RunLibrary(database),
        identifications=StoredIdentifications(
            database, stored_runs.progress, processes.computing, lambda: present.tuning
        ),
        evaluations=evaluations,
        banks=banks,
        preferences=StoredPreferences(database),
        history=history,
        timeline=StoredTimeline(database),
        replay=replay,
        texts=texts,
        sheets=ChartSheets(processes.sheets),
        dry_runs=dry_runs,
        database=database,
        downloads=downloads,
        maintenance=Maintenance(database, settings.data, supervisor),
        retention=retention,
        studies=studies,
        triggers=triggers,
        formulas=Formulas(database),
    )
    return Assembled(service, recorder, journal, scenes, draw)


def _lengths(present: PresentState) -> dict[str, float]:
    geometry = present.parameters.geometry
    return {"r_m": geometry.r_m, "r_j": geometry.r_j}


def _id_of_bank(tuning: TuningInUse) -> int | None:
    return None if tuning.bank is None else tuning.bank.id
