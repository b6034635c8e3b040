from . import background_work, downloads, queue, signals
from .actuator import ActuatorService, SafeStop, SessionRuns, set_obstacle
from .background_work import ChartSheets, TextWork, WorkLimiter, run_while_connected
from .banks import StoredBanks
from .commissioning import CommissioningService
from .downloads import Downloads, import_run_file, stream_bundle
from .event_log import EVENT_LOG_PART, EventLog, MarkAdded, RejectionLog
from .fault_injection import apply_fault, clear_faults, describe_faults
from .identifications import StoredIdentifications
from .jobs import JobManager, describe_identification_kinds
from .library import ExperimentCheck, OwnExperiments, RunLibrary, StoredPreferences
from .lineage import RunHistory
from .live_stream import LIVE_STREAM_PART, LiveStream, StreamClient
from .maintenance import MAINTENANCE_PART, DatabaseMonitor, Maintenance, Retention
from .parameters import (
    AppliedVersion,
    ParametersApplied,
    ParameterService,
    build_identified_sections,
    find_last_applicant,
    list_parameter_versions,
    load_active_parameters,
)
from .player import describe_recording
from .queue import DryRuns
from .runs import (
    Evaluations,
    ReplayView,
    RunQuery,
    RunReevaluated,
    SampleSlice,
    StoredRuns,
    StoredTimeline,
    read_planned_run,
)
from .signals import Formulas, RangeAnalysis, RangeQuery
from .state import LiveState, ServiceState
from .studies import Studies, StudyScheduler, get_axis_symbol, get_axis_unit
from .triggers import Triggers
from .tuning import SavedTunings
from .tuning_state import ActiveTuning, RobustnessCache, TuningStore, default_tuning

__all__ = [
    "EVENT_LOG_PART",
    "LIVE_STREAM_PART",
    "MAINTENANCE_PART",
    "ActiveTuning",
    "ActuatorService",
    "AppliedVersion",
    "ChartSheets",
    "CommissioningService",
    "DatabaseMonitor",
    "Downloads",
    "DryRuns",
    "Evaluations",
    "EventLog",
    "ExperimentCheck",
    "Formulas",
    "JobManager",
    "LiveState",
    "LiveStream",
    "Maintenance",
    "MarkAdded",
    "OwnExperiments",
    "ParameterService",
    "ParametersApplied",
    "RangeAnalysis",
    "RangeQuery",
    "RejectionLog",
    "ReplayView",
    "Retention",
    "RobustnessCache",
    "RunHistory",
    "RunLibrary",
    "RunQuery",
    "RunReevaluated",
    "SafeStop",
    "SampleSlice",
    "SavedTunings",
    "ServiceState",
    "SessionRuns",
    "StoredBanks",
    "StoredIdentifications",
    "StoredPreferences",
    "StoredRuns",
    "StoredTimeline",
    "StreamClient",
    "Studies",
    "StudyScheduler",
    "TextWork",
    "Triggers",
    "TuningStore",
    "WorkLimiter",
    "apply_fault",
    "background_work",
    "build_identified_sections",
    "clear_faults",
    "default_tuning",
    "describe_faults",
    "describe_identification_kinds",
    "describe_recording",
    "downloads",
    "find_last_applicant",
    "get_axis_symbol",
    "get_axis_unit",
    "import_run_file",
    "list_parameter_versions",
    "load_active_parameters",
    "queue",
    "read_planned_run",
    "run_while_connected",
    "set_obstacle",
    "signals",
    "stream_bundle",
]
