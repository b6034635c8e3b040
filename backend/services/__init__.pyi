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
from .lineage import History
from .live_stream import LIVE_STREAM_PART, LiveStream, StreamClient
from .maintenance import MAINTENANCE_PART, Maintenance, Retention, Soundness
from .parameters import (
    Applied,
    AppliedVersion,
    ParametersApplied,
    changed_sections,
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
from .signals import Formulas, RangeAsked, RecordedFigures
from .state import LiveState, ServiceState
from .studies import Studies, StudyScheduler, axis_symbol, axis_unit
from .triggers import Triggers
from .tuning import SavedTunings
from .tuning_state import ActiveTuning, RobustnessCache, TuningStore, default_tuning

__all__ = [
    "EVENT_LOG_PART",
    "LIVE_STREAM_PART",
    "MAINTENANCE_PART",
    "ActiveTuning",
    "ActuatorService",
    "Applied",
    "AppliedVersion",
    "ChartSheets",
    "CommissioningService",
    "Downloads",
    "DryRuns",
    "Evaluations",
    "EventLog",
    "ExperimentCheck",
    "Formulas",
    "History",
    "JobManager",
    "LiveState",
    "LiveStream",
    "Maintenance",
    "MarkAdded",
    "OwnExperiments",
    "ParametersApplied",
    "RangeAsked",
    "RecordedFigures",
    "RejectionLog",
    "ReplayView",
    "Retention",
    "RobustnessCache",
    "RunLibrary",
    "RunQuery",
    "RunReevaluated",
    "SafeStop",
    "SampleSlice",
    "SavedTunings",
    "ServiceState",
    "SessionRuns",
    "Soundness",
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
    "axis_symbol",
    "axis_unit",
    "background_work",
    "changed_sections",
    "clear_faults",
    "default_tuning",
    "describe_faults",
    "describe_identification_kinds",
    "describe_recording",
    "downloads",
    "find_last_applicant",
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
