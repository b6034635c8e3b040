"""Messages of the command line: results and prompts, and options, files and databases that a command cannot use."""

from collections.abc import Mapping, Sequence
from datetime import datetime
from pathlib import Path

from backend.units import format_count
from plant import Quantity, catalogue_entry

# Identification ------------------------------------------------------------------------------------


@catalogue_entry
def not_a_text_table(*, file: str) -> str:
    return f"{file} is not a text table, which --header and --decimal require"


@catalogue_entry
def unknown_file_format(*, file: str) -> str:
    return f"{file} is not .csv, .mat or .parquet: save the columns in one of these formats"


@catalogue_entry
def unknown_decimal_mark(*, value: str) -> str:
    return f"--decimal {value}: write point or comma"


@catalogue_entry
def invalid_range(*, value: str) -> str:
    return f"--range {value}: write two times in seconds FROM:TO, for example 2:30 or 2:"


@catalogue_entry
def invalid_controller(*, value: str) -> str:
    return f"--controller {value}: write two numbers kp,ki, for example 200,256"


@catalogue_entry
def unknown_method(*, name: str, known: str) -> str:
    return f"method '{name}' does not exist: choose one of {known}"


@catalogue_entry
def header_requires_table() -> str:
    return "--header and --decimal require --table"


@catalogue_entry
def options_exclude_table() -> str:
    return "--set and --out do not apply to --table: remove them"


@catalogue_entry
def tensions_set_twice() -> str:
    return "--tensions and --set tension_N=... are mutually exclusive"


@catalogue_entry
def error_in_file(*, file: Path, reason: str) -> str:
    return f"{file}: {reason}"


@catalogue_entry
def time_column(*, column: str, unit: str | None, origin: str | None) -> str:
    return f"{column}, unit {unit} ({origin})"


@catalogue_entry
def sample_time(*, sample_time_s: float, origin: str, least_step_s: float | None, largest_step_s: float | None) -> str:
    text = f"{sample_time_s:.6g} s, from {origin}"
    if least_step_s is None or largest_step_s is None:
        return text
    return f"{text}; rows are {least_step_s:.6g} to {largest_step_s:.6g} s apart"


@catalogue_entry
def rows_used(*, used: int, available: int, first: int, last: int) -> str:
    return f"{used} of {available}, {first} to {last}"


@catalogue_entry
def samples_resampled() -> str:
    return "samples, resampled to a constant sample time"


@catalogue_entry
def parameter_omitted() -> str:
    return "omitted: not significantly different from 0"


@catalogue_entry
def friction_not_significant(*, u_c: float, u_c_std: float) -> str:
    return f"not significant ({u_c:.2g} ± {u_c_std:.2g})"


@catalogue_entry
def identification_title(*, number: int) -> str:
    return f"identification {number}"


# Database ------------------------------------------------------------------------------------------


@catalogue_entry
def folder_used_by_another_version(*, folder: str) -> str:
    return (
        f"a service or command of another version uses {folder}, and this version would migrate its database: stop "
        "the other one first"
    )


@catalogue_entry
def database_is_on_a_server() -> str:
    return "SINEW_DATABASE_URL is set: restore this database with the tools of its database server"


@catalogue_entry
def database_in_use(*, holder: str, file: str) -> str:
    return f"{holder} uses {file} from another folder: stop it first; nothing was changed"


@catalogue_entry
def nothing_to_delete(*, total_bytes: int, limit_GB: float) -> str:
    return f"recordings use {total_bytes / 1e9:.3f} GB, limit {limit_GB:g} GB: nothing needs to be deleted"


@catalogue_entry
def command_to_delete(*, run_ids: Sequence[int]) -> str:
    return f"to delete these samples: sinew db recordings {' '.join(f'--delete {run_id}' for run_id in run_ids)}"


@catalogue_entry
def schema_revision(*, revision: str | None) -> str:
    return f"schema {revision}"


@catalogue_entry
def database_copied(*, file: str) -> str:
    return f"database copied to {file}"


@catalogue_entry
def restored(*, file: Path) -> str:
    return f"restored {file}"


@catalogue_entry
def station_name_missing() -> str:
    return "the name of the station is missing"


@catalogue_entry
def runs_assigned(*, station: str, runs: int) -> str:
    return f"runs assigned to {station}: {runs}; start its service with --station {station}"


@catalogue_entry
def database_consistent(*, recordings: int) -> str:
    return f"the database is consistent; intact recordings: {recordings}"


@catalogue_entry
def run_interrupted() -> str:
    return "the process that executed the run ended before the run; detected when the data folder was next opened"


# Reports -------------------------------------------------------------------------------------------


@catalogue_entry
def not_a_regular_file(*, file: str) -> str:
    return f"{file} is not a regular file"


@catalogue_entry
def page_of_pdf_missing(*, page: str) -> str:
    return f"a PDF has no report manifest, and its page {page} is not in the same folder"


@catalogue_entry
def run_not_stored() -> str:
    return "its run is not stored in this data folder: sign the report on the installation that stores the run"


@catalogue_entry
def page_of_several_runs_needed() -> str:
    return (
        "a report of several runs is verified from its page and the stored runs: specify the .html file and no samples"
    )


@catalogue_entry
def unknown_report_suffix(*, file: Path) -> str:
    return f"{file}: use the suffix .html or .pdf"


@catalogue_entry
def pdf_not_signed(*, file: Path, page: str) -> str:
    return f"{file} is not signed: a PDF cannot be signed; sign {page}"


@catalogue_entry
def not_signed(*, file: Path, reason: str) -> str:
    return f"{file} is not signed: {reason}"


@catalogue_entry
def not_signed_with_differences(*, file: Path, count: int) -> str:
    return f"{file} is not signed: {format_count(count, 'difference')} found"


@catalogue_entry
def not_signed_unless_verified(*, file: Path, left_out: Sequence[str]) -> str:
    return f"{file} is not signed: it is only partly verified: {'; '.join(left_out)}"


@catalogue_entry
def signed_file(*, file: Path, fingerprint: str, name: str) -> str:
    return f"{file} is signed by {fingerprint} ({name})"


@catalogue_entry
def invalid_key(*, reason: str) -> str:
    return f"--key: {reason}"


@catalogue_entry
def not_verified(*, file: Path, reason: str) -> str:
    return f"{file}: not verified: {reason}"


@catalogue_entry
def rest_not_verified(*, reason: str) -> str:
    return f"the rest is not verified: {reason}"


@catalogue_entry
def verification_failed(*, file: Path, count: int) -> str:
    return f"{file}: verification failed, {format_count(count, 'difference')}"


@catalogue_entry
def partly_verified(*, file: Path) -> str:
    return f"{file} is only partly verified: no difference was found, but some parts were not compared"


@catalogue_entry
def verified(*, file: Path, compared: str, origin: str, others: Sequence[str]) -> str:
    also = f"; also compared: {', '.join(others)}" if others else ""
    return f"{file} is verified: {compared}, recomputed from {origin}{also}"


@catalogue_entry
def compared_sources(*, origin: str, others: Sequence[str]) -> str:
    return f"computed from {origin}; also compared: {', '.join(others)}"


@catalogue_entry
def not_compared(*, part: str) -> str:
    return f"not compared: {part}"


@catalogue_entry
def no_signature() -> str:
    return "not signed"


@catalogue_entry
def signature(*, fingerprint: str, name: str, owner: str) -> str:
    signer = f" ({name})" if name else ""
    return f"signed by {fingerprint}{signer}, {owner or 'invalid'}"


@catalogue_entry
def given_key() -> str:
    return "the given key"


@catalogue_entry
def own_key() -> str:
    return "the key of this installation"


@catalogue_entry
def unknown_key() -> str:
    return "an unknown key: it does not prove the origin of the report; specify the expected key with --key"


@catalogue_entry
def stored_runs() -> str:
    return "its stored runs"


@catalogue_entry
def run_of_data_folder(*, run_id: int | None) -> str:
    return f"run {run_id} of the data folder"


@catalogue_entry
def stored_run() -> str:
    return "the stored run"


@catalogue_entry
def readable_samples() -> str:
    return "readable samples"


@catalogue_entry
def stored_run_not_read(*, reason: str) -> str:
    return f"the stored run: {reason}"


# Rig -----------------------------------------------------------------------------------------------


@catalogue_entry
def input_ended() -> str:
    return "no answer: standard input has ended"


@catalogue_entry
def given_up() -> str:
    return "cancelled by the operator"


STEP_STATES = {"never": "to do", "current": "done", "out_of_date": "out of date", "failed": "failed"}
"""States of a step, as on the page."""


@catalogue_entry
def wiring_valid(*, wiring: str) -> str:
    return f"{wiring}: channels, units and calibrations are valid"


@catalogue_entry
def card_reading(*, wiring: str, V_A: float, V_B: float, n_q: float, n_A: float, n_B: float) -> str:
    return f"{wiring}: {V_A:.4f} V, {V_B:.4f} V; counts {n_q:g}, {n_A:g}, {n_B:g}"


@catalogue_entry
def card_lines(*, tripped: bool, at_end: bool) -> str:
    module, switch = "tripped" if tripped else "not tripped", "active" if at_end else "inactive"
    return f"safety module {module}, end switch {switch}"


@catalogue_entry
def bring_up_detects_wires() -> str:
    return (
        "The wiring test and the direction step of the bring-up detect wrong signs and swapped "
        "wires, and name the entry to correct"
    )


@catalogue_entry
def prompt(*, question: str, hint: str, quit_key: str) -> str:
    return f"{question} [{hint}, {quit_key} to cancel]"


@catalogue_entry
def enter_when_done() -> str:
    return "Enter when done"


@catalogue_entry
def enter_for_default(*, default: float) -> str:
    return f"Enter for {default:g}"


@catalogue_entry
def not_a_number(*, reason: str) -> str:
    return f"{reason}: enter a number"


@catalogue_entry
def only_for_a_rig(*, plant: str) -> str:
    return (
        f"only a rig requires the bring-up, but the plant is the {plant}: use --plant rig, with "
        "--virtual-card to practise without hardware"
    )


@catalogue_entry
def steps_require_terminal() -> str:
    return "standard input is not a terminal: a person at the rig has to confirm each step"


@catalogue_entry
def page_instead(*, reason: str, address: str) -> str:
    return f"{reason}. Alternatively, use the page Bring-up at {address}"


@catalogue_entry
def step_blocked(*, step: str, reason: str) -> str:
    return f"{step}: {reason}; sinew rig bring-up runs all pending steps"


@catalogue_entry
def session_begins(*, plant: str, wiring: str) -> str:
    return (
        f"{plant}, {wiring}. Press Ctrl+C at any time for zero volts; the result of an unfinished step is not "
        "stored, except that of a direction test that has started a motor."
    )


@catalogue_entry
def operator_simulated() -> str:
    return "No hardware moves: at each Enter the program simulates the action of the operator."


@catalogue_entry
def keep_clear_of_start() -> str:
    return "Keep clear of the rig: the control loop starts, and the drives are enabled at zero volts"


@catalogue_entry
def result_not_stored(*, reason: str, step: str) -> str:
    return f"{reason}: no result of {step} was stored"


@catalogue_entry
def step_failed(*, step: str, result: str) -> str:
    return f"{step}: {result}"


@catalogue_entry
def result_of_step(*, passed: bool, result: str) -> str:
    return f"{'passed' if passed else 'FAILED'}: {result}"


@catalogue_entry
def drives_stay_disabled() -> str:
    return "The next service or command for this rig keeps the drives disabled until a person enables them."


@catalogue_entry
def zero_is_lost() -> str:
    return (
        "The zero is lost when the control loop of this command ends: set it again in the "
        "next service or command for this rig."
    )


@catalogue_entry
def wrong_number_of_weights(*, maximum: int, given: int) -> str:
    return f"--weight: specify 2 to {maximum} known weights; {given} given"


@catalogue_entry
def requirements_met(*, plant: str) -> str:
    return f"{plant}: meets the requirements of the plant interface"


@catalogue_entry
def requirements_not_met(*, plant: str, broken: int, checked: int) -> str:
    return f"{plant}: {broken} of {checked} requirements of the plant interface are not met"


@catalogue_entry
def drives_require_terminal() -> str:
    return (
        "standard input is not a terminal: a person at the rig has to confirm that everyone is clear "
        "of the rig, because the drives will be enabled"
    )


@catalogue_entry
def confirm_drives() -> str:
    return "The drives will be enabled. Is everyone clear of the rig?"


# Banks ---------------------------------------------------------------------------------------------


@catalogue_entry
def bank_or_identifications() -> str:
    return "specify either a second bank or --with identifications"


@catalogue_entry
def bank_title(*, bank_id: int, name: str, version: int) -> str:
    return f"bank {bank_id}: {name}, version {version}"


@catalogue_entry
def fits_of_entry(*, entry: str, fits: Sequence[str]) -> str:
    return f"{entry}: {'; '.join(fits) or 'imported, fit unknown'}"


# Experiments and queue -----------------------------------------------------------------------------


@catalogue_entry
def not_a_setting(*, word: str) -> str:
    return f"--set {word}: write key=value, for example --set lam_q=0.6"


@catalogue_entry
def tuning_of_run(*, parts: Sequence[tuple[str, str]]) -> str:
    return f"tuning: {', '.join(f'{text} ({origin})' for text, origin in parts)}"


@catalogue_entry
def tuning_not_valid(*, reason: str) -> str:
    return f"using the default tuning, because the active tuning is not valid: {reason}"


@catalogue_entry
def tuning_of_other_parameters() -> str:
    return "using the default tuning, because the active tuning belongs to other plant parameters"


@catalogue_entry
def run_not_completed(*, run_id: int, end: str, reason: str) -> str:
    return f"run {run_id} {end}: {reason or 'no further reason known'}"


@catalogue_entry
def problem_of_run(*, run_id: int, reason: str) -> str:
    return f"run {run_id}: {reason}"


@catalogue_entry
def deprecated(*, name: str, replacement: str) -> str:
    return f"{name} is deprecated: {replacement}"


@catalogue_entry
def file_not_read(*, file: Path, reason: str) -> str:
    return f"{file} cannot be read: {reason}"


@catalogue_entry
def bounds(*, minimum: float | None, maximum: float | None) -> str:
    return f"{minimum} to {maximum}"


@catalogue_entry
def experiment_valid(*, name: str, duration_s: float, segments: int, changes_of_tuning: int) -> str:
    changes = f", {format_count(changes_of_tuning, 'change')} of the tuning" if changes_of_tuning else ""
    return f"{name} is valid: {duration_s:.6g} s in {format_count(segments, 'segment')}{changes}"


@catalogue_entry
def simulated_extremes(*, u_max: float, F_min: float, F_max: float) -> str:
    return f"on the simulator: at most {Quantity(u_max, 'V'):.3g}, tensions {Quantity(F_min, 'N', F_max):.3g}"


@catalogue_entry
def experiment_saved(*, name: str, version: int) -> str:
    return f"saved as {name}@{version}"


@catalogue_entry
def queue_ended(*, problem: str) -> str:
    return f"the queue is {problem}"


@catalogue_entry
def queue_progress(*, run_id: int, phase: str, queued: int) -> str:
    return f"run {run_id}, {phase}; {queued} queued"


@catalogue_entry
def time_left(*, left_s: float) -> str:
    return f"{max(0.0, left_s):.0f} s left"


@catalogue_entry
def restored_item(*, who: str) -> str:
    return f"{who}, restored"


@catalogue_entry
def queue_empty() -> str:
    return "the queue is empty"


@catalogue_entry
def run_in_progress(*, run_id: int, kind: str, left: str) -> str:
    return f"run {run_id} is in progress: {kind}, {left}"


@catalogue_entry
def queue_continues() -> str:
    return "the queue continues automatically"


@catalogue_entry
def queue_not_running() -> str:
    return "the queue is not running"


# Runs ----------------------------------------------------------------------------------------------


@catalogue_entry
def wrote(*, files: str) -> str:
    return f"wrote {files}"


@catalogue_entry
def run_title(*, run_id: int, kind: str, end: str) -> str:
    return f"run {run_id}, {kind}: {end}"


@catalogue_entry
def not_measured() -> str:
    return "not measured"


@catalogue_entry
def not_measured_because(*, reason: str) -> str:
    return f"not measured: {reason}"


@catalogue_entry
def not_evaluated(*, end: str, reason: str) -> str:
    return f"{end}, not evaluated: {reason or 'no evaluation was attempted'}"


@catalogue_entry
def unknown_export_suffix(*, file: Path) -> str:
    return f"{file}: use the suffix .csv, .parquet, .mat or .mcap"


@catalogue_entry
def nothing_imported(*, file: Path, reason: str) -> str:
    return f"nothing was imported from {file}: {reason}"


@catalogue_entry
def run_imported(*, was: int, run_id: int) -> str:
    return f"run {was} was imported as run {run_id}"


@catalogue_entry
def run_already_stored(*, was: int, run_id: int) -> str:
    return f"run {was} is already stored as run {run_id}: nothing was imported"


@catalogue_entry
def more_runs(*, listed: int, found: int) -> str:
    return f"{listed} of {found} runs; increase --limit to list more"


@catalogue_entry
def compared_run(*, run_id: int, station: str, is_reference: bool, title: str, started: datetime, verdict: str) -> str:
    at = f" at {station}" if station else ""
    marked = ", the reference" if is_reference else ""
    return f"run {run_id}{at}{marked}: {title}, {started:%Y-%m-%d %H:%M} UTC. {verdict}"


@catalogue_entry
def no_result_of_kind(*, kind: str) -> str:
    return f"no run of kind {kind} that matches the search has a result"


@catalogue_entry
def runs_without_value(*, without: int, left_out: int) -> str:
    return f"runs without a value: {without}; omitted older runs: {left_out}"


@catalogue_entry
def no_tag() -> str:
    return "no tag specified: use --add TAG or --remove TAG"


@catalogue_entry
def tag_renamed(*, runs: int) -> str:
    return f"renamed on {format_count(runs, 'run')}"


@catalogue_entry
def run_evaluated(*, run_id: int) -> str:
    return f"run {run_id} evaluated; to show the result: sinew runs show {run_id}"


# Studies -------------------------------------------------------------------------------------------


@catalogue_entry
def file_or_number_of_study() -> str:
    return "specify the file of a study, or --resume with the number of a study"


@catalogue_entry
def again_requires_resume() -> str:
    return "--again requires --resume: a new study has no failed runs"


@catalogue_entry
def how_to_resume_study(*, study: int) -> str:
    return f"study {study}; to resume it after a stop: sinew study run --resume {study}"


@catalogue_entry
def study_stopped(*, study: int) -> str:
    return f"study {study} was stopped; to resume it: sinew study run --resume {study}"


@catalogue_entry
def study_progress(*, study: int, state: str, done: int, points: int) -> str:
    return f"study {study}: {state}, {done} of {points} runs"


@catalogue_entry
def study_title(*, study: int, title: str, state: str, done: int, points: int) -> str:
    return f"study {study}, {title}: {state}, {done} of {points} runs"


@catalogue_entry
def ends_of_runs(*, ends: Mapping[str, int], problem: str) -> str:
    counts = ", ".join(f"{count} {state}" for state, count in ends.items())
    return f"{counts or 'no run computed yet'}{f'; {problem}' if problem else ''}"


@catalogue_entry
def part_of_whole(*, part: int | None, whole: int) -> str:
    return f"{part} of {whole}"


@catalogue_entry
def duration_left(*, duration: str) -> str:
    return f"{duration} left"


@catalogue_entry
def share_without_verdict(*, share: str, left_out: int) -> str:
    return f"{share}: {format_count(left_out, 'run')} without a verdict"


@catalogue_entry
def share_of_runs(
    *, share: str, count: int, of: int, percent: float, low_percent: float, high_percent: float, left_out: int
) -> str:
    left = f", {format_count(left_out, 'run')} without a verdict" if left_out else ""
    return (
        f"{share}: {count} of {of}, {percent:.1f} % "
        f"(95 % confidence interval {low_percent:.1f} to {high_percent:.1f} %){left}"
    )


@catalogue_entry
def one_run() -> str:
    return "one run"


@catalogue_entry
def unknown_image_suffix(*, file: Path, suffixes: Sequence[str]) -> str:
    return f"{file}: use one of the suffixes {', '.join(suffixes)}"


@catalogue_entry
def unknown_metric(*, name: str, known: Sequence[str]) -> str:
    return f"metric '{name}' does not exist; choose one of {', '.join(known)}"


@catalogue_entry
def map_title(*, metric: str, statistic: str, computed: int, without_value: int) -> str:
    lacking = f", {without_value} of {computed} runs without a value" if without_value else ""
    return f"{metric}, {statistic} of the runs in a cell{lacking}"


@catalogue_entry
def map_title_with_blanks(*, title: str, blank: str) -> str:
    return f"{title}, blank: {blank}"


@catalogue_entry
def notes_of_map() -> str:
    return "95 % confidence interval of a share, or number of runs with a value out of all computed runs"


@catalogue_entry
def interval_of_cell(*, low: float, high: float, runs: int) -> str:
    return f"{low:.3g} to {high:.3g}, {runs} runs"


# Service -------------------------------------------------------------------------------------------


@catalogue_entry
def service_does_not_respond(*, address: str, reason: str) -> str:
    return f"the service at {address} does not respond: {reason}"


@catalogue_entry
def other_program_responds(*, address: str, status: int, response: bytes) -> str:
    return (
        f"the program at {address} is not Sinew: status {status}, {response[:80]!a}; find out "
        "which program uses this port, and restart `sinew serve`"
    )


@catalogue_entry
def service_is_starting() -> str:
    return "Sinew is starting. The first start after an installation compiles code, which takes up to a minute."


@catalogue_entry
def running_without_link(*, addresses: Sequence[str], data: Path) -> str:
    return f"Sinew is running at {' and '.join(addresses)}. For the sign-in link: sinew link --data {data}"


@catalogue_entry
def running_without_sign_in(*, address: str) -> str:
    return f"Sinew is running at {address} without sign-in"


@catalogue_entry
def sign_in_link(*, address: str, token: str) -> str:
    return f"Sinew is running. Sign in: {address}/?token={token}"


@catalogue_entry
def view_only_link(*, address: str, token: str) -> str:
    return f"View only:                {address}/?token={token}"


@catalogue_entry
def link_on_this_machine(*, address: str, token: str) -> str:
    return f"On this machine:          {address}/?token={token}"


@catalogue_entry
def data_folder_missing(*, data: Path) -> str:
    return f"the data folder {data} does not exist: choose one with --data"


@catalogue_entry
def new_token(*, role: str, token: str, file: Path) -> str:
    return f"{role}: /?token={token}  (stored in {file})"


@catalogue_entry
def foxglove_not_installed() -> str:
    return "this command requires the extra foxglove: pip install 'sinew[foxglove]'"


@catalogue_entry
def port_not_available(*, port: int, reason: str | None) -> str:
    return f"port {port} of this machine is not available: {reason}; choose another with --port"


@catalogue_entry
def bias_point(*, point: int, points: int, S_ref: float) -> str:
    return f"{point} of {points}: {S_ref:.4g} N·m/rad"


@catalogue_entry
def bias_calibration_ended(*, point: int, points: int, reason: str) -> str:
    return f"the bias calibration over S ended at point {point} of {points}: {reason}"


@catalogue_entry
def calibrated_bias(*, S: float, F: float, std_N: float) -> str:
    return f"{S:.2f} N·m/rad: estimate {F:.2f} ± {std_N:.2f} N without external force"


@catalogue_entry
def no_bias() -> str:
    return "no bias calibrated"


@catalogue_entry
def reaction_armed(*, threshold_N: float) -> str:
    return f"contact reaction armed at {threshold_N:g} N"


@catalogue_entry
def reaction_disabled() -> str:
    return "contact reaction disabled"


@catalogue_entry
def not_an_angle(*, value: str) -> str:
    return f"angle of the obstacle: {value!r} is not a number; specify it in rad, or in degrees as 15deg"


@catalogue_entry
def obstacle(*, side: str, angle: str) -> str:
    return f"obstacle {side} {angle}"


@catalogue_entry
def no_obstacle() -> str:
    return "no obstacle"


# Doctor --------------------------------------------------------------------------------------------


@catalogue_entry
def checks_need_attention(*, open_points: int, checks: int) -> str:
    return f"{open_points} of {checks} checks need attention"


@catalogue_entry
def all_checks_passed() -> str:
    return "all checks passed"


@catalogue_entry
def pacing(*, median_us: float, late_us: float, missed: int, resolution_ns: float) -> str:
    deadlines = f", {missed} deadlines missed" if missed else ""
    return f"lateness {median_us:.0f} µs (median), {late_us:.0f} µs (99 %){deadlines}; clock {resolution_ns:.0f} ns"


@catalogue_entry
def reserve_core() -> str:
    return "close other programs, or reserve a core for the control loop"


@catalogue_entry
def two_cores_needed() -> str:
    return "the control loop and the dashboard need one core each"


@catalogue_entry
def no_card(*, reason: str) -> str:
    return f"none: {reason}"


@catalogue_entry
def card_only_for_rig(*, remedy: str) -> str:
    return f"the simulator needs none; for a rig {remedy}"


@catalogue_entry
def no_browser() -> str:
    return "none on this machine"


@catalogue_entry
def use_other_machine() -> str:
    return "open the dashboard on another machine"


@catalogue_entry
def folder_not_writable(*, data: Path) -> str:
    return f"{data} is not writable"


@catalogue_entry
def choose_other_folder() -> str:
    return "choose another folder with --data, or change its owner"


@catalogue_entry
def free_space(*, data: Path, free_bytes: int) -> str:
    return f"{data}: {free_bytes / 1e9:.1f} GB free"


@catalogue_entry
def free_some_space() -> str:
    return "free some space: recordings take 80 MB per hour"
