"""The loop on the simulator: its start, moves, tunings, programs and a plant that fails."""

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import max_len_seq

from backend.realtime.commands import (
    Event,
    ModeChanged,
    PlantAnswers,
    PlantFailing,
    Refused,
    RunEnded,
    RunProgram,
    SetMode,
    SetReferences,
)
from backend.realtime.control_loop import Loop, PlantHealthMonitor
from backend.realtime.gains import make_tuning_command
from backend.realtime.modes import LEGAL, MODE_CODE, Mode
from backend.realtime.program import EntryGains, Excitation, Law, Program, Segment, SetTuning, Shape
from backend.sample import NAMES
from backend.tuning.gains import TuningParameters
from plant.interface import InjectedFault, InjectedFaultKind, Measurement, PlantError
from plant.parameters import PlantParameters, load_parameters
from plant.quantity import Angle
from plant.safety_card import Card
from plant.simulator import Simulator
from plant.virtual_daq import VirtualRig
from plant.wiring import load_wiring
from tests.realtime.bench_top import BenchTop, Samples
from tests.reasons import assert_reason

# The loop on the simulator: pretension, moves between modes, bumpless tuning, programs.


@pytest.fixture(scope="module")
def lab() -> PlantParameters:
    return load_parameters("lab")


@pytest.mark.parametrize("name", ["ideal", "lab"])
def test_pretension_winds_both_tendons_to_ten_newton(name: str) -> None:
    bench = BenchTop(load_parameters(name))
    bench.wind_up()
    F = np.array([bench.column("F_A", last=500), bench.column("F_B", last=500)])
    assert np.mean(F, axis=1) == pytest.approx([10.0, 10.0], abs=0.3)
    assert F.max() < 12.0
    assert bench.column("S")[-1] == pytest.approx(8.24, abs=0.02)


def test_pretension_finds_the_zero_of_incremental_encoders(ideal: PlantParameters) -> None:
    class Offset(Simulator):
        def read(self) -> Measurement:
            m = super().read()
            return m._replace(theta_A=m.theta_A + 1.7, theta_B=m.theta_B - 0.9)

    bench = BenchTop(ideal, plant=Offset(ideal))
    bench.wind_up()
    assert bench.column("S")[-1] == pytest.approx(bench.column("S_true")[-1], abs=0.01)
    assert np.max(np.abs(np.diff(bench.column("u_A")))) < 0.2


def test_invalid_mode_changes_are_rejected_with_the_valid_ones(ideal: PlantParameters) -> None:
    bench = BenchTop(ideal)
    for mode in Mode:
        if mode in LEGAL[Mode.OFF]:
            continue
        answer = bench.send(SetMode(mode))
        assert isinstance(answer, Refused)
        assert answer.legal == LEGAL[Mode.OFF]
        assert_reason(answer.reason, "mode_change_not_legal", current=Mode.OFF, wanted=mode, legal=(Mode.PRETENSION,))
    assert bench.loop.mode is Mode.OFF


def test_run_waits_for_pretension(ideal: PlantParameters) -> None:
    bench = BenchTop(ideal)
    bench.send(SetMode(Mode.PRETENSION))
    bench.advance(0.5)
    answer = bench.send(SetMode(Mode.RUN))
    assert isinstance(answer, Refused)
    assert_reason(answer.reason, "mode_requires_taut_tendons", mode=Mode.RUN, tension_N=10.0)


def test_entering_run_does_not_change_the_voltages(lab: PlantParameters) -> None:
    bench = BenchTop(lab)
    bench.run(run=7)
    bench.advance(0.2)
    u = bench.column("u_A", last=400)
    step, quiet = abs(u[200] - u[199]), np.max(np.abs(np.diff(u[:199])))
    assert step <= quiet + 1e-3
    assert set(bench.column("run", last=200)) == {7.0}


def test_references_beyond_their_bounds_change_nothing(ideal: PlantParameters) -> None:
    bench = BenchTop(ideal)
    bench.run()
    bench.advance(0.05)
    before = bench.column("q_ref")[-1], bench.column("S_ref")[-1]
    for q_ref, S_ref, words in (
        (2.0, 10.0, f"position reference: {Angle(2.0)}"),
        (0.0, 16.0, "stiffness reference: 16 N"),
        (math.nan, 10.0, "position reference"),
    ):
        answer = bench.send(SetReferences(q_ref, S_ref))
        assert isinstance(answer, Refused)
        assert words in answer.reason
    bench.advance(0.05)
    assert (bench.column("q_ref")[-1], bench.column("S_ref")[-1]) == before


def test_a_change_of_lambda_at_rest_does_not_change_the_voltages(ideal: PlantParameters) -> None:
    bench = BenchTop(ideal, make_tuning_command(ideal, TuningParameters(lam_q=0.6)))
    bench.run()
    bench.send(SetReferences(0.5, 10.0))
    bench.advance(8.0)
    bench.send(make_tuning_command(ideal, TuningParameters(lam_q=0.45)))
    bench.advance(0.001)
    for name in ("u_A", "u_B"):
        before, after = bench.column(name, last=2)
        assert abs(after - before) < 1e-3
    assert bench.column("lam_q", last=2).tolist() == [0.6, 0.45]


def test_a_tuning_with_nan_gains_is_rejected_as_a_whole(ideal: PlantParameters) -> None:
    bench = BenchTop(ideal)
    good = make_tuning_command(ideal, TuningParameters(lam_q=0.6))
    broken = SetTuning(**{**vars(good), "motor_A": good.motor_A.__class__(math.nan, 1.0, 1.0, 1.0)})
    assert isinstance(bench.send(broken), Refused)
    assert isinstance(bench.send(SetTuning(**{**vars(good), "entries": ()})), Refused)
    bench.advance(0.001)
    assert bench.column("lam_q")[-1] == TuningParameters().lam_q


def test_gains_may_be_integers(ideal: PlantParameters) -> None:
    voltages = []
    for number in (float, int):
        bench = BenchTop(ideal)
        bench.run()
        bank = (EntryGains(*map(number, (8, 0, 1, 0, 0, 1, 0))),)
        bench.send(SetTuning(**{**vars(make_tuning_command(ideal, TuningParameters())), "entries": bank}))
        bench.send(SetReferences(0.2, 10.0))
        bench.advance(0.5)
        voltages.append(bench.column("u_A", last=500))
    assert voltages[0].tolist() == voltages[1].tolist()
    assert np.ptp(voltages[0]) > 0.01


def test_force_hold_excites_one_motor_around_the_tension(ideal: PlantParameters) -> None:
    levels = "".join("+" if chip else "-" for chip in max_len_seq(5)[0])
    bench = BenchTop(ideal)
    bench.wind_up()
    excitation = Excitation(0.5, 0.08, levels, 2)
    bench.send(RunProgram(Program(Law.FORCE_HOLD, tension_N=30.0, settle_s=6.0, excitation=excitation), run=3))
    bench.advance(16.0)
    assert RunEnded in {type(event) for event in bench.events}
    identify = bench.column("mode") == MODE_CODE[Mode.IDENTIFY]
    theta_A_ref = bench.column("theta_A_ref")[identify]
    excited = theta_A_ref[-round(excitation.duration_s * 1000) :]
    assert np.ptp(excited) == pytest.approx(1.0, abs=0.4)
    F = 0.5 * (bench.column("F_A") + bench.column("F_B"))[identify]
    assert np.mean(F[-4000:]) == pytest.approx(30.0, abs=1.5)
    assert np.ptp(bench.column("theta_B_ref")[identify][-4000:]) == 0.0
    assert set(bench.column("run")[identify]) == {3.0}
    assert bench.loop.mode is Mode.PRETENSION


def test_program_plays_steps_ramps_and_sines(ideal: PlantParameters) -> None:
    segments = (
        Segment(0.5, 0.2, 10.0),
        Segment(1.0, 0.4, 10.0, shape=Shape.RAMP),
        Segment(1.0, 0.5, 10.0, shape=Shape.SINE, period_s=0.5),
        Segment(0.5, 0.0, 12.0),
    )
    bench = BenchTop(ideal)
    bench.wind_up()
    bench.send(RunProgram(Program(Law.CASCADE, segments), run=4))
    bench.advance(3.1)
    q_ref = bench.column("q_ref")[bench.column("mode") == MODE_CODE[Mode.EXPERIMENT]]
    t = np.arange(1, 1001) * 1e-3
    assert q_ref[:500] == pytest.approx(0.2)
    assert q_ref[500:1500] == pytest.approx(0.2 + 0.2 * t)
    assert q_ref[1500:2500] == pytest.approx(0.4 + 0.1 * np.sin(4.0 * np.pi * t), abs=1e-12)
    assert q_ref[2500:2999] == pytest.approx(0.0)
    ended = [event for event in bench.events if isinstance(event, RunEnded)]
    assert [event.completed for event in ended] == [True]


def test_a_program_with_a_reference_beyond_its_bounds_never_starts(ideal: PlantParameters) -> None:
    bench = BenchTop(ideal)
    bench.wind_up()
    answer = bench.send(RunProgram(Program(Law.CASCADE, (Segment(1.0, 0.0, 10.0), Segment(1.0, 2.0, 10.0)))))
    assert isinstance(answer, Refused)
    assert bench.loop.mode is Mode.PRETENSION


def test_samples_follow_the_field_table_and_count_every_tick(ideal: PlantParameters) -> None:
    bench = BenchTop(ideal)
    bench.run()
    bench.advance(0.1)
    assert {row.size for row in bench.samples.rows} == {len(NAMES)}
    assert bench.column("tick").tolist() == list(range(len(bench.samples.rows)))
    changes = [(event.before, event.after) for event in bench.events if isinstance(event, ModeChanged)]
    assert changes == [(Mode.OFF, Mode.PRETENSION), (Mode.PRETENSION, Mode.RUN)]


def test_the_same_seed_gives_bit_identical_samples(lab: PlantParameters) -> None:
    def record() -> np.ndarray:
        bench = BenchTop(lab)
        bench.run()
        bench.send(SetReferences(0.3, 10.0))
        bench.advance(0.5)
        return np.array(bench.samples.rows)

    assert np.array_equal(record(), record(), equal_nan=True)


# A failing plant is reported once, and its recovery after one second without failures.


def watched(failing: set[int], ticks: int) -> list[Event]:
    watch, events = PlantHealthMonitor(), []
    for tick in range(ticks):
        watch.begin()
        if tick in failing:
            watch.failure = f"it broke in tick {tick}"
        events += watch.end(tick)
    return events


def test_a_failure_is_reported_and_its_end_after_a_thousand_good_ticks() -> None:
    assert watched({5}, 1005) == [PlantFailing(5, "it broke in tick 5")]
    assert watched({5}, 3000) == [PlantFailing(5, "it broke in tick 5"), PlantAnswers(1005)]


def test_intermittent_failures_are_reported_once() -> None:
    now_and_then = set(range(0, 10_000, 1000))
    assert watched(now_and_then, 10_999) == [PlantFailing(0, "it broke in tick 0"), PlantAnswers(10_000)]


def test_a_plant_without_failures_is_not_reported() -> None:
    assert watched(set(), 3000) == []


# A loop that cannot begin leaves nothing on: zero volts, drives off, and the card free for the next one.


def rig_and_card(parameters: PlantParameters) -> VirtualRig:
    return VirtualRig(load_wiring("pcie-6323"), Simulator(parameters, 0))


def test_a_rig_whose_first_reading_fails_keeps_its_drives_off(ideal: PlantParameters, tuning: SetTuning) -> None:
    rig = rig_and_card(ideal)
    rig.inject(InjectedFault(InjectedFaultKind.BUFFER_OVERRUN))
    with pytest.raises(PlantError, match="-200222"):
        Loop(rig, ideal, Samples(), tuning)
    assert not rig.card_state().drive_enabled
    rig.inject(None)
    loop = Loop(rig, ideal, Samples(), tuning)  # it was let go of
    assert rig.card_state().drive_enabled
    loop.close()
    loop.close()
    assert not rig.card_state().drive_enabled


def test_a_tuning_without_bank_entries_leaves_the_drives_off(ideal: PlantParameters, tuning: SetTuning) -> None:
    rig = rig_and_card(ideal)
    with pytest.raises(ValueError) as caught:  # noqa: PT011  # its message has a code
        Loop(rig, ideal, Samples(), replace(tuning, entries=()))
    assert_reason(caught.value.args[0], "no_bank_entries")
    assert not rig.card_state().drive_enabled


def test_a_plant_that_fails_during_opening_is_closed(ideal: PlantParameters, tuning: SetTuning) -> None:
    """A plant from a package may not close itself."""

    class HalfOpen(Simulator):
        def open(self) -> None:
            card.set_drives(on=True)
            raise PlantError("no second amplifier")

    card = Card.create()
    with pytest.raises(PlantError, match="no second amplifier"):
        Loop(HalfOpen(ideal, card=card), ideal, Samples(), tuning)
    assert not card.drives_on


def test_a_nan_in_the_first_angle_does_not_spoil_the_velocity(ideal: PlantParameters) -> None:
    class Late(Simulator):
        first = True

        def read(self) -> Measurement:
            m = super().read()
            m = m._replace(q=float("nan")) if self.first else m
            self.first = False
            return m

    bench = BenchTop(ideal, plant=Late(ideal))
    bench.advance(0.1)
    assert np.isfinite(bench.column("q_dot")).all()
