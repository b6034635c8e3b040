"""The rig on a virtual card with its watchdog process: silence disables the drives, and the state is visible."""

import time

import pytest

from plant import rig as rig_module
from plant.daq import Daq
from plant.factory import make_plant
from plant.interface import InjectedFault, InjectedFaultKind, MotorCommand, PlantChoice, PlantError, PlantKind
from plant.parameters import load_parameters
from plant.rig import Rig
from plant.safety_card import Card, WatchdogExpiredError
from plant.virtual_daq import VirtualRig
from tests.refusals import refused

pytestmark = pytest.mark.live

PARAMETERS = load_parameters("lab")
STEP_V = 20.0 / 2**16
PATIENCE_S = 30.0
PROOF_S = 2.0


@pytest.fixture(autouse=True)
def busy_machine(monkeypatch: pytest.MonkeyPatch) -> None:
    """Cycles and the watchdog process are slower than on an idle machine."""
    monkeypatch.setattr(rig_module, "CYCLE_MAX_S", 10.0)
    monkeypatch.setattr(rig_module, "_PROOF_S", PROOF_S)


def watched() -> tuple[Rig, Card]:
    registers = Card.create()
    rig = make_plant(PlantChoice(PlantKind.VIRTUAL_CARD), PARAMETERS, 0, registers)
    assert isinstance(rig, Rig)
    return rig, registers


def until_expired(registers: Card) -> None:
    end_s = time.monotonic() + PATIENCE_S
    while not registers.state().expired:
        assert time.monotonic() < end_s, "the watchdog has not expired"
        time.sleep(0.01)


def test_silence_disables_the_drives_until_acknowledgement() -> None:
    rig, registers = watched()
    rig.open()
    rig.read()
    rig.write(MotorCommand(1.0, 1.0))
    assert registers.state().u_A == pytest.approx(1.0, abs=STEP_V)
    until_expired(registers)
    state = registers.state()
    assert (state.u_A, state.u_B, state.drive_enabled) == (0.0, 0.0, False)
    with refused(WatchdogExpiredError, "watchdog_expired", watchdog_s=0.5):
        rig.write(MotorCommand(1.0, 1.0))
    rig.acknowledge()
    rig.write(MotorCommand(0.5, 0.0))
    assert registers.state().u_A == pytest.approx(0.5, abs=STEP_V)
    rig.close()
    assert not registers.state().drive_enabled


def test_the_state_of_the_card_is_mirrored_for_other_processes() -> None:
    rig, registers = watched()
    mirror = Card.create()
    assert isinstance(rig, VirtualRig)
    mirrored = Rig(rig.wiring, Daq(rig.wiring, rig.card.options), mirror)
    mirrored.open()
    mirrored.read()
    mirrored.write(MotorCommand(1.0, 2.0))
    state = mirror.state()
    assert state.mirror
    assert (state.armed, state.drive_enabled, state.expired) == (True, True, False)
    assert (state.u_A, state.u_B, state.watchdog_s) == (1.0, 2.0, 0.5)
    until_expired(registers)
    with pytest.raises(WatchdogExpiredError):
        mirrored.write(MotorCommand(1.0, 2.0))
    assert mirror.state().expired
    assert mirror.state().u_A == 0.0
    mirrored.close()


def test_voltages_that_were_not_written_are_not_mirrored() -> None:
    """A disconnected card keeps its voltages and its drives until its watchdog expires."""
    rig, registers = watched()
    mirror = Card.create()
    assert isinstance(rig, VirtualRig)
    mirrored = Rig(rig.wiring, Daq(rig.wiring, rig.card.options), mirror)
    mirrored.open()
    mirrored.write(MotorCommand(1.0, 2.0))
    rig.inject(InjectedFault(InjectedFaultKind.DEVICE_GONE))
    with pytest.raises(PlantError, match="-201003"):
        mirrored.write(MotorCommand(7.0, -7.0))
    mirrored.close()
    state = mirror.state()
    assert (state.u_A, state.u_B, state.drive_enabled) == (1.0, 2.0, True)
    until_expired(registers)


def test_a_watchdog_that_expires_without_disabling_is_detected_at_the_start() -> None:
    rig, registers = watched()
    assert isinstance(rig, VirtualRig)
    rig.card.faults.enable_held = True
    with refused(PlantError, "watchdog_left_drives_on", line="port2/line4", within_s=pytest.approx(2.5)):
        rig.open()
    assert not registers.state().drive_enabled
    rig.close()


@pytest.mark.parametrize("pauses", [1, 2, 3])
def test_a_pause_at_the_start_restarts_the_watchdog(pauses: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """Nothing is driven yet, so one pause is no fault; a pause at each attempt is."""
    rig, registers = watched()
    enable, left = Daq.enable, pauses

    def paused(daq: Daq, *, on: bool) -> None:
        nonlocal left
        if daq.is_watchdog_started and left:
            left -= 1
            until_expired(registers)
        enable(daq, on=on)

    monkeypatch.setattr(Daq, "enable", paused)
    if pauses < 3:
        rig.open()
        rig.write(MotorCommand(1.0, 1.0))
        assert registers.state().drive_enabled
    else:
        with pytest.raises(PlantError, match="the watchdog timer has expired"):
            rig.open()
    rig.close()
    assert not registers.state().drive_enabled
