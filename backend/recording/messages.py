"""Messages about recordings: ends and gaps, flight records, captures, and samples that cannot be stored or read."""

from collections.abc import Sequence
from datetime import date

from backend.units import format_count
from plant import Quantity, catalogue_entry


@catalogue_entry
def tables_differ_in_length() -> str:
    return "damaged samples: tables that must have the same length differ in length"


@catalogue_entry
def samples_not_unpacked(*, reason: str) -> str:
    return f"damaged samples: {reason}"


@catalogue_entry
def samples_are_no_table(*, size_bytes: int, columns: int) -> str:
    return f"damaged samples: {size_bytes} bytes are not a table of {columns} columns"


@catalogue_entry
def flight_record_not_stored(*, reason: str) -> str:
    return f"the flight record of a trip cannot be stored: {reason}"


@catalogue_entry
def range_beyond_recording(*, run_id: int, end_s: float) -> str:
    return f"the recording of run {run_id} ends at {end_s:.3f} s: choose a range within it"


@catalogue_entry
def range_between_samples() -> str:
    return "choose a longer range: this one lies between two samples"


@catalogue_entry
def signals_not_recorded(*, signals: Sequence[str], recorded: Sequence[str]) -> str:
    return f"this recording has no signal {', '.join(signals)}; it has {', '.join(recorded)}"


@catalogue_entry
def samples_not_stored(*, reason: str) -> str:
    return f"samples cannot be stored: {reason}"


@catalogue_entry
def database_takes_no_samples(*, reason: str) -> str:
    return f"samples cannot be stored: {reason}; free space on the disk or make the database writable"


@catalogue_entry
def runs_not_removable(*, refused: Sequence[int], removable: Sequence[int]) -> str:
    return (
        f"runs that may not be deleted: {', '.join(map(str, refused)) or 'none'}; these may be deleted: "
        f"{', '.join(map(str, removable)) or 'none'}; nothing was deleted: reload the list and choose runs from it"
    )


@catalogue_entry
def run_came_into_use(*, run_id: int) -> str:
    return f"run {run_id} is now in use: its samples are kept"


@catalogue_entry
def capture_not_stored(*, reason: str) -> str:
    return f"the capture of a trigger cannot be stored: {reason}"


# Ranges --------------------------------------------------------------------------------------------


@catalogue_entry
def start_of_range() -> str:
    return "start of the range"


@catalogue_entry
def end_of_range() -> str:
    return "end of the range"


@catalogue_entry
def length_of_range() -> str:
    return "length of the range"


@catalogue_entry
def too_few_points(*, points: int) -> str:
    return f"points = {points} is out of range: it must be at least 1"


# Recorder ------------------------------------------------------------------------------------------


@catalogue_entry
def recorder() -> str:
    return "The recorder"


@catalogue_entry
def runs_complete_within_a_minute() -> str:
    return (
        "The ring buffer keeps the last minute of samples: runs are complete if the recorder restarts within that time."
    )


@catalogue_entry
def recorder_closed() -> str:
    return "the recorder was closed during the run"


@catalogue_entry
def loop_died(*, reason: str) -> str:
    return f"the control loop died: {reason}"


@catalogue_entry
def loop_restarted() -> str:
    return "the control loop was restarted"


@catalogue_entry
def program_stopped() -> str:
    return "the program was stopped before its end"


@catalogue_entry
def run_ended_with_service() -> str:
    return "service ended"


@catalogue_entry
def stopped_by_fault(*, fault: str, detail: str) -> str:
    return f"{fault}: {detail}"


@catalogue_entry
def samples_omitted(*, count: int) -> str:
    return f"{format_count(count, 'sample')} omitted"


@catalogue_entry
def first_samples_lost(*, count: int) -> str:
    return f"up to {format_count(count, 'sample')} lost before the first recorded sample"


@catalogue_entry
def samples_overwritten(*, count: int, tick: int) -> str:
    return f"{format_count(count, 'sample')} from tick {tick} on overwritten before storage"


@catalogue_entry
def invalid_sample(*, run: float, tick: float) -> str:
    return f"invalid sample of run {run:g} at tick {tick:g}"


@catalogue_entry
def tick_not_increasing(*, tick: int, previous: int) -> str:
    return f"tick {tick} after tick {previous}"


@catalogue_entry
def rest_not_recorded(*, reason: str) -> str:
    return f"the rest of the run is not recorded, because its samples are not consistent: {reason}"


@catalogue_entry
def finding_about_run(*, run_id: int, finding: str) -> str:
    return f"run {run_id}: {finding}"


@catalogue_entry
def samples_not_recorded(*, run_id: int, reason: str) -> str:
    return f"samples of run {run_id} are not recorded: {reason}"


# Flight recorder and trigger -----------------------------------------------------------------------


@catalogue_entry
def flight_recorder() -> str:
    return "The flight recorder"


@catalogue_entry
def flight_record_incomplete() -> str:
    return "A flight record may be late, or lack samples that the ring buffer no longer holds."


@catalogue_entry
def tripped_by_loop_death(*, reason: str) -> str:
    return f"The control loop died: {reason}"


@catalogue_entry
def following_trip(*, fault: str, delay_s: float) -> str:
    return f"{fault.replace('_', ' ')} after {delay_s:.2f} s"


@catalogue_entry
def following_trips(*, trips: Sequence[str], others: int) -> str:
    more = f" and {others} more" if others > 0 else ""
    return f"{', '.join(trips)}{more}"


@catalogue_entry
def oldest_records_deleted(*, deleted: int, captures: bool, kept: int, size_bytes: int) -> str:
    kind = "trigger captures" if captures else "flight records"
    return f"the oldest {kind} were deleted ({deleted}): at most {kept} and {size_bytes / 1e6:.0f} MB are kept"


@catalogue_entry
def trigger() -> str:
    return "The trigger"


@catalogue_entry
def capture_incomplete() -> str:
    return "A capture may be late, or lack samples that the ring buffer no longer holds."


@catalogue_entry
def window_condition(*, signal: str, kind: str, lower: float, upper: float, unit: str) -> str:
    return f"{signal} {kind} {Quantity(lower, unit, upper)}"


@catalogue_entry
def edge_condition(*, signal: str, kind: str, level: float, unit: str) -> str:
    return f"{signal} {kind} through {Quantity(level, unit)}"


@catalogue_entry
def level_condition(*, signal: str, kind: str, level: float, unit: str) -> str:
    return f"{signal} {kind} {Quantity(level, unit)}"


@catalogue_entry
def triggered(*, condition: str) -> str:
    return f"trigger: {condition}"


@catalogue_entry
def captured(*, condition: str, number: int, captures: int, gaps: Sequence[str]) -> str:
    of = f", {number} of {captures}" if captures > 1 else ""
    return "; ".join([f"trigger: {condition}{of}", *gaps])


@catalogue_entry
def lead_too_short(*, recorded_s: float, wanted_s: float) -> str:
    return f"{recorded_s:.3f} of {wanted_s:.3f} s recorded before it: the control loop had just started"


@catalogue_entry
def capture_ended_early(*, recorded_s: float, wanted_s: float, reason: str) -> str:
    return f"{recorded_s:.3f} of {wanted_s:.3f} s recorded after it: {reason}"


@catalogue_entry
def samples_missing(*, count: int) -> str:
    return f"{format_count(count, 'sample')} missing (NaN): the service read too late"


@catalogue_entry
def service_ended() -> str:
    return "the service ended"


@catalogue_entry
def loop_ended() -> str:
    return "the control loop ended"


@catalogue_entry
def captures_complete() -> str:
    return "all captures are complete"


# Retention -----------------------------------------------------------------------------------------


@catalogue_entry
def no_recording_deletable(*, total_bytes: int, max_bytes: int, keep_days: int) -> str:
    return (
        f"recordings use {_format_size(total_bytes)}, limit {_format_size(max_bytes)}: none can be deleted, because "
        f"all of them are in use or younger than {format_count(keep_days, 'day')}; "
        "raise SINEW_RECORDINGS_GB or lower SINEW_RECORDINGS_KEEP_DAYS"
    )


@catalogue_entry
def recordings_deletable(*, total_bytes: int, max_bytes: int, keep_days: int, runs: int, freed_bytes: int) -> str:
    return (
        f"recordings use {_format_size(total_bytes)}, limit {_format_size(max_bytes)}: the samples of "
        f"{format_count(runs, 'run')} older than {format_count(keep_days, 'day')} ({_format_size(freed_bytes)}) can be "
        "deleted; see the System page or `sinew db recordings`"
    )


@catalogue_entry
def samples_deleted_by(*, who: str, day: date) -> str:
    return f"the samples were deleted by {who} on {day.isoformat()} to free storage"


@catalogue_entry
def samples_deleted(*, run_id: int, size_bytes: int) -> str:
    return f"samples of run {run_id} deleted to free storage, {_format_size(size_bytes)}"


def _format_size(size_bytes: int) -> str:
    return f"{size_bytes / 1e9:.1f} GB" if size_bytes >= 1e8 else f"{size_bytes / 1e6:.1f} MB"


# Verification --------------------------------------------------------------------------------------


@catalogue_entry
def chunks_without_digest(*, run_id: int, chunks: int) -> str:
    return (
        f"run {run_id}: only minima and maxima were compared for chunks of samples from before digests were "
        f"stored ({chunks})"
    )


@catalogue_entry
def samples_differ(*, run_id: int, from_s: float, reason: str) -> str:
    return f"run {run_id}: the samples from {from_s:g} s on differ from the recorded ones: {reason}"


@catalogue_entry
def digest_differs(*, found: str, recorded: str) -> str:
    return f"their sha256 is {found}, but the recorded one is {recorded}"


@catalogue_entry
def count_differs(*, found: int, recorded: int) -> str:
    return f"their number is {found}, but {recorded} were recorded"


@catalogue_entry
def summaries_differ() -> str:
    return "their minima or maxima differ from the stored ones"
