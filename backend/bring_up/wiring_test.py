"""Drives off: what is moved by hand has to be seen by its own sensor, by enough, to the right side."""

from typing import NamedTuple

import numpy as np

from backend.bring_up.work import SLACK, Figure, Finding, Signal, Work, blocks, known
from plant.manual_input import Hand


class _Sensor(NamedTuple):
    """``least``: what a hand moves at the very least; ``place`` and ``sign``: entries of the wiring."""

    signal: str
    words: str
    unit: str
    least: float
    section: str
    place: str
    sign: str


_Q = _Sensor("q", "joint encoder", "rad", 0.08, "encoder_q", "counter", "direction")
_ENCODERS = (
    _Q,
    _Sensor("theta_A", "encoder of motor A", "rad", 0.3, "encoder_A", "counter", "direction"),
    _Sensor("theta_B", "encoder of motor B", "rad", 0.3, "encoder_B", "counter", "direction"),
)
_CELLS = (
    _Sensor("F_A", "load cell A", "N", 3.0, "load_cell_A", "channel", "slope"),
    _Sensor("F_B", "load cell B", "N", 3.0, "load_cell_B", "channel", "slope"),
)
_MOVED = 0.4
"""A sensor that has gone by this part of its least has moved."""

_WIND = f"Turn motor {{}} by hand by {_ENCODERS[1].least:g} rad or more so that it winds its tendon, and confirm"
_ASKS = (
    (_Q, f"Turn the joint by hand towards +q by {_Q.least:g} rad or more, and confirm", Hand(q=0.15)),
    (_ENCODERS[1], _WIND.format("A"), Hand(theta_A=0.5)),
    (_ENCODERS[2], _WIND.format("B"), Hand(theta_B=0.5)),
    (_CELLS[0], "Pull at load cell A with some 7 N, and confirm", Hand(pull_A=7.0)),
    (_CELLS[1], "Pull at load cell B with some 7 N, and confirm", Hand(pull_B=7.0)),
)


async def wiring_test(work: Work) -> Finding:
    """Ask for each movement in turn; whatever is wrong is found at once, each with the entry to change."""
    await work.drives_off()
    problems: list[str] = []
    figures = []
    for wanted, words, hand in _ASKS:
        work.phase(wanted.words)
        group = _ENCODERS if wanted in _ENCODERS else _CELLS
        first = work.loop.ring.count
        await work.recorded(0.3)
        await work.ask(words, hand)
        await work.recorded(0.3)
        rows = work.since(first)
        seen = {sensor: _excursion(blocks(rows, sensor.signal)) for sensor in group}
        figures.append(Figure(f"{wanted.words} moved by", known(seen[wanted]), wanted.unit))
        problems += _judged(work, wanted, seen)
        if wanted in _ENCODERS:
            await work.ask("Put it back to where it was, and confirm", SLACK)
        await work.let_go()
    text = "; ".join(dict.fromkeys(problems)) or "every sensor moves as it should"
    return Finding(not problems, text, tuple(figures))


def _excursion(values: Signal) -> float:
    """Return the largest way from where it began, with its sign; nan where there was no number."""
    ways = values - values[0]
    return float(ways[np.argmax(np.abs(ways))]) if np.isfinite(ways).all() else float("nan")


def _judged(work: Work, wanted: _Sensor, seen: dict[_Sensor, float]) -> list[str]:
    way = seen[wanted]
    entry = getattr(work.wiring, wanted.section)
    at = getattr(entry, wanted.place)
    if not np.isfinite(way):
        return [f"the {wanted.words} gives no number: look at its cable and its amplifier at {at}"]
    # The joint, turned by hand, may drag a motor along by a taut tendon: for a motor and a load cell all others count.
    others = [other for other, moved in seen.items() if other is not wanted and abs(moved) > _MOVED * other.least]
    if abs(way) < _MOVED * wanted.least:
        if others:
            other = others[0]
            return [
                f"it is the {other.words} that moved, not the {wanted.words}: exchange {wanted.section}.{wanted.place} "
                f"and {other.section}.{other.place} in the wiring file"
            ]
        return [f"the {wanted.words} did not move: look at its cable and at {wanted.section}.{wanted.place} ({at})"]
    if abs(way) < wanted.least:
        return [
            f"the {wanted.words} moved by {way:.2f} {wanted.unit} only, {wanted.least:g} are asked for: move it "
            f"further, or mend {wanted.section}"
        ]
    if way < 0.0:
        return [
            f"the {wanted.words} goes backwards: turn the sign of {wanted.section}.{wanted.sign} in the wiring file"
        ]
    if others and wanted is not _Q:
        return [f"the {others[0].words} moved too: look for a cable that carries both"]
    return []
