"""Which column is the time, whether it agrees with the sample time, and rows that are taken at even instants."""

import re
from collections.abc import Collection

import numpy as np

from backend.identification.errors import DataFileError, RecordError
from backend.identification.record import Signal
from backend.identification.table import Columns

MAX_BRIDGED = 10.0
"""Longest gap that is bridged, in sample times: across more than that nobody knows what the output did."""

_SECONDS = {
    "": 1.0, "s": 1.0, "sec": 1.0, "second": 1.0, "seconds": 1.0,
    "ms": 1e-3, "msec": 1e-3, "millis": 1e-3, "milliseconds": 1e-3,
    "us": 1e-6, "µs": 1e-6, "μs": 1e-6, "ns": 1e-9, "min": 60.0, "minutes": 60.0, "h": 3600.0,
}  # fmt: skip
_TIME = re.compile(
    r"^(?:t|time|times|timestamp|timestamps|time_?stamps?|datetime|date_?time|elapsed|elapsed_?time|sim_?time)"
    r"(?:[_ .-]*(?P<unit>s|sec|seconds?|ms|msec|millis|milliseconds|us|µs|μs|ns|min|minutes|h))?$",
    re.IGNORECASE,
)


_UTC_OFFSET = re.compile(r"(?P<seconds>:\d\d(?:\.\d*)?)\s?(?P<sign>[+-])(?P<hours>\d\d):?(?P<minutes>\d\d)?$")


def time_of(columns: Columns, taken: Collection[str]) -> Signal | None:
    """Time [s], from its first value on, of the column that is named like one; None where there is none.

    ``taken`` are the columns that serve as signals. Raises DataFileError for a time in words or units nobody knows.
    """
    names = [*columns, *columns.texts]
    for name in sorted(names, key=lambda name: name not in ("t", "time")):
        match = None if name in taken else _TIME.match(name)
        if match is None:
            continue
        if name in columns.texts:
            return _stamped(name, columns.texts[name])
        unit = (columns.units.get(name) or match["unit"] or "").lower()
        if unit not in _SECONDS:
            raise DataFileError(f"the time column '{name}' is in '{unit}': give it in s, ms, us, ns, min or h")
        return np.asarray((columns[name] - columns[name][:1]) * _SECONDS[unit])
    return None


def _stamped(name: str, texts: list[str]) -> Signal:
    try:
        stamps = np.array([_plain_stamp(text) for text in texts], dtype="datetime64[ns]")
        stamps -= np.array([_ahead_of_utc_s(text) for text in texts], dtype="timedelta64[s]")
    except (ValueError, OverflowError):
        raise DataFileError(
            f"the time column '{name}' holds '{texts[0]}': write numbers, or dates like 2026-03-04T10:20:30.125"
        ) from None
    return np.asarray((stamps - stamps[:1]) / np.timedelta64(1, "s"), dtype=np.float64)


def _plain_stamp(text: str) -> str:
    """Date and time without the offset from UTC, which NumPy takes with a warning only."""
    return _UTC_OFFSET.sub(r"\g<seconds>", text.strip()).rstrip("Zz ").replace("/", "-")


def _ahead_of_utc_s(text: str) -> int:
    """Return the seconds by which the clock of a date and time is ahead of UTC, 0 where it does not say."""
    match = _UTC_OFFSET.search(text.strip())
    if match is None:
        return 0
    seconds = 3600 * int(match["hours"]) + 60 * int(match["minutes"] or 0)
    return -seconds if match["sign"] == "-" else seconds


def even(t: Signal, values: Signal, period_s: float, *, held: bool) -> Signal:
    """Values at even instants: the last one before each where the signal is ``held``, else on the line between two.

    Raises RecordError where the time runs back or a gap is too long to be bridged.
    """
    steps = np.diff(t)
    if not float(np.min(steps)) >= 0.0:
        at = int(np.argmin(steps))
        raise RecordError(
            f"time step after sample {at}", float(steps[at]), 0.0, None, "s", "the time must not run back"
        )
    if float(np.max(steps)) > MAX_BRIDGED * period_s:
        raise RecordError(
            f"gap after sample {int(np.argmax(steps))}", float(np.max(steps)), None, MAX_BRIDGED * period_s, "s",
            "too long to be bridged: use the part before or after it (--range)",
        )  # fmt: skip
    instants = t[0] + period_s * np.arange(int((t[-1] - t[0]) / period_s * (1.0 + 1e-12)) + 1)
    if not held:
        return np.asarray(np.interp(instants, t, values))
    # A stamp a rounding error after its instant still belongs to it.
    before = np.searchsorted(t, instants + 1e-6 * period_s, side="right") - 1
    return np.asarray(values[before])
