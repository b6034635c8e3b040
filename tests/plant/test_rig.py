"""The rig at a virtual card: what it reads, what it writes, and what takes the drives away."""

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


def test_a_rig_at_a_virtual_card_reads_as_the_simulator_does() -> None:
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


def test_what_was_read_follows_from_volts_and_counts() -> None:
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


def test_a_table_and_another_slope_give_the_same_newtons() -> None:
    """The card gives the volts of its own wiring; a table and a line through the same points mean the same."""
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
def test_noise_about_no_force_is_read_below_the_first_point_of_a_table(table: tuple[tuple[float, float], ...]) -> None:
    """As a line reads it, half of it below 0 N; the load cell of the parameters has noise of 0.05 N."""
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


def test_a_table_is_gone_beyond_by_a_twentieth_of_its_span(monkeypatch: pytest.MonkeyPatch) -> None:
    rig = stepped(by_table(FROM_NOTHING))
    for volts, newtons in ((-0.44, -4.4), (0.0, 0.0), (1.0, 10.0), (9.0, 90.0), (9.44, 94.4)):
        monkeypatch.setattr(VirtualCard, "_read_volts", lambda _card, _channel, V=volts: V)
        assert pytest.approx(newtons) == rig.read().F_A
    for volts in (-0.46, 9.46):
        monkeypatch.setattr(VirtualCard, "_read_volts", lambda _card, _channel, V=volts: V)
        assert math.isnan(rig.read().F_A)
    rig.close()


@pytest.mark.parametrize("volts", [9.995, -9.995, 10.0])
def test_a_load_cell_at_its_end_is_no_number(volts: float, monkeypatch: pytest.MonkeyPatch) -> None:
    rig = stepped()
    monkeypatch.setattr(VirtualCard, "_read_volts", lambda _card, _channel: volts)
    m = rig.read()
    assert math.isnan(m.F_A)
    assert math.isnan(m.F_B)
    assert volts == rig.raw.V_A
    rig.close()


@pytest.mark.parametrize("sensor", list(Sensor))
def test_a_reading_that_was_no_number_comes_back_as_it_was(sensor: Sensor) -> None:
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


def test_zero_says_where_joint_and_motors_stand() -> None:
    rig = stepped()
    played(rig, 500)
    before = rig.read()
    rig.zero(0.1, -0.2, 0.3)
    m = rig.read()
    assert (m.q, m.theta_A, m.theta_B) == pytest.approx((0.1, -0.2, 0.3))
    assert before.theta_B > 0.5
    rig.close()


def test_a_card_that_is_opened_gets_zero_volts_at_both_outputs() -> None:
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


def test_a_watchdog_that_cuts_nothing_keeps_the_drives_off() -> None:
    """A card whose watchdog never expires: nobody looks at its registers."""
    card = VirtualCard(WIRING, Simulator(PARAMETERS, 0), registers := Card.create(), has_clock=False)
    rig = Rig(WIRING, Daq(WIRING, card.options))
    with refused(PlantError, "watchdog_did_not_expire"):
        rig.open()
    assert not registers.state().drive_enabled


def test_a_line_that_something_else_has_cut_proves_no_watchdog() -> None:
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


def test_hands_at_the_rig_have_the_line_off_from_the_first_moment_and_the_watchdog_tried_when_they_leave(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Nobody looks at this watchdog: the trial fails as soon as it is made."""
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


def test_a_line_that_is_on_while_hands_are_at_the_rig_is_no_start() -> None:
    card = VirtualCard(WIRING, Simulator(PARAMETERS, 0), registers := Card.create(), has_clock=False)
    registers.set_drives(on=True)
    card.faults.enable_held = True
    with refused(PlantError, "drive_enable_not_switched", on=False):
        Rig(WIRING, Daq(WIRING, card.options), drives_off=True).open()


def test_drives_that_the_watchdog_has_cut_can_be_switched_off() -> None:
    card = VirtualCard(WIRING, Simulator(PARAMETERS, 0), registers := Card.create(), has_clock=False)
    rig = Rig(WIRING, Daq(WIRING, card.options), drives_off=True)
    rig.open()
    registers.expire()
    rig.switch_drives(on=False)
    rig.acknowledge()
    assert not registers.state().drive_enabled
    rig.close()


def test_a_rig_that_is_not_open_says_so() -> None:
    rig = VirtualRig(WIRING, Simulator(PARAMETERS, 0))
    for _ in range(2):
        for attempt in (rig.read, rig.acknowledge, lambda: rig.write(ZERO_VOLTS)):
            with refused(PlantError, "card_not_open"):
                attempt()
        rig.open()
        rig.read()
        rig.close()


def test_a_drive_enable_line_that_stays_on_is_found_before_anything_is_acknowledged() -> None:
    rig = stepped()
    rig.card.faults.enable_held = True
    with refused(PlantError, "drive_enable_stays_on", line="port2/line4"):
        rig.acknowledge()
    rig.card.faults.enable_held = False
    rig.acknowledge()
    rig.write(MotorCommand(1.0, 1.0))
    rig.close()


def test_a_running_watchdog_is_stopped_before_it_is_started_and_looked_at_only_while_it_runs() -> None:
    """The virtual card refuses both with the codes of NI-DAQmx; an expired one also keeps its line."""
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


def test_a_card_that_another_task_holds_is_refused_with_zero_volts() -> None:
    rig = stepped()
    assert isinstance(rig, VirtualRig)
    second = Rig(rig.wiring, Daq(rig.wiring, rig.card.options))
    with refused(PlantError, "card_failed"):
        second.open()
    rig.read()
    rig.write(MotorCommand(1.0, 1.0))
    rig.close()
    rig.close()
