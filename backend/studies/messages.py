"""Messages about studies: invalid documents, failed points, unavailable executors, and maps."""

from plant import catalogue_entry

# Design --------------------------------------------------------------------------------------------


@catalogue_entry
def runs_of_study() -> str:
    return "runs of the study"


@catalogue_entry
def draws_without_spread() -> str:
    return "draws requires a spread: add a spread, or omit draws"


@catalogue_entry
def seed_is_an_axis() -> str:
    return "the seed is already an axis: omit seeds"


@catalogue_entry
def varied_twice(*, name: str) -> str:
    return f"{name} is varied twice"


@catalogue_entry
def value_given_twice(*, value: object) -> str:
    return f"{value} occurs more than once"


@catalogue_entry
def values_or_range() -> str:
    return "give either values, or first, last and count"


@catalogue_entry
def no_equal_factors(*, first: float, last: float) -> str:
    return f"equal factors do not lead from {first:g} to {last:g}: choose spacing even"


@catalogue_entry
def unknown_setting(*, known: str) -> str:
    return f"unknown setting; choose one of {known}"


@catalogue_entry
def relative_or_absolute() -> str:
    return "give either relative or absolute"


@catalogue_entry
def relative_to_zero(*, name: str) -> str:
    return f"{name} is 0, so that relative values cannot be drawn: give absolute"


@catalogue_entry
def not_a_number(*, value: object) -> str:
    return f"{value!r} is not a number"


@catalogue_entry
def unknown_plant_number(*, name: str) -> str:
    return f"{name}: the plant has no such numeric parameter"


# Stored studies ------------------------------------------------------------------------------------


@catalogue_entry
def not_a_study() -> str:
    return "a study must be a mapping with format, name, title and axes or spread"


@catalogue_entry
def no_experiment_document(*, name: str) -> str:
    return f"there is no experiment document of {name}: choose another experiment"


@catalogue_entry
def stored_input() -> str:
    return "the stored input"


@catalogue_entry
def study_of_number(*, number: int) -> str:
    return f"study {number}"


# Points --------------------------------------------------------------------------------------------


@catalogue_entry
def point_failed(*, error: str, reason: str) -> str:
    return f"{error}: {reason}"


@catalogue_entry
def other_software(*, installed: str, recorded: str) -> str:
    return (
        f"Sinew {installed} is installed, but the study was created with Sinew {recorded}: use that version, or "
        "start a new study"
    )


# Executors and clusters ----------------------------------------------------------------------------


@catalogue_entry
def process_died(*, times: int, reason: str) -> str:
    return f"the process that computed the point died {times} times: {reason}"


@catalogue_entry
def cluster_not_installed() -> str:
    return "a cluster requires the package extra 'cluster': pip install 'sinew[cluster]'"


@catalogue_entry
def no_scheduler(*, address: str, reason: str) -> str:
    return f"no Dask scheduler answers at {address}: {reason}"


@catalogue_entry
def scheduler_lost() -> str:
    return "the connection to the scheduler is lost: start the scheduler again, and continue with --resume"


@catalogue_entry
def workers_cannot_compute(*, error: str, reason: str) -> str:
    return (
        f"the workers cannot compute the point: {error}: {reason}"
        "; set up their machines like this one, and continue with --resume"
    )


@catalogue_entry
def workers_died(*, reason: str) -> str:
    return f"the workers of the cluster died while they computed the point: {reason}"


@catalogue_entry
def interrupted() -> str:
    return "it was interrupted"


@catalogue_entry
def computed_elsewhere(*, study: int, runner: str) -> str:
    return f"study {study} is being computed by {runner}: stop it first, or wait until it ends"


# Maps ----------------------------------------------------------------------------------------------


@catalogue_entry
def not_an_axis(*, axes: str) -> str:
    return f"it is not an axis of this study; its axes: {axes}"


@catalogue_entry
def same_axis_twice() -> str:
    return "it is already the x axis"


@catalogue_entry
def unknown_statistic(*, known: str) -> str:
    return f"choose one of {known}"


STATISTIC_LABELS = {"deviation": "standard deviation", "p5": "5th percentile", "p95": "95th percentile"}
"""Labels of statistics whose name is not clear by itself."""
