"""The rig on a virtual card: its readings, its outputs, and the causes that disable the drives."""

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from plant.daq import Daq
from plant.interface import (
    ZERO_VOLTS,
    InjectedFault,
    InjectedFaultKind,
    Measurement,
    MotorCommand,
    PlantError,
    RawReading,
    Sensor,
)
from plant.parameters import load_parameters
from plant.rig import Rig
from plant.safety_card import Card
from plant.simulator import Simulator
from plant.virtual_daq import VirtualCard, VirtualRig
from plant.wiring import Wiring, load_wiring
from tests.refusals import refused

PARAMETERS = load_parameters("lab")
WIRING = load_wiring("pcie-6323")
STEP_V = 20.0 / 2**16


def stepped(wiring: Wiring = WIRING) -> VirtualRig:
    rig = VirtualRig(wiring, Simulator(PARAMETERS, 0))
    rig.open()
    return rig


def commands(ticks: int) -> list[MotorCommand]:
    return [MotorCommand(2.0 * math.sin(k / 300.0), 1.0) for k in range(ticks)]


def played(rig: Rig, ticks: int) -> list[tuple[Measurement, RawReading]]:
    seen = []
    for command in commands(ticks):
        seen.append((rig.read(), rig.raw))
        rig.write(command)
    return seen


def test_a_rig_on_a_virtual_card_reads_the_values_of_the_simulator() -> None:
    rig, simulator = stepped(), Simulator(PARAMETERS, 0)
    simulator.open()
    for _ in range(2):  # zero volts are written when the card is opened, and when its drives come on
        simulator.write(ZERO_VOLTS)
    for (seen, _), command in zip(played(rig, 3000), commands(3000), strict=True):
        true = simulator.read()
        simulator.write(command)
        # A converter of 16 bits in between: half a code of volts, at 10 N/V.
        assert seen._replace(S_true=0.0) == pytest.approx(true._replace(S_true=0.0), abs=10.0 * STEP_V)
        assert math.isnan(seen.S_true)
    rig.close()


def test_readings_are_computed_from_volts_and_counts() -> None:
    rig = stepped()
    seen = played(rig, 2000)
    rig.close()
    angles = np.array([(m.q, m.theta_A, m.theta_B) for m, _ in seen])
    forces = np.array([(m.F_A, m.F_B) for m, _ in seen])
    raw = np.array([r for _, r in seen])
    np.testing.assert_allclose(angles, raw[:, 2:] * 2.0 * np.pi / (4000.0, 8000.0, 8000.0), rtol=1e-12)
    np.testing.assert_allclose(forces, 10.0 * raw[:, :2], rtol=1e-12)
    assert np.ptp(raw, axis=0).min() > 0.0
    np.testing.assert_array_equal(raw[:, 2:], np.round(raw[:, 2:]))


def test_a_table_and_a_line_through_the_same_points_give_equal_forces() -> None:
    """The card produces the volts of its own wiring; the table and the line pass through the same points."""
    table = ((-1.0, -10.0), (2.0, 20.0), (9.0, 90.0))
    by_table = replace(WIRING, load_cell_A=replace(WIRING.load_cell_A, slope=math.nan, table=table))
    line, points = stepped(), stepped(by_table)
    for (one, _), (other, _) in zip(played(line, 1500), played(points, 1500), strict=True):
        assert pytest.approx(other.F_A, abs=20.0 * STEP_V) == one.F_A
    line.close()
    points.close()


FROM_NOTHING = ((0.0, 0.0), (2.0, 20.0), (9.0, 90.0))
"""Volts and newtons of the shipped line, from no load on."""


def by_table(table: tuple[tuple[float, float], ...]) -> Wiring:
    cells = {
        name: replace(getattr(WIRING, name), slope=math.nan, offset=0.0, table=table)
        for name in ("load_cell_A", "load_cell_B")
    }
    return replace(WIRING, **cells)


@pytest.mark.parametrize("table", [FROM_NOTHING, tuple((-V, F) for V, F in reversed(FROM_NOTHING))])
def test_noise_around_zero_force_is_read_below_the_first_table_point(table: tuple[tuple[float, float], ...]) -> None:
    """As with a line, half of it is below 0 N; the load cell of the parameters has noise of 0.05 N."""
    rig = stepped(by_table(table))
    seen = []
    for _ in range(3000):
        seen.append(rig.read()[3:5])
        rig.write(ZERO_VOLTS)
    rig.close()
    F = np.array(seen)
    assert np.isfinite(F).all()
    assert F.std(axis=0) == pytest.approx(0.05, rel=0.1)
    assert np.abs(F.mean(axis=0)).max() < 5e-3  # five of its standard deviations
    assert (F < 0.0).mean() == pytest.approx(0.5, abs=0.1)


def test_a_table_is_extrapolated_by_five_percent_of_its_span(monkeypatch: pytest.MonkeyPatch) -> None:
    rig = stepped(by_table(FROM_NOTHING))
    for volts, newtons in ((-0.44, -4.4), (0.0, 0.0), (1.0, 10.0), (9.0, 90.0), (9.44, 94.4)):
        monkeypatch.setattr(VirtualCard, "_read_volts", lambda _card, _channel, V=volts: V)
        assert pytest.approx(newtons) == rig.read().F_A
    for volts in (-0.46, 9.46):
        monkeypatch.setattr(VirtualCard, "_read_volts", lambda _card, _channel, V=volts: V)
        assert math.isnan(rig.read().F_A)
    rig.close()


@pytest.mark.parametrize("volts", [9.995, -9.995, 10.0])
def test_a_load_cell_at_the_end_of_its_range_reads_nan(volts: float, monkeypatch: pytest.MonkeyPatch) -> None:
    rig = stepped()
    monkeypatch.setattr(VirtualCard, "_read_volts", lambda _card, _channel: volts)
    m = rig.read()
    assert math.isnan(m.F_A)
    assert math.isnan(m.F_B)
    assert volts == rig.raw.V_A
    rig.close()


@pytest.mark.parametrize("sensor", list(Sensor))
def test_a_sensor_reads_correctly_again_after_a_nan_reading(sensor: Sensor) -> None:
    rig = stepped()
    played(rig, 300)
    before = rig.read()
    rig.inject(InjectedFault(InjectedFaultKind.NO_NUMBER, sensor))
    rig.write(ZERO_VOLTS)
    silent = [name for name, value in zip(Measurement._fields[:5], rig.read()[:5], strict=True) if math.isnan(value)]
    assert silent == [sensor]
    rig.inject(None)
    rig.write(ZERO_VOLTS)
    assert rig.read()[:5] == pytest.approx(before[:5], abs=0.3)
    rig.close()


def test_zero_sets_the_positions_of_joint_and_motors() -> None:
    rig = stepped()
    played(rig, 500)
    before = rig.read()
    rig.zero(0.1, -0.2, 0.3)
    m = rig.read()
    assert (m.q, m.theta_A, m.theta_B) == pytest.approx((0.1, -0.2, 0.3))
    assert before.theta_B > 0.5
    rig.close()


def test_opening_a_card_sets_both_outputs_to_zero_volts() -> None:
    written: list[list[float]] = []

    class Listening(VirtualCard):
        def WriteAnalogF64(self, request: Any, context: Any) -> Any:
            written.append(list(request.write_array))
            answer = super().WriteAnalogF64(request, context)
            assert answer.samps_per_chan_written == 1
            return answer

    card = Listening(WIRING, Simulator(PARAMETERS, 0), Card.create(), has_clock=False)
    daq = Daq(WIRING, card.options)
    daq.open()
    assert written == [[0.0, 0.0]]
    daq.close()


def test_a_watchdog_that_never_expires_keeps_the_drives_off() -> None:
    """No process polls the registers of this card."""
    card = VirtualCard(WIRING, Simulator(PARAMETERS, 0), registers := Card.create(), has_clock=False)
    rig = Rig(WIRING, Daq(WIRING, card.options))
    with refused(PlantError, "watchdog_did_not_expire"):
        rig.open()
    assert not registers.state().drive_enabled


def test_a_line_disabled_by_another_cause_fails_the_proof_test() -> None:
    class Loose(Daq):
        looks = 0

        @property
        def is_enabled(self) -> bool:
            self.looks += 1
            return self.looks == 1 and super().is_enabled

    card = VirtualCard(WIRING, Simulator(PARAMETERS, 0), registers := Card.create(), has_clock=False)
    with refused(PlantError, "watchdog_did_not_expire"):
        Rig(WIRING, Loose(WIRING, card.options)).open()
    assert not registers.state().drive_enabled


def test_a_drive_lockout_disables_the_line_and_delays_the_proof_test(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """No process polls this watchdog: the proof test fails as soon as it is made."""
    switched: list[bool] = []
    set_drives = Card.set_drives

    def heard(card: Card, *, on: bool) -> None:
        switched.append(on)
        set_drives(card, on=on)

    monkeypatch.setattr(Card, "set_drives", heard)
    card = VirtualCard(WIRING, Simulator(PARAMETERS, 0), registers := Card.create(), has_clock=False)
    rig = Rig(WIRING, Daq(WIRING, card.options), drives_off=True)
    rig.open()
    rig.read()
    rig.write(ZERO_VOLTS)
    rig.acknowledge()
    assert switched
    assert not any(switched)
    with refused(PlantError, "watchdog_did_not_expire"):
        rig.switch_drives(on=True)
    assert (switched.count(True), switched[-1]) == (1, False)
    assert not registers.state().drive_enabled
    rig.write(ZERO_VOLTS)  # the loop goes on, locked
    rig.close()


def test_a_start_during_a_drive_lockout_fails_if_the_line_is_on() -> None:
    card = VirtualCard(WIRING, Simulator(PARAMETERS, 0), registers := Card.create(), has_clock=False)
    registers.set_drives(on=True)
    card.faults.enable_held = True
    with refused(PlantError, "drive_enable_not_switched", on=False):
        Rig(WIRING, Daq(WIRING, card.options), drives_off=True).open()


def test_drives_disabled_by_the_watchdog_can_be_switched_off() -> None:
    card = VirtualCard(WIRING, Simulator(PARAMETERS, 0), registers := Card.create(), has_clock=False)
    rig = Rig(WIRING, Daq(WIRING, card.options), drives_off=True)
    rig.open()
    registers.expire()
    rig.switch_drives(on=False)
    rig.acknowledge()
    assert not registers.state().drive_enabled
    rig.close()


def test_a_rig_that_is_not_open_raises() -> None:
    rig = VirtualRig(WIRING, Simulator(PARAMETERS, 0))
    for _ in range(2):
        for attempt in (rig.read, rig.acknowledge, lambda: rig.write(ZERO_VOLTS)):
            with refused(PlantError, "card_not_open"):
                attempt()
        rig.open()
        rig.read()
        rig.close()


def test_a_stuck_drive_enable_line_is_detected_before_acknowledgement() -> None:
    rig = stepped()
    rig.card.faults.enable_held = True
    with refused(PlantError, "drive_enable_stays_on", line="port2/line4"):
        rig.acknowledge()
    rig.card.faults.enable_held = False
    rig.acknowledge()
    rig.write(MotorCommand(1.0, 1.0))
    rig.close()


def test_a_watchdog_is_stopped_before_a_start_and_polled_only_while_running() -> None:
    """The virtual card rejects both with the codes of NI-DAQmx; an expired watchdog also holds its line."""
    registers = Card.create()
    daq = Daq(WIRING, VirtualCard(WIRING, Simulator(PARAMETERS, 0), registers, has_clock=False).options)
    daq.open()
    at_first = daq.is_expired
    assert not at_first
    daq.start_watchdog()
    daq.enable(on=True)
    daq.start_watchdog()
    started = daq.is_enabled
    assert started
    registers.expire()
    assert (daq.is_expired, daq.is_enabled) == (True, False)
    with pytest.raises(PlantError, match="-200678"):
        daq.enable(on=True)
    daq.start_watchdog()
    started_anew = daq.is_enabled
    assert not started_anew
    daq.enable(on=True)
    assert daq.is_enabled
    daq.close()


def test_a_card_held_by_another_task_is_rejected_at_zero_volts() -> None:
    rig = stepped()
    assert isinstance(rig, VirtualRig)
    second = Rig(rig.wiring, Daq(rig.wiring, rig.card.options))
    with refused(PlantError, "card_failed"):
        second.open()
    rig.read()
    rig.write(MotorCommand(1.0, 1.0))
    rig.close()
    rig.close()
