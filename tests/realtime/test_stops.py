"""Stops and trips of the loop on the simulator: zero volts, latched, braked where there is time."""

import math

import numpy as np
import pytest

from backend.faults import FAULT_CODE, Fault
from backend.realtime.commands import Accepted, Refused, Reset, SetMode, SetReferences, Stop, Stopped
from backend.realtime.modes import MODE_CODE, Mode
from plant.interface import Measurement, MotorCommand, PlantError
from plant.parameters import PlantParameters, load_parameters
from plant.simulator import Simulator
from tests.docs.faults_page import documented_ms
from tests.realtime.bench_top import BenchTop


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
    stopped = bench.loop.mode
    assert stopped is Mode.TRIPPED
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
    bench.plant.push(-80.0)
    bench.advance(1.0)
    assert bench.loop.mode is Mode.TRIPPED
    assert bench.loop.fault in (Fault.FORCE_LIMIT, Fault.SAFETY_MODULE, Fault.SLACK)
    assert bench.column("u_A")[-1] == 0.0
    refused = bench.send(Reset())
    assert isinstance(refused, Refused)
    bench.plant.push(0.0)
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


def test_the_end_of_the_service_is_a_soft_stop_that_says_by_what(ideal: PlantParameters) -> None:
    bench = BenchTop(ideal)
    bench.run()
    bench.send(SetReferences(0.9, 11.0))
    bench.advance(0.3)
    arrived = len(bench.samples.rows)
    bench.send(Stop(Fault.SERVICE_ENDED, hard=False, detail="service ended by SIGTERM"))
    bench.advance(2.5)
    latched = int(np.argmax(bench.column("fault") == FAULT_CODE[Fault.SERVICE_ENDED]))
    assert 0 <= latched - arrived < documented_ms(Fault.SERVICE_ENDED)
    (stopped,) = [event for event in bench.events if isinstance(event, Stopped)]
    assert (stopped.fault, stopped.hard, stopped.detail) == (Fault.SERVICE_ENDED, False, "service ended by SIGTERM")
