"""The baselines in the live loop: they play a program, keep the joint held at both ends, and say what they refuse."""

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from backend.faults import Fault
from backend.realtime.commands import Accepted, Refused, RunProgram
from backend.realtime.gains import make_tuning_command
from backend.realtime.modes import Mode
from backend.realtime.motions import BASELINES
from backend.realtime.program import Law, Program, Segment
from backend.tuning.gains import TuningParameters, make_feedback_linearization_tuning, make_single_loop_tuning
from backend.tuning.simulation import Trajectory
from plant.parameters import PlantParameters, load_parameters
from tests.closed_loop.baseline_loops import run_feedback_linearization, run_single_loop
from tests.realtime.bench_top import BenchTop

IDEAL = load_parameters("ideal")
SEGMENTS = (Segment(4.0, 0.0, 10.0), Segment(4.0, 0.6, 10.0), Segment(4.0, 0.6, 12.0))
OFFLINE: dict[Law, tuple[Callable[..., Trajectory], Callable[[PlantParameters, TuningParameters], Any]]] = {
    Law.SINGLE_LOOP: (run_single_loop, make_single_loop_tuning),
    Law.FEEDBACK_LINEARIZATION: (run_feedback_linearization, make_feedback_linearization_tuning),
}


def played(law: Law) -> BenchTop:
    bench = BenchTop(IDEAL)
    bench.wind_up()
    assert isinstance(bench.send(RunProgram(Program(law, SEGMENTS), run=7)), Accepted)
    bench.advance(12.0)
    return bench


@pytest.mark.parametrize("law", list(BASELINES))
def test_program_moves_the_joint_as_the_offline_loop_does(law: Law) -> None:
    bench = played(law)
    q, S = bench.column("q", last=8000), bench.column("S", last=8000)
    run, tuning_of = OFFLINE[law]
    q_ref = np.repeat([0.0, 0.6, 0.6], 4000)
    S_ref = np.repeat([10.0, 10.0, 12.0], 4000)
    offline = run(IDEAL, tuning_of(IDEAL, TuningParameters()), q_ref, S_ref)
    assert q == pytest.approx(offline.q[4000:], abs=2e-3)
    assert pytest.approx(offline.S[4000:], abs=2e-2) == S


@pytest.mark.parametrize("law", list(BASELINES))
def test_pretension_takes_over_without_a_jump(law: Law) -> None:
    bench = played(law)
    bench.advance(1.0)
    assert (bench.loop.mode, bench.loop.fault) == (Mode.PRETENSION, Fault.NONE)
    u_A, u_B = bench.column("u_A", last=1100), bench.column("u_B", last=1100)
    assert max(np.abs(np.diff(u_A[:150])).max(), np.abs(np.diff(u_B[:150])).max()) < 0.05
    assert min(bench.column("F_A", last=1000).min(), bench.column("F_B", last=1000).min()) > 8.0


def test_gains_are_fixed_while_a_baseline_plays() -> None:
    bench = BenchTop(IDEAL)
    bench.wind_up()
    bench.send(RunProgram(Program(Law.SINGLE_LOOP, SEGMENTS)))
    bench.advance(0.1)
    answer = bench.send(make_tuning_command(IDEAL, TuningParameters(lam_q=0.8)))
    assert isinstance(answer, Refused)
    assert "fixed while its program plays" in answer.reason
    assert bench.column("lam_q", last=1)[0] == TuningParameters().lam_q


def test_a_lambda_without_gains_is_refused_before_anything_moves() -> None:
    bench = BenchTop(IDEAL, make_tuning_command(IDEAL, TuningParameters(lam_q=2.5)))
    bench.wind_up()
    answer = bench.send(RunProgram(Program(Law.SINGLE_LOOP, SEGMENTS)))
    assert isinstance(answer, Refused)
    assert "λ_q below 8 T_m" in answer.reason
    assert bench.loop.mode is Mode.PRETENSION


def test_motor_references_are_not_invented() -> None:
    bench = played(Law.SINGLE_LOOP)
    assert all(math.isnan(value) for value in bench.column("theta_A_ref", last=100))
