"""Messages about stored runs, libraries and studies: refusals, reasons, and headings of files."""

from collections.abc import Mapping, Sequence

from backend.plain_text import escape_line
from backend.units import format_count
from plant import Angle, Quantity, catalogue_entry

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


@catalogue_entry
def heading_of_comparison(*, reference: int, software: str, alignment: str) -> str:
    return f"comparison with run {reference}, Sinew {software}; SI units, angles in rad; {alignment}"


@catalogue_entry
def compared_run(*, run: int, title: str, started: str, who: str, alignment: str) -> str:
    return f"run {run}: {title}, {started}, by {who}; {alignment}"


@catalogue_entry
def time_of_run(*, offset_s: float) -> str:
    return f"t is the time of the run {offset_s:+.6g} s"


@catalogue_entry
def aligned_by_start() -> str:
    return "aligned by the start of each run"


@catalogue_entry
def aligned_by_step(*, number: int, signal: str) -> str:
    return f"aligned by step {number} of {signal}"


@catalogue_entry
def aligned_by_event(*, number: int, kind: str) -> str:
    return f"aligned by event {number} of the kind {kind}"


@catalogue_entry
def time_of_reference(*, run: int) -> str:
    return f"time since the first sample of run {run}"


@catalogue_entry
def signal_of_reference(*, meaning: str, run: int) -> str:
    return f"{meaning}; of run {run}, the reference"


@catalogue_entry
def signal_of_run(*, meaning: str, run: int, shift: str) -> str:
    return f"{meaning}; of run {run}, {shift}"


@catalogue_entry
def time_shifted(*, offset_s: float) -> str:
    return f"time-shifted by {offset_s:+.6g} s"


@catalogue_entry
def difference_of_runs(*, run: int, reference: int) -> str:
    return f"run {run} minus run {reference}"


@catalogue_entry
def explanation_of_differences() -> str:
    return "difference: value minus reference; percent: relative to the magnitude of the reference"


@catalogue_entry
def value_not_set() -> str:
    return "not set"


@catalogue_entry
def select_other_runs() -> str:
    return "select more or fewer runs"


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


@catalogue_entry
def flight_record(*, event: int) -> str:
    return f"flight record {event}"


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


@catalogue_entry
def step_not_used(*, voltage: float, reason: str) -> str:
    return f"{voltage:g} V: {reason}"


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


def _format_value(value: float | str | None) -> str:
    if value is None:
        return "not defined"
    return f"{value:.6g}" if type(value) is float else str(value)


@catalogue_entry
def loop_values(*, values: Sequence[tuple[str, float | str | None]]) -> str:
    return ", ".join(f"{name} {_format_value(value)}" for name, value in values)


@catalogue_entry
def parameters_differ(*, changes: Sequence[tuple[str, float | str | None, float | str | None]], more: int) -> str:
    description = ", ".join(
        f"{name} {_format_value(before)}, now {_format_value(after)}" for name, before, after in changes
    )
    and_more = f" and {more} more" if more else ""
    return f"the active parameters differ: {description}{and_more}"


@catalogue_entry
def parameters_differ_in_texts() -> str:
    return "the active parameters differ in their sources or texts"


@catalogue_entry
def title_of_parameters(*, name: str) -> str:
    return f"Parameters {name}"


@catalogue_entry
def bank_not_imported() -> str:
    return "its bank was not imported with the run: import the run in a bundle, which contains the bank"


@catalogue_entry
def bank_numbers_computed(*, expressions: Sequence[str]) -> str:
    return f"the program computes its bank numbers: {', '.join(expressions)}"


@catalogue_entry
def newer_version_of_bank(*, version: int) -> str:
    return f"version {version} of this bank is newer"


@catalogue_entry
def point_identified_again() -> str:
    return "an operating point was identified again"


@catalogue_entry
def entries_of_bank(*, count: int, imported: bool) -> str:
    entries = format_count(count, "operating point")
    return f"{entries}, imported" if imported else entries


@catalogue_entry
def title_of_identification(*, name: str) -> str:
    return f"Identification{': ' + name if name else ''}"


@catalogue_entry
def identified_again(*, run: int | None) -> str:
    return f"identified again in run {run}"


@catalogue_entry
def not_usable() -> str:
    return "it is not usable"


@catalogue_entry
def title_of_samples(*, run: int) -> str:
    return f"Samples of run {run}"


@catalogue_entry
def samples_deleted() -> str:
    return "the samples were deleted"


@catalogue_entry
def title_of_imported_data() -> str:
    return "Imported data"


@catalogue_entry
def not_from_a_run() -> str:
    return "not from a run"


@catalogue_entry
def imported_file_not_stored() -> str:
    return "the service did not store the imported file"


@catalogue_entry
def calibration_from_wiring_file() -> str:
    return "from the wiring file"


@catalogue_entry
def calibration_of_recording_rig() -> str:
    return "of the rig that recorded the run"


@catalogue_entry
def calibration_repeated(*, steps: Sequence[str]) -> str:
    return f"repeated since: {', '.join(steps)}"


@catalogue_entry
def no_calibration_before_run() -> str:
    return "no calibration was made before the run"


@catalogue_entry
def no_calibration_imported() -> str:
    return "no calibration was imported with the run"


# Steps of the checklist.


@catalogue_entry
def no_run_yet() -> str:
    return "no run yet: start pretension"


@catalogue_entry
def last_used_in_run(*, run: int) -> str:
    return f"last used in run {run}"


@catalogue_entry
def not_identified_yet() -> str:
    return "not identified yet"


@catalogue_entry
def made_with_other_parameters(*, name: str) -> str:
    return f"made with other plant parameters ({name})"


@catalogue_entry
def older_than_identification(*, kind: str) -> str:
    return f"older than the {kind} identification"


@catalogue_entry
def no_bank_built() -> str:
    return "no bank built: the controller uses geometric gains"


@catalogue_entry
def bank_unlike_parameters(*, bank: str, entry: str, run: int) -> str:
    return (
        f"{bank} does not match the plant parameters: its {entry} operating point (run {run}) was "
        "identified with other parameters"
    )


@catalogue_entry
def bank_older_than_identification(*, bank: str, run: int | None) -> str:
    return f"{bank} is older than the identification of run {run} at the same operating point"


@catalogue_entry
def bank_not_active(*, bank: str) -> str:
    return f"{bank} is built but not active: activate it"


@catalogue_entry
def bank_is_active(*, bank: str) -> str:
    return f"{bank} is active"


@catalogue_entry
def active_bank_needed() -> str:
    return "requires an active bank"


@catalogue_entry
def default_lambda(*, bank: str) -> str:
    return f"{bank} has the default λ: choose λ_q and λ_S, and press Save"


@catalogue_entry
def saved_tuning(*, lambdas: Mapping[str, float], bank: str, who: str) -> str:
    description = ", ".join(f"λ_{name} = {value:g} s" for name, value in lambdas.items())
    return f"{description}, saved for {bank} by {who}"


@catalogue_entry
def no_experiment_yet() -> str:
    return "no experiment completed yet"


@catalogue_entry
def run_used_other_bank(*, run: int) -> str:
    return f"run {run} used another bank"


@catalogue_entry
def newest_experiment(*, kind: str, run: int) -> str:
    return f"{kind}, run {run}"


@catalogue_entry
def completed_experiment_needed() -> str:
    return "requires a completed experiment"


@catalogue_entry
def run_without_report(*, run: int) -> str:
    return f"run {run} has no report yet: open the report to create it"


@catalogue_entry
def report_created(*, run: int) -> str:
    return f"created from run {run}"


# Maintenance ---------------------------------------------------------------------------------------


@catalogue_entry
def database_copied(*, name: str) -> str:
    return f"database copied to {name}"


@catalogue_entry
def size_of_recordings_unknown(*, reason: str) -> str:
    return f"the size of the recordings is unknown: {reason}"


@catalogue_entry
def damaged_database(*, reason: str) -> str:
    return f"{reason}. Stop the service first"


@catalogue_entry
def database_not_checked(*, reason: str) -> str:
    return f"the database could not be checked: {reason}"


# Runs ----------------------------------------------------------------------------------------------


@catalogue_entry
def run_is_being_evaluated(*, run: int) -> str:
    return f"run {run} is being evaluated: its result is available in a moment"


@catalogue_entry
def unknown_kind_of_runs(*, kind: str) -> str:
    return f"there is no kind {kind!r} of runs"


@catalogue_entry
def not_evaluated(*, reason: str) -> str:
    return f"not evaluated: {reason}"


# A run as an experiment: its title and description, and what it does not repeat.


@catalogue_entry
def title_of_recorded_experiment(*, run: int) -> str:
    return f"References of run {run}"


@catalogue_entry
def recorded_references(
    *, run: int, deviation_q: float, deviation_S: float, deviation_F: float | None, delay_ticks: int
) -> str:
    off = f"{deviation_q:.2g} rad and {deviation_S:.2g} N·m/rad"
    pushed = "" if deviation_F is None else f", pushes within {deviation_F:.2g} N"
    late = f" Pushes, obstacles and changes of the tuning occur up to {delay_ticks} ms late." if delay_ticks else ""
    return (
        f"The references of run {run} as commanded, reproduced within {off} at every sample{pushed}. "
        f"The experiment begins with the tuning of the run.{late}"
    )


@catalogue_entry
def samples_missing(*, count: int) -> str:
    return f"missing samples ({count}): the experiment omits their time"


@catalogue_entry
def push_not_repeated(*, F_push: float, begin_s: float, end_s: float) -> str:
    return (
        f"push of {Quantity(F_push, 'N'):.3g} from {begin_s:.3f} s to {end_s:.3f} s: "
        "the references change during the push, but a push part holds them constant"
    )


@catalogue_entry
def too_many_changes(*, subject: str, count: int, maximum: int) -> str:
    return f"the last {count - maximum} of {count} changes of the {subject}: at most {maximum} are allowed"


@catalogue_entry
def event_not_repeated(*, t: float, event: str) -> str:
    return f"at {t:.3f} s: {event}"


@catalogue_entry
def bias_not_recorded() -> str:
    return "disturbance rejection (k_ext): the bias that was calibrated before the run is not recorded"


@catalogue_entry
def bank_of_other_station(*, bank: int | None) -> str:
    return f"bank {bank} does not belong to this station: the active bank is used"


@catalogue_entry
def obstacle_not_repeated(*, q_wall: float, begin_s: float, q_ref: float) -> str:
    return f"obstacle at {Angle(q_wall):.4g} from {begin_s:.3f} s: q_ref is beyond it, at {Angle(q_ref):.4g}"


@catalogue_entry
def program_not_readable() -> str:
    return "other actions of the program: this version cannot read the stored program"


@catalogue_entry
def loads_not_recorded() -> str:
    return "loads on the motor shafts: they are not recorded"


@catalogue_entry
def contact_not_repeated() -> str:
    return "calibration of the external-force bias and contact reaction"


@catalogue_entry
def changes_not_recorded(*, names: Sequence[str]) -> str:
    return f"changes of {', '.join(names)} by the program: only λ is recorded"


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


@catalogue_entry
def heading_of_range(*, run: int, from_s: float, to_s: float, software: str) -> str:
    return (
        f"run {run} from {from_s:.3f} s to {to_s:.3f} s, Sinew {software}; "
        "every sample; SI units, angles in rad; t counts from the first sample of the run"
    )


@catalogue_entry
def choose_shorter_range() -> str:
    return "choose a shorter range or fewer signals"


@catalogue_entry
def choose_time_within(*, run: int) -> str:
    return f"choose a time within the recording of run {run}"


# Studies -------------------------------------------------------------------------------------------


@catalogue_entry
def too_many_studies(*, maximum: int) -> str:
    return f"{maximum} studies are already running or waiting: stop one of them first"


@catalogue_entry
def study_process_died() -> str:
    return "the process of the study died without a message: resume the study; computed points are kept"
