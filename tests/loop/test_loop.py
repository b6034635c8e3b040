"""The loop on the simulator: pretension, moves between modes, bumpless tuning, stops and trips."""

import math

import numpy as np
import pytest
from scipy.signal import max_len_seq

from backend.faults import FAULT_CODE, Fault
from backend.loop.commands import (
    Accepted,
    ModeChanged,
    ProgramEnded,
    Push,
    Refused,
    Reset,
    RunProgram,
    SetMode,
    SetReferences,
    SetTuning,
    Stop,
    Stopped,
)
from backend.loop.mode import LEGAL, MODE_CODE, Mode
from backend.loop.program import Excitation, Law, Program, Segment, Shape
from backend.loop.tuned import tuning_for
from backend.sample import NAMES
from backend.tuning.models import Lambdas
from plant.interface import Measurement, MotorCommand, PlantError
from plant.parameters import PlantParameters, load_parameters
from plant.simulator import Simulator
from tests.loop.bench_top import BenchTop


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


def test_moves_that_are_not_legal_are_refused_with_the_legal_ones(ideal: PlantParameters) -> None:
    bench = BenchTop(ideal)
    for mode in Mode:
        if mode in LEGAL[Mode.OFF]:
            continue
        answer = bench.send(SetMode(mode))
        assert isinstance(answer, Refused)
        assert answer.legal == LEGAL[Mode.OFF]
        assert "pretension" in answer.reason
    assert bench.loop.mode is Mode.OFF


def test_run_waits_for_pretension(ideal: PlantParameters) -> None:
    bench = BenchTop(ideal)
    bench.send(SetMode(Mode.PRETENSION))
    bench.advance(0.5)
    answer = bench.send(SetMode(Mode.RUN))
    assert isinstance(answer, Refused)
    assert "10 N" in answer.reason


def test_entering_run_does_not_move_the_voltages(lab: PlantParameters) -> None:
    bench = BenchTop(lab)
    bench.run(run=7)
    bench.advance(0.2)
    u = bench.column("u_A", last=400)
    step, quiet = abs(u[200] - u[199]), np.max(np.abs(np.diff(u[:199])))
    assert step <= quiet + 1e-3
    assert set(bench.column("run", last=200)) == {7.0}


def test_references_out_of_bounds_change_nothing(ideal: PlantParameters) -> None:
    bench = BenchTop(ideal)
    bench.run()
    bench.advance(0.05)
    before = bench.column("q_ref")[-1], bench.column("S_ref")[-1]
    for q_ref, S_ref, words in ((2.0, 10.0, "q_ref = 2 rad"), (0.0, 16.0, "S_ref = 16 N"), (math.nan, 10.0, "q_ref")):
        answer = bench.send(SetReferences(q_ref, S_ref))
        assert isinstance(answer, Refused)
        assert words in answer.reason
    bench.advance(0.05)
    assert (bench.column("q_ref")[-1], bench.column("S_ref")[-1]) == before


def test_moving_lambda_at_rest_moves_no_voltage(ideal: PlantParameters) -> None:
    bench = BenchTop(ideal, tuning_for(ideal, Lambdas(lam_q=0.6)))
    bench.run()
    bench.send(SetReferences(0.5, 10.0))
    bench.advance(8.0)
    bench.send(tuning_for(ideal, Lambdas(lam_q=0.45)))
    bench.advance(0.001)
    for name in ("u_A", "u_B"):
        before, after = bench.column(name, last=2)
        assert abs(after - before) < 1e-3
    assert bench.column("lam_q", last=2).tolist() == [0.6, 0.45]


def test_gains_that_are_no_numbers_are_refused_whole(ideal: PlantParameters) -> None:
    bench = BenchTop(ideal)
    good = tuning_for(ideal, Lambdas(lam_q=0.6))
    broken = SetTuning(**{**vars(good), "motor_A": good.motor_A.__class__(math.nan, 1.0, 1.0, 1.0)})
    assert isinstance(bench.send(broken), Refused)
    assert isinstance(bench.send(SetTuning(**{**vars(good), "entries": ()})), Refused)
    bench.advance(0.001)
    assert bench.column("lam_q")[-1] == Lambdas().lam_q


def test_hard_stop_is_zero_volts_in_the_next_tick_and_latched(ideal: PlantParameters) -> None:
    bench = BenchTop(ideal)
    bench.run()
    bench.send(SetReferences(1.0, 12.0))
    bench.advance(0.4)
    assert bench.send(Stop()).tick == len(bench.samples.rows)
    bench.advance(0.01)
    assert bench.column("u_A", last=10).tolist() == [0.0] * 10
    assert bench.column("u_B", last=10).tolist() == [0.0] * 10
    proof = next(event for event in bench.events if isinstance(event, Stopped))
    assert proof.zero_tick - proof.arrived_tick <= 2
    assert bench.loop.mode is Mode.TRIPPED
    assert isinstance(bench.send(SetMode(Mode.PRETENSION)), Refused)
    assert isinstance(bench.send(Reset()), Accepted)
    assert bench.loop.mode is Mode.OFF


@pytest.mark.parametrize("mode", [Mode.OFF, Mode.PRETENSION, Mode.RUN, Mode.STOPPING, Mode.TRIPPED])
def test_hard_stop_works_from_every_mode(ideal: PlantParameters, mode: Mode) -> None:
    bench = BenchTop(ideal)
    if mode is not Mode.OFF:
        bench.run()
    if mode in (Mode.PRETENSION, Mode.STOPPING):
        bench.send(SetMode(mode))
    if mode is Mode.TRIPPED:
        bench.send(Stop())
    bench.advance(0.002)
    bench.events.clear()
    assert isinstance(bench.send(Stop()), Accepted)
    bench.advance(0.002)
    assert bench.loop.mode is Mode.TRIPPED
    assert any(isinstance(event, Stopped) for event in bench.events)
    assert bench.column("u_A")[-1] == bench.column("u_B")[-1] == 0.0


@pytest.mark.parametrize("name", ["ideal", "lab"])
@pytest.mark.parametrize("moving_s", [0.3, 0.6, 0.9])
def test_soft_stop_brakes_under_tension_before_it_lets_go(name: str, moving_s: float) -> None:
    bench = BenchTop(load_parameters(name))
    bench.run()
    bench.send(SetReferences(1.2, 12.0))
    bench.advance(moving_s)
    speed = abs(bench.column("q_dot")[-1])
    bench.send(Stop(Fault.SERVICE_LOST, hard=False))
    bench.advance(3.0)
    modes, q_dot = bench.column("mode", last=3000), bench.column("q_dot", last=3000)
    F = np.minimum(bench.column("F_A", last=3000), bench.column("F_B", last=3000))
    released = int(np.argmax(modes == MODE_CODE[Mode.TRIPPED]))
    assert released > 300
    assert F[:released].min() > 5.0
    # Encoder quantisation alone makes the estimate of a standing joint read up to one count in ten ticks.
    noise = 0.16 if name == "lab" else 0.0
    assert np.max(np.abs(q_dot[250:released])) < 0.05 * speed + noise
    assert bench.column("u_A")[-1] == bench.column("u_B")[-1] == 0.0
    assert bench.column("fault")[-1] == FAULT_CODE[Fault.SERVICE_LOST]


def test_push_beyond_the_force_bound_trips_and_stays_tripped(ideal: PlantParameters) -> None:
    bench = BenchTop(ideal)
    bench.run()
    bench.send(Push(-80.0))
    bench.advance(1.0)
    assert bench.loop.mode is Mode.TRIPPED
    assert bench.loop.fault in (Fault.FORCE_LIMIT, Fault.SAFETY_MODULE, Fault.SLACK)
    assert bench.column("u_A")[-1] == 0.0
    refused = bench.send(Reset())
    assert isinstance(refused, Refused)
    bench.send(Push(0.0))
    bench.advance(1.0)
    assert isinstance(bench.send(Reset()), Accepted)


def test_plant_error_ends_in_zero_volts(ideal: PlantParameters) -> None:
    class Breaking(Simulator):
        broken = False
        written: MotorCommand | None = None

        def read(self) -> Measurement:
            if self.broken:
                raise PlantError("encoder cable pulled: reconnect it")
            return super().read()

        def write(self, command: MotorCommand) -> None:
            self.written = command
            super().write(command)

    plant = Breaking(ideal)
    bench = BenchTop(ideal, plant=plant)
    bench.run()
    plant.broken = True
    bench.advance(0.001)
    assert plant.written == MotorCommand(0.0, 0.0)
    assert bench.loop.fault is Fault.PLANT_ERROR


def test_sensor_without_a_number_trips(ideal: PlantParameters) -> None:
    class Blind(Simulator):
        blind = False

        def read(self) -> Measurement:
            m = super().read()
            return m._replace(F_A=math.nan) if self.blind else m

    plant = Blind(ideal)
    bench = BenchTop(ideal, plant=plant)
    bench.run()
    plant.blind = True
    bench.advance(0.001)
    assert bench.loop.fault is Fault.SENSOR_INVALID
    assert bench.column("u_A")[-1] == 0.0


def test_force_hold_excites_one_motor_around_the_tension(ideal: PlantParameters) -> None:
    levels = "".join("+" if chip else "-" for chip in max_len_seq(5)[0])
    bench = BenchTop(ideal)
    bench.wind_up()
    excitation = Excitation(0.5, 0.08, levels, 2)
    bench.send(RunProgram(Program(Law.FORCE_HOLD, tension_N=30.0, settle_s=6.0, excitation=excitation), run=3))
    bench.advance(16.0)
    assert ProgramEnded in {type(event) for event in bench.events}
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
    ended = [event for event in bench.events if isinstance(event, ProgramEnded)]
    assert [event.completed for event in ended] == [True]


def test_program_with_a_reference_out_of_bounds_never_starts(ideal: PlantParameters) -> None:
    bench = BenchTop(ideal)
    bench.wind_up()
    answer = bench.send(RunProgram(Program(Law.CASCADE, (Segment(1.0, 0.0, 10.0), Segment(1.0, 2.0, 10.0)))))
    assert isinstance(answer, Refused)
    assert bench.loop.mode is Mode.PRETENSION


def test_samples_follow_the_table_and_count_every_tick(ideal: PlantParameters) -> None:
    bench = BenchTop(ideal)
    bench.run()
    bench.advance(0.1)
    assert {row.size for row in bench.samples.rows} == {len(NAMES)}
    assert bench.column("tick").tolist() == list(range(len(bench.samples.rows)))
    changes = [(event.before, event.after) for event in bench.events if isinstance(event, ModeChanged)]
    assert changes == [(Mode.OFF, Mode.PRETENSION), (Mode.PRETENSION, Mode.RUN)]


def test_same_seed_gives_the_same_samples_to_the_last_bit(lab: PlantParameters) -> None:
    def record() -> np.ndarray:
        bench = BenchTop(lab)
        bench.run()
        bench.send(SetReferences(0.3, 10.0))
        bench.advance(0.5)
        return np.array(bench.samples.rows)

    assert np.array_equal(record(), record(), equal_nan=True)
