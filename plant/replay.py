"""Replay of a recording as a Plant: measurements do not depend on written voltages."""

from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from plant import messages
from plant.interface import (
    NO_RAW,
    InjectedFault,
    Measurement,
    MotorCommand,
    PlantError,
    RawReading,
    ShaftLoad,
    T_s,
    require_numbers,
)

# Recording -----------------------------------------------------------------------------------------
# A recording as a CSV or Parquet file, as written by ``sinew runs export`` and by downloads: reading and checks.


Signal = NDArray[np.float64]

UNITS = {"t": "s", "q": "rad", "theta_A": "rad", "theta_B": "rad", "F_A": "N", "F_B": "N", "u_A": "V", "u_B": "V"}
"""Columns that a recording must have, with their units."""

FURTHER = ("S_true", "F_push", "F_wall", "V_A", "V_B", "n_q", "n_A", "n_B", "fault")
"""Optional columns; if missing they are NaN, ``F_push`` and ``fault`` 0."""

_MEASURED = ("q", "theta_A", "theta_B", "F_A", "F_B")
_LARGEST = {"q": np.pi, "u_A": 10.0, "u_B": 10.0}
_JITTER = 0.1
"""Permitted deviation of a time step [periods]."""


@dataclass(frozen=True)
class RecordedSamples:
    """Samples by column name, shape (N,) each, one every millisecond.

    Includes further columns of the file that hold numbers.
    """

    path: Path
    columns: dict[str, Signal]

    def __len__(self) -> int:
        return int(self.columns["t"].size)

    @property
    def duration_s(self) -> float:
        """Duration [s]."""
        return len(self) * T_s


_preloaded: dict[Path, tuple[tuple[int, int], RecordedSamples]] = {}
"""Recordings read in advance, with modification time [ns] and size [bytes] of the file."""


def preload_replay(path: str | Path) -> None:
    """Read a recording in advance of ``load_replay``. Raises PlantError as that does."""
    path = Path(path)
    _preloaded[path] = _get_file_stamp(path), _read_recording(path)


def load_replay(path: str | Path) -> RecordedSamples:
    """Read a recording.

    Raises PlantError with the error in the file, its position, and the required content.
    """
    path = Path(path)
    stamp, recording = _preloaded.pop(path, (None, None))
    return recording if recording is not None and stamp == _get_file_stamp(path) else _read_recording(path)


def _get_file_stamp(path: Path) -> tuple[int, int]:
    try:
        status = path.stat()
    except OSError:
        return 0, 0  # reading the file reports the error
    return status.st_mtime_ns, status.st_size


def _read_recording(path: Path) -> RecordedSamples:
    table = _read_table(path)
    columns = {name: _read_column(path, table, name, unit) for name, unit in UNITS.items()}
    rows = columns["t"].size
    if rows < 2:
        raise PlantError(messages.recording_too_short(recording=path.name, samples=rows))
    for name in FURTHER:
        default = 0.0 if name in ("F_push", "fault") else np.nan
        columns[name] = _read_column(path, table, name) if name in table.column_names else np.full(rows, default)
    columns |= _read_optional_columns(table, set(table.column_names) - columns.keys())
    _check_times(path, columns["t"])
    _check_values(path, columns)
    return RecordedSamples(path, columns)


def _read_table(path: Path) -> Any:
    # pyarrow is large, so only a replay imports it.
    import pyarrow as pa
    import pyarrow.csv
    import pyarrow.parquet

    try:
        if path.suffix == ".csv":
            return pa.csv.read_csv(path, pa.csv.ReadOptions(skip_rows=_count_comment_lines(path)))
        if path.suffix == ".parquet":
            return pa.parquet.read_table(path)
    except OSError as error:
        raise PlantError(
            messages.recording_unreadable(recording=path.name, reason=error.strerror or str(error))
        ) from None
    except pa.ArrowException as error:
        raise PlantError(
            messages.recording_unreadable(recording=path.name, reason=str(error).splitlines()[0])
        ) from None
    raise PlantError(messages.recording_of_other_format(recording=path.name))


def _count_comment_lines(path: Path) -> int:
    """Return the number of lines with # before the header."""
    with path.open("rb") as lines:
        stripped = (
            line.removeprefix(b"\xef\xbb\xbf") for line in lines
        )  # some editors write a BOM before the first line
        return next((number for number, line in enumerate(stripped) if not line.startswith(b"#")), 0)


def _read_column(path: Path, table: Any, name: str, unit: str = "") -> Signal:
    import pyarrow as pa

    if name not in table.column_names:
        raise PlantError(
            messages.column_missing(recording=path.name, column=name, unit=unit, columns=table.column_names)
        )
    if table.column_names.count(name) > 1:
        raise PlantError(messages.column_not_unique(recording=path.name, column=name))
    unit_found = (table.schema.field(name).metadata or {}).get(b"unit", unit.encode()).decode()
    if unit and unit_found != unit:
        raise PlantError(
            messages.column_in_other_unit(recording=path.name, column=name, unit=unit_found, expected=unit)
        )
    try:
        values = table.column(name).cast(pa.float64()).to_numpy()
    except pa.ArrowInvalid:
        raise PlantError(messages.column_without_numbers(recording=path.name, column=name)) from None
    return np.asarray(values, dtype=np.float64)


def _read_optional_columns(table: Any, names: set[str]) -> dict[str, Signal]:
    """Return the optional columns: those that hold numbers and occur once."""
    import pyarrow as pa

    found = {}
    for name in sorted(names):
        if table.column_names.count(name) == 1:
            with suppress(pa.ArrowException):
                found[name] = np.asarray(table.column(name).cast(pa.float64()).to_numpy(), dtype=np.float64)
    return found


def _check_times(path: Path, t: Signal) -> None:
    if not np.all(np.isfinite(t)):
        sample = int(np.argmin(np.isfinite(t))) + 1
        raise PlantError(messages.sample_without_time(recording=path.name, sample=sample))
    steps = np.diff(t)
    period = float(np.median(steps))
    if abs(period - T_s) > _JITTER * T_s:
        raise PlantError(messages.recording_of_other_period(recording=path.name, period_s=period, expected_s=T_s))
    is_irregular = np.abs(steps - T_s) > _JITTER * T_s
    if np.any(is_irregular):
        at = int(np.argmax(is_irregular))
        raise PlantError(messages.samples_missing(recording=path.name, t=float(t[at]), step_s=float(steps[at])))


def _check_values(path: Path, columns: dict[str, Signal]) -> None:
    """Raise PlantError for missing or implausible values.

    A sensor value may be missing while a fault is latched.
    """
    t, fault = columns["t"], columns["fault"]
    for name, unit in UNITS.items():
        values = columns[name]
        allowed = (fault > 0.0) if name in _MEASURED else np.zeros(t.size, dtype=bool)
        wrong = ~np.isfinite(values) & ~allowed
        if np.any(wrong):
            at = int(np.argmax(wrong))
            raise PlantError(messages.sample_not_a_number(recording=path.name, column=name, t=float(t[at])))
        if name in _LARGEST and float(np.nanmax(np.abs(values))) > 1.001 * _LARGEST[name]:
            at = int(np.nanargmax(np.abs(values)))
            raise PlantError(
                messages.sample_out_of_range(
                    recording=path.name,
                    column=name,
                    value=float(values[at]),
                    t=float(t[at]),
                    maximum=_LARGEST[name],
                    unit=unit,
                )
            )


# Replay --------------------------------------------------------------------------------------------


SAFETY_MODULE = 12.0
"""Code of the safety module's trip in the column ``fault``."""


class ReplayDifference(NamedTuple):
    """Largest difference [V] between written and recorded voltage, with its place.

    ``output`` is the name of the output, ``t`` the time [s].
    """

    volts: float
    output: str
    t: float


class Replay:
    """A plant that advances by one recorded sample at each write.

    It starts at its first sample when it is opened. At the end one reading raises PlantError, with the largest
    difference between written and recorded voltages; after that it stays at its first sample until it is acknowledged,
    which replays it. The encoders' zeros are those of the recording.
    """

    paces_loop = False
    pushes = False
    loads_shafts = False
    stepped = True
    unattended_max_s = 0.4
    unready = ""

    def __init__(self, recording: RecordedSamples) -> None:
        self.recording, columns = recording, recording.columns
        names = ("q", "theta_A", "theta_B", "F_A", "F_B", "S_true", "F_push")
        F_wall = columns["F_wall"]
        trips = (columns["fault"] == SAFETY_MODULE).astype(np.float64)
        self._measured = np.column_stack([*(columns[name] for name in names), trips, F_wall])
        self._ended = False
        self._raw = np.column_stack([columns[name] for name in RawReading._fields])
        self._recorded_outputs = np.column_stack([columns["u_A"], columns["u_B"]])
        self._t = columns["t"]
        self.description: str = messages.replay_of(file=recording.path.name, duration_s=recording.duration_s)
        self.samples = len(recording)
        self.sample = 0
        self.difference = ReplayDifference(0.0, "u_A", float(self._t[0]))
        self.raw = NO_RAW

    def open(self) -> None:
        """Start at the first sample."""
        self._rewind()

    def _rewind(self) -> None:
        self.sample = 0
        self.difference = ReplayDifference(0.0, "u_A", float(self._t[0]))
        self._ended = False

    def read(self) -> Measurement:
        """Return the recorded measurement. Raises PlantError once, at the end."""
        if self.sample == self.samples:
            self.sample, self._ended = 0, True
            volts, output, t = self.difference
            raise PlantError(messages.recording_ended(samples=self.samples, difference_V=volts, output=output, t=t))
        self.raw = RawReading(*self._raw[self.sample].tolist())
        return Measurement(*self._measured[self.sample].tolist())

    def write(self, command: MotorCommand) -> None:
        """Advance by one sample and compare the voltages with the recorded ones.

        Raises PlantError for a voltage that is not finite.
        """
        require_numbers(command)
        if self._ended or self.sample == self.samples:
            return
        recorded = self._recorded_outputs[self.sample].tolist()
        for output, written, then in zip(("u_A", "u_B"), command, recorded, strict=True):
            if abs(written - then) > self.difference.volts:
                self.difference = ReplayDifference(abs(written - then), output, float(self._t[self.sample]))
        self.sample += 1

    def push(self, F_push: float) -> None:
        """Raise PlantError: a recording cannot be pushed."""
        raise PlantError(messages.replay_cannot_be_pushed())

    def load(self, load: ShaftLoad) -> None:
        """Raise PlantError: a recording cannot be loaded."""
        raise PlantError(messages.replay_cannot_be_loaded())

    def inject(self, injected_fault: InjectedFault | None) -> None:
        """Raise PlantError: faults cannot be injected into a recording."""
        raise PlantError(messages.replay_without_fault_injection())

    def zero(self, q: float, theta_A: float, theta_B: float, *, at_switch: bool = False) -> None:
        """Raise PlantError: the zeros of a recording are fixed."""
        raise PlantError(messages.replay_has_its_zeros())

    def acknowledge(self) -> None:
        """Replay from the first sample."""
        self._rewind()

    def close(self) -> None:
        """Do nothing: no hardware is open."""
