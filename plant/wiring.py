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

from plant.errors import ErrorCode, SinewError
from plant.interface import FILE_NAME_MAX
from plant.quantity import Quantity

# Wiring errors -------------------------------------------------------------------------------------
# Errors of a wiring file, each with its line and a remedy.


class WiringProblem(NamedTuple):
    """One error: ``line`` of the file from 1 (0: whole file), entry, text and remedy."""

    line: int
    entry: str
    text: str
    remedy: str

    def sentence(self, file: str) -> str:
        """Return the error as one line."""
        where = f"{file}:{self.line}" if self.line else file
        return f"{where}: {self.entry}: {self.text}; {self.remedy}"


class WiringError(SinewError, ValueError):
    """Rejected wiring file; ``problems`` are all errors found."""

    category = ErrorCode.BAD_VALUE

    def __init__(self, file: str, problems: tuple[WiringProblem, ...]) -> None:
        self.problems = problems
        self.sentences = [problem.sentence(file) for problem in problems]
        super().__init__("\n".join(self.sentences))


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
"""Extrapolation of a load cell's table, as a fraction of its span: noise around 0 N is no fault."""

WATCHDOG_MAX_S = 0.05
"""Longest permitted time of the card's watchdog on a rig [s]."""


def number(unit: str, minimum: float, maximum: float, default: float | None = None) -> Any:
    """Return a field for a number with unit and bounds; with a default it is optional."""
    return field(metadata={"unit": unit, "minimum": minimum, "maximum": maximum, "default": default})


def name(pattern: str, description: str, default: str | None = None) -> Any:
    """Return a field for a name on the card; ``description`` says what is expected."""
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
    """End switch; ``position`` is the joint angle at which it is held, NaN if unknown."""

    position: float = number("rad", -math.pi, math.pi, math.nan)

    def is_held_at(self, q: float) -> bool:
        """Return whether a joint at q [rad] holds the switch.

        It does at ``position`` or beyond.
        """
        return abs(q) >= abs(self.position) and q * self.position > 0.0


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
        remedy = f"use one of {', '.join(SHIPPED)}, or a TOML file"
        raise WiringError(str(name_or_path), (WiringProblem(0, "file", "it cannot be read", remedy),)) from None
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise WiringError(
            path.name, (WiringProblem(0, "file", f"it is not valid TOML: {error}", "correct the file"),)
        ) from None
    if len(path.stem) > FILE_NAME_MAX:
        problem = f"its name has {len(path.stem)} characters, {FILE_NAME_MAX} are the maximum"
        raise WiringError(f"{path.stem[:40]}...", (WiringProblem(0, "file", problem, "rename the file"),))
    return parse_wiring(path.stem, document, text, path.name)


def parse_wiring(title: str, document: dict[str, Any], text: str = "", file: str = "") -> Wiring:
    """Build a wiring from a document. Raises WiringError.

    ``text`` is the document's source, for line numbers.
    """
    reader = _Reader(find_lines(text))
    for section in document:
        if section not in SECTIONS:
            reader.add_problem(section, "", "it is unknown", f"known are {', '.join(SECTIONS)}")
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

    def add_problem(self, section: str, entry: str, text: str, remedy: str) -> None:
        label = f"{section}.{entry}" if entry else section
        line = self._lines.get(label, self._lines.get(section, 0))
        self.problems.append(WiringProblem(line, label, text, remedy))

    def read_section(self, section: str, kind: type, entries: Any) -> dict[str, Any]:
        if not isinstance(entries, dict):
            self.add_problem(section, "", "it is missing", f"give a section [{section}]")
            return {}
        known = {entry.name: entry for entry in fields(kind)}
        for entry in entries:
            if entry not in known:
                self.add_problem(section, entry, "it is unknown", f"known are {', '.join(known)}")
        return {entry: self._read_entry(section, declared, entries) for entry, declared in known.items()}

    def _read_entry(self, section: str, declared: "Field[Any]", entries: dict[str, Any]) -> Any:
        entry, metadata = declared.name, declared.metadata
        if entry not in entries:
            if metadata["default"] is None:
                self.add_problem(section, entry, "it is missing", _describe_entry(declared))
            return metadata["default"]
        value = entries[entry]
        if "pattern" in metadata:
            if not isinstance(value, str) or re.fullmatch(metadata["pattern"], value) is None:
                self.add_problem(section, entry, f"{value!r} is not known", f"give {metadata['wanted']}")
            return value
        if not isinstance(value, dict) or set(value) != {"value", "unit", "source"}:
            self.add_problem(section, entry, "a number requires a unit and a source", _describe_entry(declared))
            return metadata["default"]
        if value["unit"] != metadata["unit"]:
            self.add_problem(section, entry, f"it is in {value['unit']!r}", f"give it in {metadata['unit']!r}")
        self.sources[f"{section}.{entry}"] = str(value["source"])
        return (
            self._read_table(section, entry, value)
            if "rows" in metadata
            else self._read_number(section, declared, value)
        )

    def _read_number(self, section: str, declared: "Field[Any]", entries: dict[str, Any]) -> float:
        value, metadata = entries["value"], declared.metadata
        if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
            self.add_problem(section, declared.name, f"{value!r} is not a finite number", _describe_entry(declared))
            return math.nan
        low, high, unit = metadata["minimum"], metadata["maximum"], metadata["unit"]
        if not low <= value <= high:
            bounds = f"choose {Quantity(low, unit, high):g}"
            self.add_problem(section, declared.name, f"{Quantity(value, unit):g} is out of bounds", bounds)
        if value == 0.0 and declared.name in ("gain", "slope", "direction"):
            self.add_problem(section, declared.name, "0 is not a valid scale", "give the measured value with its sign")
        if declared.name == "direction" and abs(value) != 1.0:
            self.add_problem(section, declared.name, f"{value:g} is not a direction", "give 1 or -1")
        return float(value)

    def _read_table(self, section: str, entry: str, entries: dict[str, Any]) -> tuple[tuple[float, float], ...]:
        try:
            points = tuple((float(V), float(F)) for V, F in entries["value"])
        except (TypeError, ValueError):
            points = ()
        rising = all(one[0] < other[0] for one, other in pairwise(points))
        if len(points) < 2 or not rising or not all(math.isfinite(x) for point in points for x in point):
            text = "it is not a table of two or more points with rising voltage"
            self.add_problem(section, entry, text, "give [[V, N], [V, N], ...]")
            return points
        newtons = [F for _, F in points]
        if newtons not in (sorted(set(newtons)), sorted(set(newtons), reverse=True)):
            self.add_problem(
                section, entry, "its forces are not monotonic", "make them rise, or fall, with the voltage"
            )
        elif not min(newtons) <= 0.0 < max(newtons):
            text = f"it covers {min(newtons):g} to {max(newtons):g} N"
            self.add_problem(
                section, entry, text, "add a measured point at 0 N: the load cell also reads a slack tendon"
            )
        return points

    def check_shared(self, parts: _Parts) -> None:
        """Report terminals that are used twice."""
        first: dict[str, str] = {}
        for section, entries in parts.items():
            for entry in ("channel", "counter", "line"):
                channel = entries.get(entry)
                for terminal in _list_terminals(channel) if isinstance(channel, str) else ():
                    if (other := first.setdefault(terminal, section)) != section:
                        self.add_problem(
                            section, entry, f"{terminal} is already used by {other}", "use a separate terminal for each"
                        )
                        break  # a counter in use has its lines in use too

    def check_calibration(self, parts: _Parts) -> None:
        """Report a load cell with neither slope nor table, or with both."""
        for section in ("load_cell_A", "load_cell_B"):
            entries = parts[section]
            if entries and math.isnan(entries["slope"]) == (not entries["table"]):
                text = "it has no calibration" if not entries["table"] else "it has two calibrations"
                self.add_problem(section, "", text, "give slope and offset, or a table: the bring-up measures them")


def _list_terminals(channel: str) -> tuple[str, ...]:
    """Return the terminals that a channel, counter or line occupies.

    PFI k is line k of port 1, from 8 on of port 2.
    """
    lines = (f"port{1 + pfi // 8}/line{pfi % 8}" for pfi in PFI_OF_COUNTER.get(channel, ()))
    return (channel, *lines)


def _describe_entry(declared: "Field[Any]") -> str:
    metadata = declared.metadata
    if "pattern" in metadata:
        return f"give {metadata['wanted']}"
    return f'write {declared.name} = {{ value = ..., unit = "{metadata["unit"]}", source = "..." }}'
