"""Impacts: metrics of hits, compared with an independent integration and between stiffnesses."""

from dataclasses import dataclass, replace
from functools import cache, partial

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.integrate import solve_ivp
from scipy.signal import lfilter

from backend.analysis.disturbance_metrics import Hit, compute_impact_metrics, find_hits, pair_hits
from backend.analysis.step_metrics import NoSamplesError
from backend.control.disturbance_observer import POLE
from backend.experiments.library import build_ready_plan
from backend.realtime.commands import Accepted, RunProgram
from backend.realtime.gains import make_tuning_command
from backend.realtime.modes import Mode
from backend.realtime.program import ContactDetection, Law, Program, Segment
from backend.sample import NAMES
from backend.tuning.gains import TuningParameters
from plant.interface import T_s
from plant.parameters import load_parameters
from plant.quantity import Quantity
from plant.simulator import Simulator
from tests.plant.test_dynamics import own_rate
from tests.realtime.bench_top import BenchTop

LAB = load_parameters("lab")
PROGRAM = build_ready_plan("impact").program()
SPEEDS = (0.2, 0.4, 0.6)
AHEAD = 30
"""Samples before the touch from which the test integrates on its own."""

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Driven:
    """A run: its columns, and the plant's true state at each sample (n, 10)."""

    columns: dict[str, Array]
    states: Array


@cache
def impacts(name: str = "lab") -> Driven:
    """The experiment as it is ready-made, with the plan's budget from the start."""
    parameters = load_parameters(name)
    plant = Simulator(parameters)
    bench = BenchTop(parameters, make_tuning_command(parameters, TuningParameters(), u_plan=8.5), plant)
    bench.wind_up()
    laid = PROGRAM
    segments = tuple(replace(segment, tuning=0) for segment in laid.segments)
    assert isinstance(bench.send(RunProgram(replace(laid, segments=segments))), Accepted)
    begun, states = len(bench.samples.rows), []
    for _ in range(round(laid.duration_s / T_s)):
        states.append(plant.x)
        bench.advance(T_s)
        assert bench.loop.mode is Mode.EXPERIMENT
    rows = np.array(bench.samples.rows[begun:])
    return Driven({name: rows[:, place] for place, name in enumerate(NAMES)}, np.array(states))


def own_hit(driven: Driven, hit: Hit) -> tuple[float, float]:
    """Largest force [N] and impulse [N·s] of a hit by the test's own integration under the voltages that were put out.

    The wall is written anew from its three numbers; ten points in each millisecond.
    """
    wall = next(wall for wall in PROGRAM.walls if wall is not None)
    r_j, step_V = LAB.geometry.r_j, 2.0 * LAB.motor.u_max / 2**16

    def depth(x: Array) -> float:
        return float(r_j * (x[0] - wall.q_wall))

    def pressed(x: Array) -> float:
        return max(wall.k_wall * depth(x) * (1.0 + wall.c_wall * r_j * float(x[1])), 0.0) if depth(x) > 0.0 else 0.0

    def rate(u_A: float, u_B: float, t: float, x: Array) -> list[float]:
        return own_rate(LAB, u_A, u_B, -r_j * pressed(x), t, x)

    def contact_detection(_t: float, x: Array) -> float:
        return depth(x)

    first = hit.window.start - AHEAD
    x, peak, impulse = driven.states[first].copy(), 0.0, 0.0
    for tick in range(first, hit.window.stop + AHEAD):
        u_A, u_B = (round(driven.columns[u][tick] / step_V) * step_V for u in ("u_A", "u_B"))
        points = np.linspace(0.0, T_s, 11)
        solved = solve_ivp(
            partial(rate, u_A, u_B),
            (0.0, T_s),
            x,
            "RK45",
            points,
            events=contact_detection,
            rtol=1e-8,
            atol=1e-11,
            max_step=2e-4,
        )
        forces = np.array([pressed(at) for at in solved.y.T])
        peak, impulse = max(peak, float(forces.max())), impulse + float(np.trapezoid(forces, points))
        x = solved.y[:, -1]
    return peak, impulse


@pytest.mark.parametrize("number", range(12))
def test_peak_and_impulse_agree_with_an_independent_integration_within_3_percent(number: int) -> None:
    driven = impacts()
    hits = find_hits(driven.columns, PROGRAM)
    assert [hit.S_ref for hit in hits] == pytest.approx([8.0] * 3 + [15.0] * 6 + [8.0] * 3)
    assert [hit.speed for hit in hits] == pytest.approx(4 * SPEEDS, rel=0.04)
    assert [hit.reacts for hit in hits] == [False] * 6 + [True] * 6
    peak, impulse = own_hit(driven, hits[number])
    assert hits[number].peak_N == pytest.approx(peak, rel=0.03)
    assert hits[number].impulse_Ns == pytest.approx(impulse, rel=0.03)


@pytest.mark.parametrize("name", ["ideal", "lab", "lab-stick"])
def test_a_soft_joint_hits_softer_than_a_stiff_one_at_each_speed(name: str) -> None:
    hits = find_hits(impacts(name).columns)
    for soft, stiff in zip(hits[:3], hits[3:6], strict=True):
        assert soft.peak_N < 0.7 * stiff.peak_N
        assert soft.impulse_Ns < 0.7 * stiff.impulse_Ns
    for alike in (hits[:3], hits[3:6]):
        assert [hit.peak_N for hit in alike] == sorted(hit.peak_N for hit in alike)
    figures = compute_impact_metrics(impacts(name).columns, PROGRAM)
    assert figures.hits == 12.0
    assert figures.soft_to_stiff_peak == pytest.approx(
        np.mean([soft.peak_N / stiff.peak_N for soft, stiff in zip(hits[:3], hits[3:6], strict=True)])
    )


@pytest.mark.parametrize("name", ["ideal", "lab", "lab-stick"])
def test_the_contact_reaction_reduces_each_impulse_by_a_third_and_each_peak(name: str) -> None:
    hits = find_hits(impacts(name).columns, PROGRAM)
    pairs, why = pair_hits(hits)
    assert (len(pairs), why) == (6, "")
    for plain, reacted in pairs:
        assert plain.S_ref == reacted.S_ref
        assert reacted.speed == pytest.approx(plain.speed, rel=0.04)
        assert reacted.impulse_Ns < 0.6 * plain.impulse_Ns
        assert reacted.peak_N < plain.peak_N
    figures = compute_impact_metrics(impacts(name).columns, PROGRAM)
    assert figures.reaction_impulse == pytest.approx(np.mean([b.impulse_Ns / a.impulse_Ns for a, b in pairs]))
    assert figures.reaction_peak == pytest.approx(np.mean([b.peak_N / a.peak_N for a, b in pairs]))
    assert figures.felt_after_s == max(hit.detection_s for hit in hits[6:])
    assert figures.reasons == {}


def test_a_hit_is_detected_as_the_observers_poles_predict_and_the_reaction_follows_at_once() -> None:
    driven = impacts("ideal")  # without encoder counts, noise and bias
    kept, seen = np.exp(-POLE * T_s), np.abs(driven.columns["F_wall"])
    for _ in range(3):  # p/(s + p) thrice
        seen = lfilter([1.0 - kept], [1.0, -kept], seen)
    for hit in find_hits(driven.columns, PROGRAM)[6:]:
        expected = T_s * int(np.argmax(seen[hit.window] > hit.contact_N))
        assert hit.detection_s == pytest.approx(expected, abs=0.002)
        assert hit.reaction_s == 0.0
        largest = hit.window.start + round((hit.detection_s + hit.to_peak_s) / T_s)
        assert abs(driven.columns["F_wall"][largest]) == hit.peak_N


def test_hits_that_were_not_felt_are_no_reaction_that_was_measured() -> None:
    program = Program(
        Law.CASCADE, (Segment(2.0, 0.0, 8.0, contact_detection=1),), contact_detections=(ContactDetection(1.5),)
    )
    seen = columns((8.0, 0.3, 4.0), (8.0, 0.3, 5.0))
    seen |= {"F_ext_hat": np.where(seen["t"] > 1.5, seen["F_wall"], 0.0), "limits": np.zeros_like(seen["t"])}
    one, other = find_hits(seen, program)
    assert one.reacts
    assert np.isnan([one.detection_s, one.reaction_s, one.to_peak_s, other.reaction_s, other.to_peak_s]).all()
    assert other.detection_s == pytest.approx(0.1 * np.arcsin(0.3) / np.pi, abs=0.001)
    figures = compute_impact_metrics(seen, program)
    assert figures.felt_after_s is figures.gave_way_after_s is figures.reaction_peak is None
    assert figures.reasons["felt_after_s"] == "2 of 2 hits were not felt or not given way to"


def test_hits_with_reaction_and_none_like_them_without_are_compared_with_nothing() -> None:
    segments = (Segment(1.0, 0.0, 8.0), Segment(1.0, 0.0, 12.0, contact_detection=1))
    program = Program(Law.CASCADE, segments, contact_detections=(ContactDetection(1.5),))
    seen = columns((8.0, 0.3, 4.0), (12.0, 0.3, 5.0))
    felt = np.where(np.abs(seen["F_wall"]) > 1.5, 64.0, 0.0)
    figures = compute_impact_metrics(seen | {"F_ext_hat": seen["F_wall"], "limits": felt}, program)
    assert figures.gave_way_after_s == 0.0
    assert figures.reaction_impulse is None
    assert (
        f"beside the hit at 12 N·m/rad and {Quantity(0.3, 'rad/s')} there is none"
        in figures.reasons["reaction_impulse"]
    )
    assert figures.reasons["soft_to_stiff_peak"] == "all hits were at 8 N·m/rad"


def columns(*hits: tuple[float, float, float], ticks: int = 1000) -> dict[str, Array]:
    """A second for each hit of S_ref [N·m/rad], speed [rad/s] and peak [N]: a half-sine of 100 ms, half of it again
    50 ms later."""
    n = ticks * len(hits)
    t = T_s * np.arange(n, dtype=np.float64)
    F_wall, q, S_ref = np.zeros(n), np.zeros(n), np.zeros(n)
    bump = np.sin(np.pi * (np.arange(100) + 0.5) / 100.0)
    for place, (S, speed, peak) in enumerate(hits):
        begin = place * ticks
        S_ref[begin : begin + ticks] = S
        q[begin : begin + ticks] = speed * np.minimum(t[:ticks] - 0.5, 0.0)
        F_wall[begin + 500 : begin + 600] = -peak * bump
        F_wall[begin + 650 : begin + 750] = -0.5 * peak * bump
    ones = np.ones(n)
    return {
        "t": t,
        "F_wall": F_wall,
        "q": q,
        "S_ref": S_ref,
        "F_A": 20 * ones,
        "F_B": 15 * ones,
        "u_A": ones,
        "u_B": -ones,
    }


def test_a_hit_has_its_peak_its_impulse_with_all_bounces_and_its_speed() -> None:
    soft, stiff = find_hits(columns((8.0, 0.3, 4.0), (12.0, 0.3, 5.0)))
    assert (soft.window, stiff.window) == (slice(500, 750), slice(1500, 1750))
    assert (soft.S_ref, stiff.S_ref, soft.contact_s) == (8.0, 12.0, 0.2)
    assert soft.peak_N == pytest.approx(4.0, rel=1e-3)
    assert soft.impulse_Ns == pytest.approx(1.5 * 4.0 * 0.1 * 2.0 / np.pi, rel=1e-3)
    assert soft.speed == pytest.approx(0.3)
    figures = compute_impact_metrics(columns((8.0, 0.3, 4.0), (12.0, 0.3, 5.0)))
    assert (figures.soft_to_stiff_peak, figures.soft_to_stiff_impulse) == pytest.approx((0.8, 0.8))
    assert (figures.hits, figures.min_tension_N) == (2.0, 15.0)
    assert figures.impulse_Ns == pytest.approx(stiff.impulse_Ns)


@pytest.mark.parametrize(
    ("hits", "reason"),
    [
        (((8.0, 0.3, 4.0), (8.0, 0.3, 5.0)), "all hits were at 8 N·m/rad"),
        (((8.0, 0.3, 4.0), (8.0, 0.4, 4.0), (15.0, 0.3, 5.0)), "2 hits were soft and 1 stiff"),
        (
            ((8.0, 0.3, 4.0), (15.0, 0.4, 5.0)),
            f"hits at {Quantity(0.3, 'rad/s')} and {Quantity(0.4, 'rad/s')} cannot be compared",
        ),
    ],
)
def test_hits_that_are_not_alike_are_not_compared_and_say_why(
    hits: tuple[tuple[float, float, float], ...], reason: str
) -> None:
    figures = compute_impact_metrics(columns(*hits))
    assert figures.soft_to_stiff_peak is None
    assert reason in figures.reasons["soft_to_stiff_peak"]
    assert figures.reasons["soft_to_stiff_impulse"] == figures.reasons["soft_to_stiff_peak"]


def test_a_touch_as_the_record_begins_has_no_speed_and_is_compared_with_nothing() -> None:
    early = {name: column[499:] for name, column in columns((8.0, 0.3, 4.0), (15.0, 0.3, 5.0)).items()}
    assert np.isnan(find_hits(early)[0].speed)
    assert compute_impact_metrics(early).soft_to_stiff_peak is None


@pytest.mark.parametrize("force", [0.0, np.nan, None])
def test_without_a_wall_without_a_hit_and_before_there_were_walls_there_is_nothing_to_measure(
    force: float | None,
) -> None:
    seen = columns((8.0, 0.3, 4.0))
    if force is None:
        del seen["F_wall"]
    else:
        seen["F_wall"] = np.full_like(seen["t"], force)
    assert find_hits(seen) == ()
    with pytest.raises(NoSamplesError, match="no wall was hit"):
        compute_impact_metrics(seen)
