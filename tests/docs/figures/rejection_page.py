"""The table of docs/explanation/tuning.md on pushes: the forecast, and the behaviour of a simulated loop."""

from collections.abc import Iterator
from functools import partial

import numpy as np

from backend.banks.builder import build_tuning_command
from backend.experiments.plans import LoopSettings
from backend.realtime.commands import ApplyPush
from backend.realtime.gains import build_cascade_tuning
from backend.tuning.gains import collect_plant_knowledge
from backend.tuning.simulation import APPARENT_STIFFNESS_HZ, NEAR_RAD, PUSH_N, PushForecast, forecast_push
from plant.interface import T_s
from plant.parameters import load_parameters
from tests.docs.figures.places import Computation, Found, Prose, Table
from tests.docs.figures.runs import TIME_OPTIMAL, U_PLAN_V, Bench
from tests.tuning.test_simulation import M_s, opened

PAGE = "docs/explanation/tuning.md"
S_REF = 10.0
LAMBDAS_S = (0.355, 0.5, 1.0, 2.0)
SHARES = (0.0, 0.7, 1.0)
PLANTS = ("ideal", "lab")
LONGEST_PART_S, OVERLAP_S = 9.0, 0.1

PUSHED = Table(
    PAGE,
    "held push",
    (
        "λ_q [s]",
        "k_ext",
        "recovery on `ideal` [s]",
        "recovery on `lab` [s]",
        "deviation after 1 s [mrad] (`ideal`, `lab`)",
        "apparent stiffness at 0.1 Hz [N·m/rad]",
        "apparent stiffness at 1 Hz [N·m/rad]",
    ),
    key=2,
)
GIVES = Prose(
    PAGE,
    "give under a push",
    "the deflection is {give:.1f} mrad in each row ({per_N:.1f} mrad per N; {lab:.1f} on `lab`)",
)
LEANING = Prose(
    PAGE,
    "margins of a joint that leans on something",
    "M_s is {without:.1f} without it, {some:.1f} at k_ext = 0.7 and {all_of_it:.1f} at k_ext = 1",
)


def computations() -> Iterator[Computation]:
    """Return the computations of the page, one per row."""
    for lam_q in LAMBDAS_S:
        for k_ext in SHARES:
            yield Computation(f"held push, lam_q {lam_q:g} s, k_ext {k_ext:g}", (PUSHED,), partial(row, lam_q, k_ext))
    yield Computation("give under a push", (GIVES,), give)
    yield Computation("margins under a rejection", (LEANING,), margins)


def give() -> Found:
    """Return the initial compliance of the joint: the forecast, and the measurement on `lab`."""
    settings = LoopSettings(lam_q=1.0, lam_S=0.345, motion=TIME_OPTIMAL, u_plan=U_PLAN_V)
    bench = Bench(load_parameters("lab"), settings)
    try:
        bench.hold(0.0, S_REF, 8.0)
        bench.send(ApplyPush(PUSH_N, 1.0))
        bench.advance(1.0)
        lab = float(np.abs(bench.seconds("q", 1.0)).max())
    finally:
        bench.close()
    expected = forecast_of("ideal", settings).deflection
    return {GIVES: {"give": 1e3 * expected, "per_N": 1e3 * expected / PUSH_N, "lab": 1e3 * lab}}


def margins() -> Found:
    """Return M_s of a joint in contact with 100 N·m/rad at λ_q = 2 s and S = 8 N·m/rad."""
    return {
        LEANING: {
            name: M_s(*opened(2.0, 8.0, k_ext, 100.0))
            for name, k_ext in (("without", 0.0), ("some", 0.7), ("all_of_it", 1.0))
        }
    }


def forecast_of(plant: str, settings: LoopSettings) -> PushForecast:
    """Return the forecast of the tuning card for a held push."""
    parameters = load_parameters(plant)
    gains = build_cascade_tuning(build_tuning_command(parameters, settings, None), collect_plant_knowledge(parameters))
    return forecast_push(parameters, gains, S_REF, settings.lam_q)


def row(lam_q: float, k_ext: float) -> Found:
    """Return the forecast and the measurements on each plant."""
    settings = LoopSettings(lam_q=lam_q, lam_S=0.345, motion=TIME_OPTIMAL, u_plan=U_PLAN_V, k_ext=k_ext)
    forecasts = [forecast_of(plant, settings) for plant in PLANTS]
    back, off, slow, fast = zip(*(measured(plant, settings) for plant in PLANTS), strict=True)
    times = [_beside(forecast.recovery_s, (one,), ".1f") for forecast, one in zip(forecasts, back, strict=True)]
    return {
        PUSHED: [
            [
                f"{lam_q:g}", f"{k_ext:g}", *times, " / ".join(f"{1e3 * one:.1f}" for one in off),
                _beside(forecasts[0].apparent_stiffness_slow, slow, ".1f"),
                _beside(forecasts[0].apparent_stiffness_fast, fast, ".1f"),
            ]
        ]
    }  # fmt: skip


def _beside(expected: float, measured: tuple[float, ...], spec: str) -> str:
    return " / ".join(format(one, spec) for one in (expected, *measured))


def measured(plant: str, settings: LoopSettings) -> tuple[float, float, float, float]:
    """Return recovery time [s], deviation after 1 s [rad], and apparent stiffness [N·m/rad].

    The apparent stiffness is torque over deviation of q under a sine of the same force, at FELT_HZ.
    """
    bench = Bench(load_parameters(plant), settings)
    try:
        bench.hold(0.0, S_REF, 8.0)
        bench.learn(S_REF)
        bench.advance(2.0)
        held_s = 2.0 + 8.0 * settings.lam_q
        for part_s in list_tuning_parts(held_s):
            bench.send(ApplyPush(PUSH_N, part_s + OVERLAP_S))  # the next command replaces this one before it ends
            bench.advance(part_s)
        off = np.abs(bench.seconds("q", held_s) - bench.seconds("q_ref", held_s))
        away = np.flatnonzero(off > NEAR_RAD + 1e-9)
        back_s = float(away[-1] + 1) * T_s if away.size and away[-1] + 1 < off.size else np.nan
        bench.advance(OVERLAP_S + 6.0 + 6.0 * settings.lam_q)
        return (
            back_s,
            float(off[round(1.0 / T_s)]),
            felt(bench, APPARENT_STIFFNESS_HZ[0]),
            felt(bench, APPARENT_STIFFNESS_HZ[1]),
        )
    finally:
        bench.close()


def list_tuning_parts(seconds: float) -> list[float]:
    """Return the times of the commands that hold a push for this duration; one command lasts at most 10 s."""
    count = int(np.ceil(seconds / LONGEST_PART_S))
    return [seconds / count] * count


def felt(bench: Bench, f: float) -> float:
    """Return torque over deviation [N·m/rad] of the last period of a sine of PUSH_N at ``f`` [Hz]."""
    pieces, periods = 100, 4
    piece_s = 1.0 / f / pieces
    for k in range(periods * pieces):
        bench.send(ApplyPush(PUSH_N * np.sin(2.0 * np.pi * (k + 0.5) / pieces), 2.0 * piece_s))
        bench.advance(piece_s)
    q, force = bench.seconds("q", 1.0 / f), bench.seconds("F_push", 1.0 / f)
    turn = np.exp(-2j * np.pi * np.arange(q.size) / q.size)
    return float(abs(bench.parameters.geometry.r_j * (force @ turn) / (q @ turn)))
