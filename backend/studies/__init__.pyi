from . import maps
from .cluster import use_cluster
from .design import Design
from .executor import PointExecutor, count_cores
from .maps import SHARES, Map, Share, Spreading, format_axis_labels, list_metric_names
from .messages import STATISTIC_LABELS
from .point import UNSTABLE, StudyBase, list_variable_numbers, require_version
from .runner import Progress, TakenError, estimate_remaining_s, is_being_computed, run_study, use_local_processes
from .stored import StudyContext, create_study, parse_design

__all__ = [
    "SHARES",
    "STATISTIC_LABELS",
    "UNSTABLE",
    "Design",
    "Map",
    "PointExecutor",
    "Progress",
    "Share",
    "Spreading",
    "StudyBase",
    "StudyContext",
    "TakenError",
    "count_cores",
    "create_study",
    "estimate_remaining_s",
    "format_axis_labels",
    "is_being_computed",
    "list_metric_names",
    "list_variable_numbers",
    "maps",
    "parse_design",
    "require_version",
    "run_study",
    "use_cluster",
    "use_local_processes",
]
