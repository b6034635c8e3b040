"""Pushes that are rejected by feed-forward: how soon the joint is back, what it takes to be allowed, and no bump."""

from dataclasses import replace

import numpy as np
import pytest

from backend.realtime.commands import Accepted, ApplyPush, Refused, RunProgram, SetMode, SetReferences
from backend.realtime.gains import build_cascade_tuning, make_tuning_command
from backend.realtime.modes import Mode
from backend.realtime.program import ConfigureContactDetection, Law, Program, Segment, SetTuning
from backend.tuning.gains import UNSEEN_F, TuningParameters, collect_plant_knowledge
from backend.tuning.simulation import NEAR_RAD, PUSH_N, forecast_push
from plant.parameters import load_parameters
from tests.realtime.bench_top import BenchTop


def held(name: str, lam_q: float, S: float = 10.0) -> tuple[BenchTop, SetTuning]:
    """In run at 0 rad, at rest, nothing learned."""
    parameters = load_parameters(name)
    tuning = make_tuning_command(parameters, TuningParameters(lam_q, 0.345), u_plan=8.5)
    bench = BenchTop(parameters, tuning)
    bench.run()
    bench.send(SetReferences(0.0, S))
    bench.advance(4.0)
    return bench, tuning


def learned(name: str, lam_q: float, k_ext: float, S: float = 10.0) -> tuple[BenchTop, SetTuning]:
    """The same with the bias learned there, and pushes rejected."""
    bench, tuning = held(name, lam_q, S)
    assert isinstance(
        bench.send(ConfigureContactDetection(((S, float(np.mean(bench.column("F_ext_hat", last=500)))),))), Accepted
    )
    rejecting = replace(tuning, k_ext=k_ext)
    assert isinstance(bench.send(rejecting), Accepted)
    return bench, rejecting


def back_s(bench: BenchTop, F_push: float, seconds: float) -> float:
    begun = len(bench.samples.rows)
    assert isinstance(bench.send(ApplyPush(F_push, seconds)), Accepted)
    bench.advance(seconds)
    off = np.abs(bench.column("q")[begun:] - bench.column("q_ref")[begun:])
    return float(np.flatnonzero(off > 1.01 * NEAR_RAD)[-1] + 1) * 1e-3


@pytest.mark.parametrize("k_ext", [0.0, 0.7, 1.0])
def test_the_joint_is_back_when_the_forecast_says_so(k_ext: float) -> None:
    """Nonlinear springs, a simulator of its own method and the whole loop, against the linear model."""
    bench, tuning = learned("ideal", 1.0, k_ext)
    known = build_cascade_tuning(tuning, collect_plant_knowledge(load_parameters("ideal")))
    forecast = forecast_push(load_parameters("ideal"), known, 10.0, 1.0)
    assert back_s(bench, PUSH_N, 8.0) == pytest.approx(forecast.recovery_s, rel=0.06)
    assert np.max(np.abs(bench.column("q", last=8000))) == pytest.approx(forecast.deflection, rel=0.02)


@pytest.mark.parametrize("name", ["lab", "lab-stick"])
def test_with_friction_and_counts_too_the_position_loop_has_no_more_to_do_than_what_is_left_to_it(name: str) -> None:
    """That is 0.3 N that are not answered, and half a count of the encoder in what was learned at rest."""
    parameters = load_parameters(name)
    bench, _ = learned(name, 2.0, 1.0)
    left_N = UNSEEN_F + 10.0 * 0.5 * parameters.sensors.joint_step / parameters.geometry.r_j
    for F_push in (5.0, -5.0):
        assert back_s(bench, F_push, 6.0) < 4.5  # by the position loop alone 11; 4.23 with dead zones at rest
        off = bench.column("q", last=4500) - bench.column("q_ref", last=4500)
        assert np.max(np.abs(off)) < left_N * parameters.geometry.r_j / 10.0 + parameters.sensors.joint_step
        assert np.ptp(bench.column("u_A", last=2000)) < 0.3
        bench.advance(6.0)


def test_at_rest_nothing_is_moved_by_it() -> None:
    bench, _ = learned("lab", 1.0, 1.0)
    bench.advance(3.0)
    plain, _ = held("lab", 1.0)
    plain.advance(3.0)
    for name in ("q", "u_A", "u_B", "S"):
        np.testing.assert_array_equal(bench.column(name, last=3000), plain.column(name, last=3000))


def test_it_takes_what_was_learned() -> None:
    bench, tuning = held("lab", 1.0)
    refused = bench.send(replace(tuning, k_ext=0.7))
    assert isinstance(refused, Refused)
    assert "learn it first" in refused.reason
    program = Program(Law.CASCADE, (Segment(0.5, 0.0, 10.0, tuning=1),), tunings=(replace(tuning, k_ext=0.7),))
    assert isinstance(bench.send(RunProgram(program, 3)), Refused)
    assert isinstance(bench.send(ConfigureContactDetection(((10.0, 0.0),))), Accepted)
    assert isinstance(bench.send(replace(tuning, k_ext=1.2)), Refused)
    assert isinstance(bench.send(RunProgram(program, 3)), Accepted)
    bench.advance(1.0)  # over, and the operator's is back
    assert isinstance(bench.send(ConfigureContactDetection(())), Accepted)


def test_what_it_takes_is_not_forgotten_under_it() -> None:
    bench, tuning = learned("lab", 1.0, 0.7)
    refused = bench.send(ConfigureContactDetection(()))
    assert isinstance(refused, Refused)
    assert "k_ext to 0" in refused.reason
    assert isinstance(bench.send(tuning), Accepted)


def test_with_zeros_found_anew_pushes_are_the_position_loop_s_again() -> None:
    bench, tuning = learned("ideal", 1.0, 1.0)
    tunings = bench.loop._mode_manager.tunings
    assert tunings.gains.disturbance_feedforward.k_ext == 1.0
    bench.loop._mode_manager.contact.reset(0)
    assert tunings.gains.disturbance_feedforward.k_ext == 0.0
    assert back_s(bench, 5.0, 8.0) > 3.0  # with it 0.5 s
    assert isinstance(bench.send(tuning), Refused)


@pytest.mark.parametrize("u_plan", [0.0, 8.5])
def test_it_comes_and_goes_under_a_push_without_a_bump(u_plan: float) -> None:
    bench, tuning = learned("ideal", 1.0, 0.0)
    for after_s in (0.1, 0.4, 1.5):
        tuning = replace(tuning, u_plan=u_plan, k_ext=0.0)
        bench.send(tuning)
        bench.advance(6.0)
        bench.send(ApplyPush(6.0, after_s + 0.8))
        bench.advance(after_s)
        for k_ext in (1.0, 0.5, 0.0, 0.8):
            bench.send(replace(tuning, k_ext=k_ext))
            bench.advance(0.2)
            steps = np.abs(np.diff(bench.column("u_A", last=205)))
            assert steps[4] < max(1e-3, 1.5 * steps[3])  # the tick in which it changed, against the one before
            assert np.max(steps) < 0.05
    assert bench.loop.mode is Mode.RUN


def test_with_the_position_loop_open_it_does_nothing_and_closing_it_is_smooth() -> None:
    closed = {}
    for k_ext in (0.0, 1.0):
        bench, _ = learned("ideal", 1.0, k_ext)
        assert isinstance(bench.send(SetMode(Mode.COMPLIANCE, 2)), Accepted)
        bench.advance(1.0)
        bench.send(ApplyPush(5.0, 8.0))
        bench.advance(3.0)
        assert bench.column("q", last=1)[0] == pytest.approx(0.075 * 5.0 / 10.0, rel=0.02)
        assert isinstance(bench.send(SetMode(Mode.RUN, 3)), Accepted)
        bench.advance(1.0)
        closed[k_ext] = bench.column("u_A", last=1000), bench.column("q", last=1)[0] - 0.075 * 5.0 / 10.0
    (u, off), (u_rejected, off_rejected) = closed[0.0], closed[1.0]
    assert abs(u_rejected[0] - u[0]) < 1e-9
    assert np.max(np.abs(np.diff(u_rejected - u))) < 0.02
    # Run begins with the references where the joint is, so there is nothing to bring back (decision 0053).
    assert max(abs(off), abs(off_rejected)) < 1e-4


def test_it_gives_way_to_a_contact_as_ever() -> None:
    ways = []
    for k_ext in (0.0, 1.0):
        bench, _ = learned("lab", 1.0, k_ext)
        bias = bench.loop._mode_manager.contact._step._bias.get()
        bench.send(ConfigureContactDetection(tuple((float(S), float(F)) for S, F in bias), 2.0))
        bench.send(ApplyPush(6.0, 2.0))
        bench.advance(2.0)
        assert bench.loop.mode is Mode.COMPLIANCE
        ways.append(bench.column("q", last=2000))
    np.testing.assert_allclose(ways[1], ways[0], atol=0.01)


@pytest.mark.parametrize("name", ["ideal", "lab"])
def test_random_pushes_neither_trip_nor_slacken(name: str) -> None:
    bench, _ = learned(name, 1.0, 1.0)
    random = np.random.default_rng(16)
    for _ in range(30):
        if random.random() < 0.4:
            lambdas = TuningParameters(random.uniform(0.36, 2.0), random.uniform(0.35, 0.8))
            k_ext, u_plan = random.uniform(0.0, 1.0), 8.5 if random.random() < 0.7 else 0.0
            parameters = load_parameters(name)
            assert isinstance(
                bench.send(replace(make_tuning_command(parameters, lambdas, u_plan=u_plan), k_ext=k_ext)), Accepted
            )
        if random.random() < 0.3:
            bench.send(SetReferences(random.uniform(-1.0, 1.0), random.uniform(9.0, 12.0)))
        bench.send(ApplyPush(random.uniform(-10.0, 10.0), random.uniform(0.05, 2.0)))
        bench.advance(random.uniform(0.1, 1.5))
        assert bench.loop.mode is Mode.RUN
    for F in (bench.column("F_A"), bench.column("F_B")):
        assert F[10_000:].min() > 1.0
        assert F[10_000:].max() < 50.0
