"""Metrics of impacts: how hard the joint hit the simulator's wall, and how soon it felt that and gave way. Pure."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from backend.experiments.results.metrics import NoSamplesError, figure
from backend.experiments.results.whole import Columns, Whole, whole
from backend.faults import Limit
from backend.realtime.program import Program
from plant.interface import T_s

APART_S = 0.3
"""Contacts that are this far apart are hits of their own; nearer ones are a joint that bounces."""

APPROACH_S = 0.05
"""Over so long before the touch the speed of approach is measured: 30 encoder counts at 1 rad/s."""

ALIKE = 0.1
"""Hits are compared where their speeds of approach differ by less than this part."""

_S_ALIKE = 1e-6


class Hit(NamedTuple):
    """One hit: where it begins and the sample after its last contact, and what was measured of it.

    ``S_ref`` [N·m/rad] and the speed of approach [rad/s] as the wall is touched, the largest force [N], the time
    integral of the force [N·s] and the time in contact [s], over all bounces.

    ``contact_N`` [N] is the force from which on the program gives way, nan where it gives way to nothing. Times [s],
    nan where it did not happen: ``felt_s`` from the touch until the estimate passes it, ``gave_way_s`` from there until
    the joint gives way, ``fell_s`` from there until the force is at its largest, from where on it falls.
    """

    window: slice
    S_ref: float
    speed: float
    peak_N: float
    impulse_Ns: float
    contact_s: float
    contact_N: float = math.nan
    felt_s: float = math.nan
    gave_way_s: float = math.nan
    fell_s: float = math.nan

    @property
    def reacts(self) -> bool:
        """Whether it was to be given way to."""
        return math.isfinite(self.contact_N)


@dataclass(frozen=True, kw_only=True)
class ImpactFigures(Whole):
    """Figures over all hits. ``reasons`` tells by name which could not be measured and why."""

    hits: float = figure("1", "Hits", "contacts with the wall at least 0.3 s after the one before")
    peak_force_N: float = figure("N", "Largest contact force", "largest |F_wall| of all hits")
    impulse_Ns: float = figure(
        "N·s", "Largest impulse", "largest time integral of |F_wall| over a hit, bounces included"
    )
    soft_to_stiff_peak: float | None = figure(
        "1", "Peak force, soft over stiff", "mean over the speeds: peak at the lowest S_ref over that at the highest"
    )
    soft_to_stiff_impulse: float | None = figure(
        "1", "Impulse, soft over stiff", "mean over the speeds: impulse at the lowest S_ref over that at the highest"
    )
    reaction_peak: float | None = figure(
        "1", "Peak force, with over without reaction", "mean over stiffness and speed of the peaks' ratio"
    )
    reaction_impulse: float | None = figure(
        "1", "Impulse, with over without reaction", "mean over stiffness and speed of the impulses' ratio"
    )
    felt_after_s: float | None = figure(
        "s", "Longest time to detect", "from the touch until the estimated force passes the threshold"
    )
    gave_way_after_s: float | None = figure(
        "s", "Longest time to react", "from the threshold until the joint gives way"
    )
    fell_after_s: float | None = figure(
        "s", "Longest time to the peak", "from the threshold until the force is at its largest, from where on it falls"
    )
    reasons: Mapping[str, str] = field(default_factory=dict)


def hits_of(columns: Columns, program: Program | None = None) -> tuple[Hit, ...]:
    """Return the hits of a run, in order; none where nothing was hit or no force of a wall was recorded.

    ``program`` says from what force on a hit was to be given way to; without one, none was.
    """
    force = np.abs(columns["F_wall"]) if "F_wall" in columns else np.empty(0)
    touched = np.flatnonzero(force > 0.0)
    if touched.size == 0:
        return ()
    parts = np.split(touched, np.flatnonzero(np.diff(touched) > round(APART_S / T_s)) + 1)
    from_N = _thresholds(program, force.size)
    return tuple(_hit(columns, force, part, from_N) for part in parts)


def _thresholds(program: Program | None, samples: int) -> NDArray[np.float64]:
    """Return the force [N] of a contact in each sample, nan where the program gives way to nothing."""
    from_N, tick, contact_N = np.full(samples, np.nan), 0, 0.0
    for segment in program.segments if program is not None and program.touches else ():
        if program is not None and segment.touch:
            contact_N = program.touches[segment.touch - 1].contact_N
        after = tick + round(segment.duration_s / T_s)
        from_N[tick:after] = contact_N or np.nan
        tick = after
    return from_N


def _hit(columns: Columns, force: np.ndarray, touched: np.ndarray, from_N: np.ndarray) -> Hit:
    first, end = int(touched[0]), int(touched[-1]) + 1
    before = columns["q"][max(first - round(APPROACH_S / T_s), 0) : first]
    speed = abs(float(np.polyfit(np.arange(before.size) * T_s, before, 1)[0])) if before.size > 2 else float("nan")
    return Hit(
        slice(first, end),
        float(columns["S_ref"][first]),
        speed,
        float(force[first:end].max()),
        float(force[first:end].sum() * T_s),
        touched.size * T_s,
        *_reaction(columns, force, slice(first, end), float(from_N[first])),
    )


def _reaction(columns: Columns, force: np.ndarray, window: slice, contact_N: float) -> tuple[float, ...]:
    """Return the threshold [N] and the times [s] to feel, to give way and to the largest force."""
    end = window.stop + round(APART_S / T_s)  # a joint that has bounced off already is felt all the same
    felt = _first(np.abs(columns["F_ext_hat"][window.start : end]) > contact_N) if math.isfinite(contact_N) else None
    if felt is None:
        return contact_N, math.nan, math.nan, math.nan
    began = window.start + felt
    gave = _first(columns["limits"][began:end].astype(np.int64) & int(Limit.CONTACT) != 0)
    largest = int(np.argmax(force[window])) - felt
    return (
        contact_N,
        felt * T_s,
        math.nan if gave is None else gave * T_s,
        math.nan if gave is None else max(largest, 0) * T_s,
    )


def _first(holds: np.ndarray) -> int | None:
    return int(np.argmax(holds)) if holds.any() else None


def impact_figures(columns: Columns, program: Program | None = None) -> ImpactFigures:
    """Measure one run. ``columns`` holds F_wall, q, S_ref, tensions and voltages, one sample a millisecond.

    And F_ext_hat and limits, where ``program`` gives way to contacts. Raises NoSamplesError where no wall was hit.
    """
    hits = hits_of(columns, program)
    if not hits:
        raise NoSamplesError("no wall was hit")
    plain, reacting = [hit for hit in hits if not hit.reacts], [hit for hit in hits if hit.reacts]
    pairs, reason = _pairs(plain or hits)
    beside, why = beside_each_other(hits)
    unfelt = "" if reacting else _NOT_GIVEN_WAY
    missed = sum(not math.isfinite(hit.gave_way_s) for hit in reacting)
    if missed:
        unfelt = f"{missed} of {len(reacting)} hits were not felt or not given way to"
    reasons = dict.fromkeys(("soft_to_stiff_peak", "soft_to_stiff_impulse"), reason)
    reasons |= dict.fromkeys(("reaction_peak", "reaction_impulse"), unfelt or why)
    reasons |= dict.fromkeys(("felt_after_s", "gave_way_after_s", "fell_after_s"), unfelt)
    beside = () if unfelt else beside
    return ImpactFigures(
        **whole(columns),
        hits=float(len(hits)),
        peak_force_N=max(hit.peak_N for hit in hits),
        impulse_Ns=max(hit.impulse_Ns for hit in hits),
        soft_to_stiff_peak=_mean([soft.peak_N / stiff.peak_N for soft, stiff in pairs]),
        soft_to_stiff_impulse=_mean([soft.impulse_Ns / stiff.impulse_Ns for soft, stiff in pairs]),
        reaction_peak=_mean([reacted.peak_N / plain.peak_N for plain, reacted in beside]),
        reaction_impulse=_mean([reacted.impulse_Ns / plain.impulse_Ns for plain, reacted in beside]),
        felt_after_s=None if unfelt else max(hit.felt_s for hit in reacting),
        gave_way_after_s=None if unfelt else max(hit.gave_way_s for hit in reacting),
        fell_after_s=None if unfelt else max(hit.fell_s for hit in reacting),
        reasons={name: why for name, why in reasons.items() if why},
    )


_NOT_GIVEN_WAY = "no hit was to be given way to"


def beside_each_other(hits: Sequence[Hit]) -> tuple[tuple[tuple[Hit, Hit], ...], str]:
    """Return hits without and with reaction, of one stiffness and equally fast, in turn; or why there are none."""
    left, pairs = [hit for hit in hits if not hit.reacts], []
    for hit in (hit for hit in hits if hit.reacts):
        alike = [other for other in left if abs(other.S_ref - hit.S_ref) < _S_ALIKE and _as_fast(other, hit)]
        if not alike:
            return (
                (),
                f"beside the hit at {hit.S_ref:.4g} N·m/rad and {hit.speed:.3g} rad/s there is none without reaction",
            )
        other = min(alike, key=lambda other: abs(other.speed - hit.speed))
        left.remove(other)
        pairs.append((other, hit))
    return tuple(pairs), "" if pairs else _NOT_GIVEN_WAY


def _as_fast(one: Hit, other: Hit) -> bool:
    return abs(one.speed - other.speed) <= ALIKE * max(one.speed, other.speed)


def _pairs(hits: Sequence[Hit]) -> tuple[list[tuple[Hit, Hit]], str]:
    """Return hits at the lowest and the highest stiffness that were equally fast, in turn; or why there are none."""
    low, high = min(hit.S_ref for hit in hits), max(hit.S_ref for hit in hits)
    if high - low < _S_ALIKE:
        return [], f"all hits were at {low:.4g} N·m/rad"
    soft = [hit for hit in hits if hit.S_ref - low < _S_ALIKE]
    stiff = [hit for hit in hits if high - hit.S_ref < _S_ALIKE]
    if len(soft) != len(stiff):
        return [], f"{len(soft)} hits were soft and {len(stiff)} stiff: they are compared one by one"
    for one, other in zip(soft, stiff, strict=True):
        if not _as_fast(one, other):
            return [], f"hits at {one.speed:.3g} and {other.speed:.3g} rad/s cannot be compared"
    return list(zip(soft, stiff, strict=True)), ""


def _mean(ratios: Sequence[float]) -> float | None:
    return float(np.mean(ratios)) if ratios else None
