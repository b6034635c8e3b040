from . import maps
from .cluster import use_cluster
from .crew import Crew, count_cores
from .design import Design
from .maps import PICK_WORDS, SHARES, Map, Share, Spreading, format_axis_labels, list_figure_names
from .point import UNSTABLE, StudyBase, list_variable_numbers, require_version
from .runner import Progress, TakenError, estimate_remaining_s, is_computed, run_study, use_local_processes
from .stored import StudyContext, create_study, parse_design

__all__ = [
    "PICK_WORDS",
    "SHARES",
    "UNSTABLE",
    "Crew",
    "Design",
    "Map",
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
    "is_computed",
    "list_figure_names",
    "list_variable_numbers",
    "maps",
    "parse_design",
    "require_version",
    "run_study",
    "use_cluster",
    "use_local_processes",
]
