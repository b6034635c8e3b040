"""Metrics of impacts: how hard the joint hit the wall of the simulator, and what the wall bore in all. Pure."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from backend.experiments.results.metrics import NoSamplesError, figure
from backend.experiments.results.whole import Columns, Whole, whole
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
    """

    window: slice
    S_ref: float
    speed: float
    peak_N: float
    impulse_Ns: float
    contact_s: float


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
    reasons: Mapping[str, str] = field(default_factory=dict)


def hits_of(columns: Columns) -> tuple[Hit, ...]:
    """Return the hits of a run, in order; none where nothing was hit or no force of a wall was recorded."""
    force = np.abs(columns["F_wall"]) if "F_wall" in columns else np.empty(0)
    touched = np.flatnonzero(force > 0.0)
    if touched.size == 0:
        return ()
    parts = np.split(touched, np.flatnonzero(np.diff(touched) > round(APART_S / T_s)) + 1)
    return tuple(_hit(columns, force, part) for part in parts)


def _hit(columns: Columns, force: np.ndarray, touched: np.ndarray) -> Hit:
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
    )


def impact_figures(columns: Columns) -> ImpactFigures:
    """Measure one run. ``columns`` holds F_wall, q, S_ref, tensions and voltages, one sample a millisecond.

    Raises NoSamplesError where no wall was hit.
    """
    hits = hits_of(columns)
    if not hits:
        raise NoSamplesError("no wall was hit")
    pairs, reason = _pairs(hits)
    return ImpactFigures(
        **whole(columns),
        hits=float(len(hits)),
        peak_force_N=max(hit.peak_N for hit in hits),
        impulse_Ns=max(hit.impulse_Ns for hit in hits),
        soft_to_stiff_peak=_mean([soft.peak_N / stiff.peak_N for soft, stiff in pairs]),
        soft_to_stiff_impulse=_mean([soft.impulse_Ns / stiff.impulse_Ns for soft, stiff in pairs]),
        reasons=dict.fromkeys(("soft_to_stiff_peak", "soft_to_stiff_impulse"), reason) if reason else {},
    )


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
        if not abs(one.speed - other.speed) <= ALIKE * max(one.speed, other.speed):
            return [], f"hits at {one.speed:.3g} and {other.speed:.3g} rad/s cannot be compared"
    return list(zip(soft, stiff, strict=True)), ""


def _mean(ratios: Sequence[float]) -> float | None:
    return float(np.mean(ratios)) if ratios else None
