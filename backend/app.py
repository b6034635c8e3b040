"""Builds the parts of the service, in two steps around the start of the loop."""

import asyncio
import logging
from collections.abc import Callable, Coroutine
from contextlib import AsyncExitStack
from dataclasses import dataclass
from typing import Any

from fastapi import APIRouter

from backend.analysis import evaluate_finished_run
from backend.api import Service, require_signed_in
from backend.auth import AUTHENTICATION_PART as TOKENS
from backend.auth import CONTROL_LEASE_PART as CONTROL
from backend.auth import HANDOVER_PART as HAND_OVER
from backend.auth import AccessChanged, Authentication, ControlHandover, ControlLease, ControlReleased, HolderChanged
from backend.commissioning import DriveLockout, find_completed_commissioning
from backend.data_folder import DATA_FOLDER_PART as FOLDER
from backend.data_folder import DataFolderMonitor, LockedFolder
from backend.event_bus import EventBus, StateChanged
from backend.execution import ExperimentRig
from backend.faults import Fault
from backend.models import UnreadableDocumentError
from backend.realtime import LoopProcess, Setup, Supervisor
from backend.recording import FLIGHT_RECORDER_PART as FLIGHTS
from backend.recording import TRIGGER_PART as TRIGGER
from backend.recording import FlightRecorder, Quota, Recorder, RetentionRule, Trigger, Triggered
from backend.scene import SCENE_PART as SCENE
from backend.scene import SceneMirror
from backend.scene import create_scene_router as scene_router
from backend.schemas import EventMessage, MarkKind, StateMessage
from backend.services import EVENT_LOG_PART as JOURNAL
from backend.services import LIVE_STREAM_PART as LIVE
from backend.services import MAINTENANCE_PART as RETENTION
from backend.services import (
    ActiveTuning,
    ActuatorService,
    AppliedVersion,
    ChartSheets,
    CommissioningService,
    DatabaseMonitor,
    Downloads,
    DryRuns,
    Evaluations,
    EventLog,
    Formulas,
    JobManager,
    LiveState,
    LiveStream,
    Maintenance,
    MarkAdded,
    OwnExperiments,
    ParametersApplied,
    ParameterService,
    RangeAnalysis,
    RejectionLog,
    ReplayView,
    Retention,
    RobustnessCache,
    RunHistory,
    RunLibrary,
    RunReevaluated,
    SafeStop,
    SavedTunings,
    ServiceState,
    SessionRuns,
    StoredBanks,
    StoredIdentifications,
    StoredPreferences,
    StoredRuns,
    StoredTimeline,
    StudyScheduler,
    TextWork,
    Triggers,
    TuningStore,
    build_identified_sections,
    describe_recording,
    find_last_applicant,
    list_parameter_versions,
)
from backend.settings import Settings
from backend.storage import (
    Database,
    EventKind,
    HeldClaim,
    runs,
)
from backend.supervision import Part, SupervisedThread, Supervision
from backend.workers import NUMERIC_LIBRARIES, WorkerProcesses
from plant import ParameterError, PlantKind, PlantParameters

# Boot ----------------------------------------------------------------------------------------------
# Loads what the control loop needs to start: parameters, tuning, commissioning, drive lockout.


SEED = 0

_log = logging.getLogger(__name__)


@dataclass(frozen=True)
class BootContext:
    """Parts that exist before the control loop starts."""

    file_parameters: PlantParameters
    """Parameters of the file."""

    parameters: PlantParameters
    """Active parameters: those of the file with the applied identifications."""

    database: Database
    claim: HeldClaim
    database_monitor: DatabaseMonitor
    robustness_cache: RobustnessCache
    tuning_store: TuningStore
    tuning: ActiveTuning
    tuning_message: str
    """Message for the event log on restored parameters and tuning, or ""."""

    drive_lockout: DriveLockout
    supervisor: Supervisor


def bootstrap(
    *,
    settings: Settings,
    file_parameters: PlantParameters,
    database: Database,
    claim: HeldClaim,
    launched: LoopProcess,
    supervision: Supervision,
    stack: AsyncExitStack,
) -> BootContext:
    """Load what the loop process ``launched`` needs from the database.

    ``stack`` closes what was opened. Raises StorageError, ParameterError and TuningError.
    """
    database_monitor = DatabaseMonitor(database, settings.data)
    database_monitor.check_small_database()
    _close_interrupted(database)
    robustness_cache = RobustnessCache()
    robustness_cache.load()
    stack.callback(robustness_cache.save)
    tuning_store = TuningStore(database)
    version, version_message = load_parameter_version(database, file_parameters)
    parameters, applied = version.parameters, version.applied
    tuning, tuning_message = tuning_store.restore(parameters)
    commissioning_results = find_completed_commissioning(database, settings.plant_choice)
    drive_lockout = DriveLockout(database, settings.plant_choice)
    identified = {} if applied is None else build_identified_sections(applied)
    drives_off = drive_lockout.previous_lock is not None
    setup = Setup(
        plant=settings.plant_choice,
        parameters=settings.params,
        seed=SEED,
        tuning=tuning.build_command(),
        commissioning_results=commissioning_results,
        drives_off=drives_off,
        identified=identified,
    )
    supervisor = Supervisor(setup, supervision, launched)
    return BootContext(
        file_parameters=file_parameters,
        parameters=parameters,
        database=database,
        claim=claim,
        database_monitor=database_monitor,
        robustness_cache=robustness_cache,
        tuning_store=tuning_store,
        tuning=tuning,
        tuning_message="; ".join(message for message in (version_message, tuning_message) if message),
        drive_lockout=drive_lockout,
        supervisor=supervisor,
    )


def load_parameter_version(database: Database, base: PlantParameters) -> tuple[AppliedVersion, str]:
    """Return the active version of the parameters and a message for the event log.

    Falls back to the file if the applied version cannot be read or belongs to another file. The message is empty for
    an unchanged file.
    """
    try:
        version = list_parameter_versions(database, base)[0]
        last = find_last_applicant(database)
    except (UnreadableDocumentError, ParameterError) as error:
        _log.exception("The service cannot read the applied parameters.")
        return AppliedVersion(0, base), f"the active parameters are those of the file: {error}"
    if version.number:
        return (
            version,
            f"parameters of {version.who} restored: version {version.number} over {base.name}",
        )
    other = (
        f"the active parameters are those of the file {base.name}: the parameters that {last} "
        "applied last belong to another file"
    )
    return version, other if last else ""


def _close_interrupted(database: Database) -> None:
    with database.session() as session:
        interrupted = runs.close_interrupted(session)
    if interrupted:
        _log.warning("The service closed runs that the previous service left open: %s", interrupted)


# Services ------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Services:
    """The service for the routes, and the parts that ``backend.main`` uses."""

    service: Service
    recorder: Recorder
    event_log: EventLog
    scene_routers: list[APIRouter]
    """Routes of the 3D views."""

    start_views: Callable[[], None]
    """Starts the 3D views, after the service has started."""


def build_services(  # noqa: PLR0915  # a list of constructions, each in need of those above it
    settings: Settings,
    boot: BootContext,
    folder: LockedFolder,
    authentication: Authentication,
    supervision: Supervision,
    events: EventBus,
    stack: AsyncExitStack,
) -> Services:
    """Build all parts of the service; ``stack`` ends them in reverse order."""

    def start_part(
        part: Part, work: Callable[[], Coroutine[Any, Any, None]], on_death: Callable[[], None] | None = None
    ) -> None:
        stack.push_async_callback(supervision.start_task(part, work, on_death).end)

    parameters, database, tuning_store, tuning = (
        boot.parameters,
        boot.database,
        boot.tuning_store,
        boot.tuning,
    )
    database_monitor, drive_lockout, supervisor = boot.database_monitor, boot.drive_lockout, boot.supervisor
    live_state = LiveState(supervisor, parameters, tuning)
    recorder = Recorder(database, supervisor.ring)
    supervisor.listen(recorder.on_event)

    quota = Quota(settings.flight_records, settings.flight_records_MB * 1_000_000)
    flights = FlightRecorder(database, lambda: supervisor.ring, quota, live_state.is_expected)
    supervisor.listen(flights.on_event)
    stack.callback(flights.close)
    start_part(FLIGHTS, flights.run)

    trigger = Trigger(database, lambda: supervisor.ring, quota, lambda: _select_lengths(live_state), events)
    stack.callback(trigger.close)
    start_part(TRIGGER, trigger.run)

    retention = Retention(database, RetentionRule(round(settings.recordings_GB * 1e9), settings.recordings_keep_days))
    start_part(RETENTION, retention.run)

    event_log = EventLog(database, events)
    stack.callback(event_log.close)
    start_part(JOURNAL, event_log.run)
    refusals = RejectionLog(event_log, asyncio.get_running_loop().call_later)
    stack.callback(refusals.close)
    events.subscribe(AccessChanged, lambda access: event_log.add_entry(EventKind.ACCESS, access.text, access.who))
    if boot.tuning_message:
        event_log.add_mark(MarkKind.TUNING, boot.tuning_message, tick=0)
    supervision.add_listener(lambda message: event_log.add_mark(MarkKind.FAULT, message, live_state.tick))
    safe_stop = SafeStop(supervisor, live_state, supervision)
    sessions = SessionRuns(database, settings.plant_choice.name)
    choice = settings.plant_choice
    recording = describe_recording(choice.recording, database) if choice.kind is PlantKind.REPLAY else None
    actuator = ActuatorService(
        supervisor=supervisor,
        live_state=live_state,
        database=database,
        session_runs=sessions,
        event_log=event_log,
        tuning_store=tuning_store,
        on_ring_changed=recorder.follow,
        supervision=supervision,
        drive_lockout=drive_lockout,
        events=events,
        recording=recording,
    )
    control = ControlLease(events, actuator.stop_after_operator_loss, actuator.log_control_change)
    events.subscribe(ControlReleased, lambda _: actuator.release_push())
    events.subscribe(
        HolderChanged, lambda _: actuator.tuning_service.cancel_trial("because the holder of control changed")
    )

    def log_handover(text: str, who: str) -> None:
        """Log a request or reply of a handover.

        It is no mark on the time axis, unlike a change of control.
        """
        event_log.add_entry(EventKind.NOTE, text, who)
        actuator.publish_change()

    hand_over = ControlHandover(control, authentication.active_users, log_handover)
    start_part(TOKENS, authentication.run)
    stack.push_async_callback(authentication.sessions.save)
    start_part(CONTROL, control.run, lambda: safe_stop.begin(Fault.OPERATOR_LOST))
    start_part(HAND_OVER, hand_over.run)
    triggers = Triggers(trigger, actuator, event_log, database)
    watch = DataFolderMonitor(
        (folder.problem, database_monitor.describe_displacement, boot.claim.problem), actuator.publish_change
    )
    start_part(FOLDER, watch.run)
    database_monitor.start_check()

    history = RunHistory(database, parameters, lambda: _get_bank_id(live_state.operator_tuning))
    processes = WorkerProcesses(supervision)
    stack.callback(processes.close)
    evaluations = Evaluations(database, processes.evaluations, lambda: live_state.task, events)
    downloads = Downloads(database, processes.reports, settings.data, evaluations.evaluate_again)
    banks = StoredBanks(database, processes.computing, lambda: live_state.tuning)
    station = ExperimentRig(supervisor, database, settings.plant_choice.name, parameters, processes.computing.run)

    def preload_reports() -> None:
        """Import what evaluation and report need while the program still runs."""
        processes.computing.preload(evaluate_finished_run, *NUMERIC_LIBRARIES)
        downloads.preload()

    experiments = OwnExperiments(database)
    texts = TextWork(processes.texts, processes.viewers_texts)
    dry_runs = DryRuns(processes.dry_runs)
    ordered_runs = JobManager(
        rig=station,
        actuator=actuator,
        banks=banks,
        experiments=experiments,
        prepare_report=preload_reports,
        seed=SEED,
        dry_runs=dry_runs,
        text_work=texts,
        supervision=supervision,
        safe_stop=safe_stop,
    )
    events.subscribe(RunReevaluated, lambda evaluated: ordered_runs.clear_missing_result(evaluated.run))
    stored_runs = StoredRuns(
        database,
        lambda: live_state.task,
        lambda run: evaluations.is_evaluating(run) or ordered_runs.is_evaluating(run),
        processes.reports,
    )

    replay = ReplayView(database)
    mirrors = {
        "/scene": SceneMirror(parameters, lambda: supervisor.ring.newest(), lambda: live_state.wall),
        "/replay": SceneMirror(parameters, replay.get_row, replay.get_wall),
    }
    views: list[SupervisedThread] = []
    for mirror in mirrors.values():
        stack.callback(mirror.close)

    def stop_views() -> None:
        for view in views:
            view.end(2.0)

    stack.callback(stop_views)

    def start_views() -> None:
        views.extend(supervision.start_thread(SCENE, mirror.run, mirror.end) for mirror in mirrors.values())

    scene_routers = [scene_router(require_signed_in, mirror, path) for path, mirror in mirrors.items()]
    bring_up = CommissioningService(actuator, supervisor, database, parameters, drive_lockout)
    stack.push_async_callback(bring_up.close)
    studies = StudyScheduler(
        database=database,
        parameters=parameters,
        tuning=lambda: live_state.operator_tuning.settings,
        computing=processes.studies,
        reading=processes.reports,
        texts=texts,
    )
    stack.push_async_callback(studies.close)

    def set_parameters(applied: ParametersApplied) -> None:
        station.parameters = applied.parameters
        for set_part_parameters in (
            history.set_parameters,
            bring_up.set_parameters,
            studies.set_parameters,
            *(mirror.use for mirror in mirrors.values()),
        ):
            set_part_parameters(applied.parameters)

    events.subscribe(ParametersApplied, set_parameters)

    def list_problems() -> list[str]:
        first = watch, database_monitor, recorder, flights, trigger, event_log
        sweep = actuator.contact.sweep
        parts = *first, supervisor.watchdog_monitor, retention, authentication.sessions, bring_up, drive_lockout, sweep
        return [*(part.problem for part in parts if part.problem), *supervision.problems, *ordered_runs.problems]

    state = ServiceState(
        live_state=live_state,
        contact=actuator.contact.view,
        trial=actuator.tuning_service.view_trial,
        trigger=triggers.view,
        player=actuator.player.view,
        holder=control.view,
        users=authentication.active_users.view,
        handovers=hand_over.view,
        problems=list_problems,
    )
    live = LiveStream(lambda: supervisor.ring, lambda: StateMessage(**dict(state.view())))
    events.subscribe(MarkAdded, lambda added: live.publish_mark(added.mark))
    events.subscribe(StateChanged, lambda _: live.request_state())
    start_part(LIVE, live.run)

    def send_trigger(triggered: Triggered) -> None:
        live.publish_mark(EventMessage(tick=triggered.tick, kind=MarkKind.TRIGGER, text=triggered.text))

    events.subscribe(Triggered, send_trigger)

    service = Service(
        parameter_service=ParameterService(
            actuator=actuator,
            supervisor=supervisor,
            database=database,
            tuning_store=tuning_store,
            base=boot.file_parameters,
            events=events,
        ),
        actuator=actuator,
        state=state,
        control=control,
        hand_over=hand_over,
        ordered_runs=ordered_runs,
        experiments=experiments,
        saved_tunings=SavedTunings(database),
        bring_up=bring_up,
        live=live,
        refusals=refusals,
        runs=stored_runs,
        figures=RangeAnalysis(database),
        run_library=RunLibrary(database),
        identifications=StoredIdentifications(
            database, stored_runs.compute_progress, processes.computing, lambda: live_state.tuning
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
    return Services(service, recorder, event_log, scene_routers, start_views)


def _select_lengths(live_state: LiveState) -> dict[str, float]:
    geometry = live_state.parameters.geometry
    return {"r_m": geometry.r_m, "r_j": geometry.r_j}


def _get_bank_id(tuning: ActiveTuning) -> int | None:
    return None if tuning.bank is None else tuning.bank.id
