"""Messages about stored runs, libraries and studies: refusals, and why a value is missing."""

from collections.abc import Sequence

from backend.plain_text import escape_line
from plant import catalogue_entry

# Comparison ----------------------------------------------------------------------------------------


@catalogue_entry
def reference_not_aligned(*, reason: str) -> str:
    return f"the reference cannot be aligned: {reason}"


@catalogue_entry
def run_without_samples(*, run: int) -> str:
    return f"run {run} has no samples"


@catalogue_entry
def too_few_steps(*, run: int, signal: str, count: int, minimum: int) -> str:
    steps = {0: "no step", 1: "1 step"}.get(count, f"{count} steps")
    return f"run {run} has {steps} of {signal}; alignment requires at least {minimum}"


@catalogue_entry
def too_few_events(*, run: int, kind: str, count: int, minimum: int) -> str:
    events = {0: "no event", 1: "1 event"}.get(count, f"{count} events")
    return f"run {run} has {events} of the kind {kind}; alignment requires at least {minimum}"


@catalogue_entry
def reference_not_compared(*, run: int) -> str:
    return f"reference: run {run} is not among the compared runs"


@catalogue_entry
def run_not_evaluated() -> str:
    return "the run has not been evaluated"


@catalogue_entry
def run_without_metric() -> str:
    return "the run has no such metric"


@catalogue_entry
def metric_in_other_unit(*, unit: str, expected: str) -> str:
    return f"it was measured in {unit}, not in {expected}"


@catalogue_entry
def unknown_metric(*, kind: str, metric: str) -> str:
    return f"runs of kind {kind} have no metric {metric!r}"


@catalogue_entry
def no_common_times() -> str:
    return "the two runs have no samples at common times"


# Downloads -----------------------------------------------------------------------------------------


@catalogue_entry
def settings_not_usable(*, reason: str, software: str) -> str:
    return (
        f"its settings cannot be used: {escape_line(reason)}; correct the experiment and run it "
        "again, or export the run with "
        f"Sinew {escape_line(software)}, which recorded it, and read the samples from the file"
    )


@catalogue_entry
def experiment_too_long(*, characters: int, maximum: int) -> str:
    return f"the experiment has {characters} characters, but at most {maximum} are allowed: shorten it"


@catalogue_entry
def experiment_is_not_json(*, reason: str) -> str:
    return f"the experiment is not JSON: {reason}"


@catalogue_entry
def run_not_exportable(*, run: int, reason: str) -> str:
    return f"run {run}: {reason}"


@catalogue_entry
def too_many_downloads(*, maximum: int) -> str:
    return f"{maximum} downloads are in progress: wait until one of them ends"


@catalogue_entry
def run_has_no_report_yet(*, run: int) -> str:
    return f"run {run} is still in progress: its report is available after its end"


@catalogue_entry
def result_is_being_computed(*, run: int) -> str:
    return f"the result of run {run} is being computed: its report is available in a moment"


# Identifications -----------------------------------------------------------------------------------


@catalogue_entry
def estimate_without_value(*, run: int | None, estimate: int, name: str) -> str:
    source = "" if run is None else f"run {run}: "
    return f"{source}estimate {estimate} has no value for {name}"


@catalogue_entry
def run_is_not_an_identification(*, run: int, kind: str) -> str:
    return f"run {run} is of kind {kind}, not an identification"


@catalogue_entry
def identification_not_from_table(*, identification: int) -> str:
    return f"identification {identification} was not made from a spring table"


# Library -------------------------------------------------------------------------------------------


@catalogue_entry
def unknown_experiment(*, known: Sequence[str]) -> str:
    return f"there is no such experiment; known: {', '.join(known)}"


@catalogue_entry
def name_of_ready_made_experiment(*, name: str) -> str:
    return f"{name!r} is the name of a built-in experiment: choose another name"


@catalogue_entry
def no_saved_search(*, name: str, known: Sequence[str]) -> str:
    return f"there is no saved search {name!r}; known: {', '.join(known) or 'none'}"


@catalogue_entry
def length_of_search_name(*, name: str, maximum: int) -> str:
    return f"name of the search: {name[:maximum]!r} does not have 1 to {maximum} characters"


@catalogue_entry
def invalid_search_name(*, reason: str) -> str:
    return f"name of the search: {reason}"


# Lineage -------------------------------------------------------------------------------------------


@catalogue_entry
def run_still_in_progress() -> str:
    return "the run is still in progress"


@catalogue_entry
def recording_too_long_for_digest(*, run: int) -> str:
    return f"the recording is too long for the service to compute its digest: use sinew runs lineage {run}"


# Runs ----------------------------------------------------------------------------------------------


@catalogue_entry
def run_is_being_evaluated(*, run: int) -> str:
    return f"run {run} is being evaluated: its result is available in a moment"


@catalogue_entry
def unknown_kind_of_runs(*, kind: str) -> str:
    return f"there is no kind {kind!r} of runs"


# Signals -------------------------------------------------------------------------------------------


@catalogue_entry
def too_many_ranges(*, maximum: int) -> str:
    return f"{maximum} ranges are being read: wait until one of them ends"


@catalogue_entry
def too_few_samples_for_spectrum(*, minimum: int) -> str:
    return f"fewer than {minimum} consecutive samples have a value"


@catalogue_entry
def too_many_derived_signals(*, maximum: int) -> str:
    return f"a station may have at most {maximum} derived signals: remove one first"


@catalogue_entry
def name_differs_only_in_case(*, name: str, other: str) -> str:
    return f"{name!r} differs from {other!r} only in case"


# Studies -------------------------------------------------------------------------------------------


@catalogue_entry
def too_many_studies(*, maximum: int) -> str:
    return f"{maximum} studies are already running or waiting: stop one of them first"
