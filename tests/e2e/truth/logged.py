"""Comparison of the log with the state: the log contains every change, and its last entry agrees with the state.

Each moment is read as state, log, state, so that each value in the log agrees with one of the two states.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any

from backend.banks.tuning_settings import TUNING_SETTINGS, format_part
from tests.e2e.truth.findings import Findings
from tests.e2e.truth.moment import Around, State

LINES = 200
"""Lines of the log that are read after an action: more than one action and what ends by itself can leave."""

PARTS = tuple(setting for setting in TUNING_SETTINGS if setting.name not in ("bank",))

Line = dict[str, Any]


@dataclass(frozen=True)
class Account:
    """The log, newest entry first, between two readings of the state."""

    before: State
    lines: Sequence[Line]
    after: State

    @property
    def states(self) -> tuple[State, State]:
        return self.before, self.after


def account_of(around: Around) -> Account:
    """Read state, log and state."""
    before = around.state()
    lines = around.script.get(f"/api/log?limit={LINES}").raise_for_status().json()["entries"]
    return Account(before, lines, around.state())


def unlogged(earlier: Account, now: Account) -> Findings:
    """Return the changes since ``earlier`` that the log lacks or states differently."""
    found, new = Findings(), _new_lines(earlier.lines, now.lines)
    if len(new) == LINES:
        found.append(f"log: more than {LINES} lines since the action before")
    if now.after["link"]["starts"] == earlier.before["link"]["starts"]:
        _mode(found, earlier, now, new)
        _tuning(found, earlier, now, new)
    _told_if_changed(found, "holder of control", _holder, earlier, now, new, ("control ",))
    _told_if_changed(found, "wall", lambda state: state["wall"], earlier, now, new, ("obstacle ", "by the program: "))
    _told_if_changed(
        found, "fault", lambda state: state["fault"] and state["fault"]["message"], earlier, now, new, None
    )
    return found


def _new_lines(old: Sequence[Line], now: Sequence[Line]) -> list[Line]:
    """Return the new entries; an entry is identified by all but its later annotations."""
    known = {_key(line) for line in old}
    return [line for line in now if _key(line) not in known]


def _key(line: Line) -> tuple[object, ...]:
    return line["at"], line["kind"], line["text"], line["event"]


def _mode(found: Findings, earlier: Account, now: Account, new: Sequence[Line]) -> None:
    """Compare the mode with the last change of mode in the log."""
    modes = {state["mode"] for state in now.states}
    last = next((line["text"] for line in new if line["kind"] == "mode" and " → " in line["text"]), None)
    if last is not None:
        if last.rpartition(" → ")[2] not in modes:
            found.append(f"mode: the last change in the log is {last!r}, the service says {sorted(modes)}")
    elif not modes & {state["mode"] for state in earlier.states}:
        found.append(f"mode: {earlier.after['mode']} became {now.after['mode']}, of which the log has no line")


def _tuning(found: Findings, earlier: Account, now: Account, new: Sequence[Line]) -> None:
    """Compare each part of the tuning with its last change in the log."""
    for part in PARTS:
        values = {format_part(part.name, state["tuning"][part.name]) for state in now.states}
        last = next(_changes(new, part.symbol), None)
        if last is not None:
            if last not in values:
                found.append(f"{part.name}: the log's last value is {last!r}, the service says {sorted(values)}")
            continue
        before = {format_part(part.name, state["tuning"][part.name]) for state in earlier.states}
        if not values & before and not _is_told_otherwise(part.name, new):
            found.append(f"{part.name}: {sorted(before)} became {sorted(values)}, of which the log has no line")


def _changes(lines: Sequence[Line], symbol: str) -> Iterator[str]:
    """Yield the values of a part of the tuning, newest first, as ``TuningSettings.differences`` formats them."""
    units = {setting.symbol: "" if setting.unit == "1" else f" {setting.unit}" for setting in PARTS}
    for line in lines:
        for one in reversed(line["text"].rpartition(": ")[2].split(", ")):
            if one.startswith(f"{symbol} ") and " → " in one:
                yield one.rpartition(" → ")[2].removesuffix(units[symbol])


def _is_told_otherwise(name: str, new: Sequence[Line]) -> bool:
    """Return whether a change has an entry without values: changes by a program, or the end of a rejection."""
    begins = ["by the program: ", "as before the program: "]
    if name == "k_ext":
        begins.append("disturbance rejection disabled")
    return any(line["text"].startswith(tuple(begins)) for line in new)


def _told_if_changed(
    found: Findings,
    what: str,
    of: Callable[[State], object],
    earlier: Account,
    now: Account,
    new: Sequence[Line],
    begins: tuple[str, ...] | None,
) -> None:
    """Find the entry of a change; ``begins`` None: a fault, a trip, or a reset."""
    before, after = [of(state) for state in earlier.states], [of(state) for state in now.states]
    if any(one in before for one in after):
        return
    told = [line for line in new if (_is_of_faults(line) if begins is None else begins_with(line, begins))]
    if not told:
        found.append(f"{what}: {before[-1]!r} became {after[-1]!r}, of which the log has no line")


def _is_of_faults(line: Line) -> bool:
    return line["kind"] in ("fault", "trip") or "reset" in line["text"]


def begins_with(line: Line, begins: tuple[str, ...]) -> bool:
    text: str = line["text"]
    return text.startswith((*begins, "no obstacle"))


def _holder(state: State) -> object:
    """Return the holder of control; a reloaded page continues under another epoch without an entry."""
    return state["holder"] and (state["holder"]["name"], state["holder"]["page"])
