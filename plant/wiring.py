"""Wiring of a rig to its card: channels, directions, calibrations from TOML.

Each number has its value, unit and source, as in a parameter file; names of channels and lines are plain text.
``docs/how-to/rig.md`` has the table. All errors are reported at once, each with its line and a remedy.
"""

import math
import re
import tomllib
from collections.abc import Iterator
from dataclasses import Field, dataclass, field, fields
from itertools import pairwise
from pathlib import Path
from typing import Any, NamedTuple

from plant import messages
from plant.errors import ErrorCode, SinewError
from plant.interface import FILE_NAME_MAX
from plant.message import Message

# Wiring errors -------------------------------------------------------------------------------------
# Errors of a wiring file, each with its line and a remedy.


class WiringProblem(NamedTuple):
    """One error: ``line`` of the file from 1 (0: whole file), entry, text and remedy."""

    line: int
    entry: str
    text: Message
    remedy: Message

    def sentence(self, file: str) -> Message:
        """Return the error as one line."""
        place = f"{file}:{self.line}" if self.line else file
        return messages.wiring_problem(place=place, entry=self.entry, problem=self.text, remedy=self.remedy)


class WiringError(SinewError, ValueError):
    """Rejected wiring file; ``problems`` are all errors found."""

    category = ErrorCode.BAD_VALUE

    def __init__(self, file: str, problems: tuple[WiringProblem, ...]) -> None:
        self.problems = problems
        self.sentences = [problem.sentence(file) for problem in problems]
        super().__init__(messages.wiring_rejected(problems=self.sentences))


_HEADER = re.compile(r"\s*\[\s*([\w-]+)\s*\]")
_KEY = re.compile(r"\s*([\w-]+)\s*=")


def find_lines(text: str) -> dict[str, int]:
    """Return the line numbers of sections and their entries, from 1."""
    return dict(_find_entries(text))


def _find_entries(text: str) -> Iterator[tuple[str, int]]:
    section = ""
    for position, line in enumerate(text.splitlines(), 1):
        if (header := _HEADER.match(line)) is not None:
            section = header[1]
            yield section, position
        elif (key := _KEY.match(line)) is not None and section:
            yield f"{section}.{key[1]}", position


# Wiring --------------------------------------------------------------------------------------------


_FOLDER = Path(__file__).parent / "wirings"
SHIPPED = tuple(sorted(path.stem for path in _FOLDER.glob("*.toml")))

BEYOND_TABLE = 0.05
"""Extrapolation of a load cell's table, as a fraction of its span: noise around 0 N is not a fault."""

WATCHDOG_MAX_S = 0.05
"""Longest permitted time of the card's watchdog on a rig [s]."""


def number(unit: str, minimum: float, maximum: float, default: float | None = None) -> Any:
    """Return a field for a number with unit and bounds; with a default it is optional."""
    return field(metadata={"unit": unit, "minimum": minimum, "maximum": maximum, "default": default})


def name(pattern: str, description: str, default: str | None = None) -> Any:
    """Return a field for a name on the card; ``description`` states the expected form."""
    return field(metadata={"pattern": pattern, "wanted": description, "default": default})


def rows(unit: str) -> Any:
    """Return an optional field for a table of pairs that rise in the first column."""
    return field(metadata={"unit": unit, "rows": True, "default": ()})


_COUNTER = name(r"ctr[0-3]", "a counter of the card, ctr0 to ctr3")
_AI = name(r"ai(?:[0-7]|1[6-9]|2[0-3])", "a differential analog input of the card, ai0 to ai7 or ai16 to ai23")
_AO = name(r"ao[0-3]", "an analog output of the card, ao0 to ao3")
_LINE = r"port0/line(?:[12]?\d|3[01])|port[12]/line[0-7]"

PFI_OF_COUNTER = {"ctr0": (8, 10, 9), "ctr1": (3, 11, 4), "ctr2": (0, 2, 1), "ctr3": (5, 7, 6)}
"""PFI lines of A, B and Z of a counter's encoder with default routing (X Series)."""


@dataclass(frozen=True)
class CardWiring:
    """Name of the card, its timing and the time of its watchdog."""

    device: str = name(r"[A-Za-z][\w-]*", "the card's name in NI MAX or `nilsdev`, Dev1 for instance")
    timing: str = name(r"hardware|on-demand", '"hardware" or "on-demand"', "on-demand")
    watchdog_s: float = number("s", 0.005, WATCHDOG_MAX_S, WATCHDOG_MAX_S)


@dataclass(frozen=True)
class MotorWiring:
    """Motor at an analog output.

    ``gain`` [V/V]: volts at the terminal per commanded volt; its sign is the direction.
    """

    channel: str = _AO
    gain: float = number("V/V", -1.0, 1.0)


@dataclass(frozen=True)
class LoadCellWiring:
    """Load cell at an analog input, calibrated by slope and offset or by a table.

    The table holds volts and newtons and includes 0 N. It is extrapolated from its first and last piece by BEYOND_TABLE
    of its span in volts.
    """

    channel: str = _AI
    slope: float = number("N/V", -1e5, 1e5, math.nan)
    offset: float = number("V", -10.0, 10.0, 0.0)
    table: tuple[tuple[float, float], ...] = rows("V, N")


@dataclass(frozen=True)
class EncoderWiring:
    """Incremental encoder at a counter, with X4 decoding.

    ``counts_per_rev`` counts all four edges; ``direction`` is +1 or -1.
    """

    counter: str = _COUNTER
    counts_per_rev: float = number("1", 4.0, 4e6)
    direction: float = number("1", -1.0, 1.0)

    @property
    def radians_per_count(self) -> float:
        """Rotation of the shaft per count [rad], signed by the direction."""
        return self.direction * 2.0 * math.pi / self.counts_per_rev


@dataclass(frozen=True)
class LineWiring:
    """Digital line, and its active level."""

    line: str = name(_LINE, "a digital line, port0/line0 to port0/line31, or one of the eight of port1 and port2")
    active: str = name(r"high|low", '"high" or "low"')


@dataclass(frozen=True)
class SwitchWiring(LineWiring):
    """End switch; ``position`` is the joint angle at which it is held, NaN if unknown.

    Its sign is the end of the range at which the switch is, so it is never 0.
    """

    position: float = number("rad", -math.pi, math.pi, math.nan)

    def is_held_at(self, q: float) -> bool:
        """Return whether a joint at q [rad] holds the switch.

        It does at ``position`` or beyond.
        """
        return q * math.copysign(1.0, self.position) >= abs(self.position)


SECTIONS: dict[str, type] = {
    "card": CardWiring,
    "motor_A": MotorWiring,
    "motor_B": MotorWiring,
    "load_cell_A": LoadCellWiring,
    "load_cell_B": LoadCellWiring,
    "encoder_q": EncoderWiring,
    "encoder_A": EncoderWiring,
    "encoder_B": EncoderWiring,
    "drive_enable": LineWiring,
    "safety_tripped": LineWiring,
    "end_switch": SwitchWiring,
}


@dataclass(frozen=True)
class Wiring:
    """Complete wiring; ``sources`` maps ``section.entry`` to the source of a number."""

    title: str
    card: CardWiring
    motor_A: MotorWiring
    motor_B: MotorWiring
    load_cell_A: LoadCellWiring
    load_cell_B: LoadCellWiring
    encoder_q: EncoderWiring
    encoder_A: EncoderWiring
    encoder_B: EncoderWiring
    drive_enable: LineWiring
    safety_tripped: LineWiring
    end_switch: SwitchWiring
    sources: dict[str, str] = field(default_factory=dict, repr=False)


def is_wired_alike(one: Wiring, other: Wiring) -> bool:
    """Return whether channels, counts and directions are the same.

    Calibrations and the card's timing may differ.
    """
    return _get_connections(one) == _get_connections(other)


def _get_connections(w: Wiring) -> tuple[object, ...]:
    motors, cells = (w.motor_A, w.motor_B), (w.load_cell_A, w.load_cell_B)
    return motors, [(cell.channel, cell.slope < 0.0) for cell in cells], (w.encoder_q, w.encoder_A, w.encoder_B)


def load_wiring(name_or_path: str | Path) -> Wiring:
    """Load a shipped wiring or a TOML file. Raises WiringError with all errors."""
    path = _FOLDER / f"{name_or_path}.toml" if str(name_or_path) in SHIPPED else Path(name_or_path)
    try:
        text = path.read_text(encoding="utf-8-sig")  # some editors write a BOM
        document = tomllib.loads(text)
    except OSError:
        remedy = messages.choose_wiring(shipped=SHIPPED)
        raise _make_file_error(str(name_or_path), messages.wiring_unreadable(), remedy) from None
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        not_toml = messages.wiring_is_not_toml(reason=str(error))
        raise _make_file_error(path.name, not_toml, messages.correct_file()) from None
    if len(path.stem) > FILE_NAME_MAX:
        too_long = messages.wiring_name_too_long(length=len(path.stem), maximum=FILE_NAME_MAX)
        raise _make_file_error(f"{path.stem[:40]}...", too_long, messages.rename_file())
    return parse_wiring(path.stem, document, text, path.name)


def _make_file_error(file: str, text: Message, remedy: Message) -> WiringError:
    return WiringError(file, (WiringProblem(0, "file", text, remedy),))


def parse_wiring(title: str, document: dict[str, Any], text: str = "", file: str = "") -> Wiring:
    """Build a wiring from a document. Raises WiringError.

    ``text`` is the document's source, for line numbers.
    """
    reader = _Reader(find_lines(text))
    for section in document:
        if section not in SECTIONS:
            reader.add_problem(
                section, "", messages.wiring_entry_unknown(), messages.choose_known_entry(known=list(SECTIONS))
            )
    parts = {section: reader.read_section(section, kind, document.get(section)) for section, kind in SECTIONS.items()}
    reader.check_shared(parts)
    reader.check_calibration(parts)
    if reader.problems:
        raise WiringError(file or title, tuple(sorted(reader.problems)))
    sections = {section: kind(**parts[section]) for section, kind in SECTIONS.items()}
    return Wiring(title=title, sources=reader.sources, **sections)


_Parts = dict[str, dict[str, Any]]


class _Reader:
    """Parser of sections that collects all errors."""

    def __init__(self, lines: dict[str, int]) -> None:
        self.problems: list[WiringProblem] = []
        self.sources: dict[str, str] = {}
        self._lines = lines

    def add_problem(self, section: str, entry: str, text: Message, remedy: Message) -> None:
        label = f"{section}.{entry}" if entry else section
        line = self._lines.get(label, self._lines.get(section, 0))
        self.problems.append(WiringProblem(line, label, text, remedy))

    def read_section(self, section: str, kind: type, entries: Any) -> dict[str, Any]:
        if not isinstance(entries, dict):
            self.add_problem(section, "", messages.wiring_entry_missing(), messages.give_section(section=section))
            return {}
        known = {entry.name: entry for entry in fields(kind)}
        for entry in entries:
            if entry not in known:
                self.add_problem(
                    section, entry, messages.wiring_entry_unknown(), messages.choose_known_entry(known=list(known))
                )
        return {entry: self._read_entry(section, declared, entries) for entry, declared in known.items()}

    def _read_entry(self, section: str, declared: "Field[Any]", entries: dict[str, Any]) -> Any:
        entry, metadata = declared.name, declared.metadata
        if entry not in entries:
            if metadata["default"] is None:
                self.add_problem(section, entry, messages.wiring_entry_missing(), _describe_entry(declared))
            return metadata["default"]
        value = entries[entry]
        if "pattern" in metadata:
            if not isinstance(value, str) or re.fullmatch(metadata["pattern"], value) is None:
                self.add_problem(section, entry, messages.unknown_connection(value=value), _describe_entry(declared))
            return value
        if not isinstance(value, dict) or set(value) != {"value", "unit", "source"}:
            self.add_problem(section, entry, messages.number_without_unit_and_source(), _describe_entry(declared))
            return metadata["default"]
        if value["unit"] != metadata["unit"]:
            text, remedy = messages.number_in_other_unit(unit=value["unit"]), messages.give_unit(unit=metadata["unit"])
            self.add_problem(section, entry, text, remedy)
        self.sources[f"{section}.{entry}"] = str(value["source"])
        return (
            self._read_table(section, entry, value)
            if "rows" in metadata
            else self._read_number(section, declared, value)
        )

    def _read_number(self, section: str, declared: "Field[Any]", entries: dict[str, Any]) -> float:
        value, metadata = entries["value"], declared.metadata
        if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
            self.add_problem(section, declared.name, messages.number_not_finite(value=value), _describe_entry(declared))
            return math.nan
        low, high, unit = metadata["minimum"], metadata["maximum"], metadata["unit"]
        if not low <= value <= high:
            bounds = messages.choose_number_in_range(minimum=low, maximum=high, unit=unit)
            self.add_problem(section, declared.name, messages.number_out_of_range(value=value, unit=unit), bounds)
        if value == 0.0 and declared.name in ("gain", "slope"):
            self.add_problem(section, declared.name, messages.scale_is_zero(), messages.give_measured_scale())
        if value == 0.0 and declared.name == "position":
            self.add_problem(
                section, declared.name, messages.end_switch_at_zero(), messages.give_signed_switch_position()
            )
        if declared.name == "direction" and abs(value) != 1.0:
            self.add_problem(section, declared.name, messages.not_a_direction(value=value), messages.give_direction())
        return float(value)

    def _read_table(self, section: str, entry: str, entries: dict[str, Any]) -> tuple[tuple[float, float], ...]:
        try:
            points = tuple((float(V), float(F)) for V, F in entries["value"])
        except (TypeError, ValueError):
            points = ()
        rising = all(one[0] < other[0] for one, other in pairwise(points))
        if len(points) < 2 or not rising or not all(math.isfinite(x) for point in points for x in point):
            self.add_problem(section, entry, messages.not_a_table_of_rising_voltage(), messages.give_table())
            return points
        newtons = [F for _, F in points]
        if newtons not in (sorted(set(newtons)), sorted(set(newtons), reverse=True)):
            self.add_problem(section, entry, messages.forces_not_monotonic(), messages.make_forces_monotonic())
        elif not min(newtons) <= 0.0 < max(newtons):
            text = messages.table_without_zero_force(minimum=min(newtons), maximum=max(newtons))
            self.add_problem(section, entry, text, messages.add_zero_force())
        return points

    def check_shared(self, parts: _Parts) -> None:
        """Report terminals that are used twice."""
        first: dict[str, str] = {}
        for section, entries in parts.items():
            for entry in ("channel", "counter", "line"):
                channel = entries.get(entry)
                for terminal in _list_terminals(channel) if isinstance(channel, str) else ():
                    if (other := first.setdefault(terminal, section)) != section:
                        text = messages.terminal_in_use(terminal=terminal, section=other)
                        self.add_problem(section, entry, text, messages.use_separate_terminals())
                        break  # a counter in use has its lines in use too

    def check_calibration(self, parts: _Parts) -> None:
        """Report a load cell with neither slope nor table, or with both."""
        for section in ("load_cell_A", "load_cell_B"):
            entries = parts[section]
            if entries and math.isnan(entries["slope"]) == (not entries["table"]):
                text = (
                    messages.load_cell_with_two_calibrations()
                    if entries["table"]
                    else messages.load_cell_without_calibration()
                )
                self.add_problem(section, "", text, messages.give_one_calibration())


def _list_terminals(channel: str) -> tuple[str, ...]:
    """Return the terminals that a channel, counter or line occupies.

    PFI k is line k of port 1, from 8 on of port 2.
    """
    lines = (f"port{1 + pfi // 8}/line{pfi % 8}" for pfi in PFI_OF_COUNTER.get(channel, ()))
    return (channel, *lines)


def _describe_entry(declared: "Field[Any]") -> Message:
    metadata = declared.metadata
    if "pattern" in metadata:
        return messages.give_connection(expected=metadata["wanted"])
    return messages.write_number_with_unit_and_source(entry=declared.name, unit=metadata["unit"])
