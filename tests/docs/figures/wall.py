"""The tables of docs/explanation/fidelity.md on obstacles: two stiffnesses, without and with contact reaction."""

from collections.abc import Iterator

import numpy as np

from backend.analysis.disturbance_metrics import Hit, find_hits, pair_hits
from plant.parameters import load_parameters
from tests.docs.figures.places import Computation, Found, Prose, Table
from tests.docs.figures.runs import experiment

PAGE = "docs/explanation/fidelity.md"

IMPACT = Table(
    PAGE,
    "impact",
    (
        "approach",
        *("peak at S = 8", "peak at S = 15", "ratio, soft to stiff"),
        *("impulse at S = 8", "impulse at S = 15", "ratio, soft to stiff"),
    ),
)
REACTION = Table(
    PAGE,
    "reaction",
    (
        *("S, approach", "detected after", "reacts after", "force falls after"),
        *("peak", "ratio with / without", "impulse", "ratio with / without"),
    ),
)
CONTACT = Prose(
    PAGE,
    "contact",
    "a mass of J_j/r_j² = {mass:.3f} kg, the contact lasts {contact:.1f} ms",
)
LATER = Prose(PAGE, "time of the peak", "peak comes {least:.0f} to {most:.0f} ms later")
SPARED = Prose(
    PAGE,
    "what the reaction takes",
    "the reaction reduces the impulse by {impulse_least:.0f} to {impulse_most:.0f} % and "
    "the peak by {peak_least:.0f} to {peak_most:.0f} %",
)
K_WALL = 20e3


def computations() -> Iterator[Computation]:
    """Return the only run of these tables."""
    yield Computation("impact", (IMPACT, REACTION, CONTACT, LATER, SPARED), impacts)


def impacts() -> Found:
    """Return both tables and the figures of the text."""
    run = experiment(load_parameters("lab"), "impact")
    columns, geometry = run.played.columns, run.parameters.geometry
    hits = find_hits(columns, run.plan.program())
    plain = [hit for hit in hits if not hit.reacts]
    low = min(hit.S_ref for hit in plain)
    soft, stiff = ([hit for hit in plain if (hit.S_ref == low) is is_soft] for is_soft in (True, False))
    pairs, why = pair_hits(hits)
    assert not why, why
    pairs = tuple(sorted(pairs, key=lambda pair: (pair[0].S_ref, pair[0].speed)))
    later = [1e3 * columns["t"][int(np.argmax(np.abs(columns["F_wall"][hit.window])))] for hit in plain]
    felt = [pair for pair in pairs if np.isfinite(pair[1].reaction_s)]
    less_peak, less_impulse = zip(*map(_spared, felt), strict=True)
    mass = geometry.J_j / geometry.r_j**2
    return {
        IMPACT: [_impact(*both) for both in zip(soft, stiff, strict=True)],
        REACTION: [_reaction(*pair) for pair in pairs],
        CONTACT: {"mass": mass, "contact": 1e3 * np.pi * np.sqrt(mass / K_WALL)},
        LATER: {"least": round(min(later), -1), "most": round(max(later), -1)},
        SPARED: {
            "impulse_least": min(less_impulse),
            "impulse_most": max(less_impulse),
            "peak_least": min(less_peak),
            "peak_most": max(less_peak),
        },
    }


def _impact(soft: Hit, stiff: Hit) -> list[str]:
    return [
        f"{soft.speed:.1f} rad/s", f"{soft.peak_N:.2f} N", f"{stiff.peak_N:.2f} N", f"{soft.peak_N / stiff.peak_N:.2f}",
        f"{soft.impulse_Ns:.3f} N·s", f"{stiff.impulse_Ns:.3f} N·s", f"{soft.impulse_Ns / stiff.impulse_Ns:.2f}",
    ]  # fmt: skip


def _reaction(plain: Hit, hit: Hit) -> list[str]:
    times = [
        f"{1e3 * time_s:.0f} ms" if np.isfinite(time_s) else "not detected"
        for time_s in (hit.detection_s, hit.reaction_s, hit.to_peak_s)
    ]
    return [
        f"{plain.S_ref:g} N·m/rad, {plain.speed:.1f} rad/s", *times, f"{hit.peak_N:.2f} N",
        f"{hit.peak_N / plain.peak_N:.2f}", f"{hit.impulse_Ns:.3f} N·s", f"{hit.impulse_Ns / plain.impulse_Ns:.2f}",
    ]  # fmt: skip


def _spared(pair: tuple[Hit, Hit]) -> tuple[float, float]:
    plain, hit = pair
    return 100.0 * (1.0 - hit.peak_N / plain.peak_N), 100.0 * (1.0 - hit.impulse_Ns / plain.impulse_Ns)
