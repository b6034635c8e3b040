"""Messages about recordings: damaged samples, samples that cannot be stored, read or deleted."""

from collections.abc import Sequence

from plant import catalogue_entry


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
