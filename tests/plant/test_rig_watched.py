"""The rig at a virtual card under its watchdog process: silence takes the drives away, and everybody can see it."""

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
def a_machine_that_is_busy(monkeypatch: pytest.MonkeyPatch) -> None:
    """Neither a cycle nor the watchdog's process is as fast as on a machine that has nothing else to do."""
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


def test_silence_takes_the_drives_away_until_they_are_acknowledged() -> None:
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


def test_what_nobody_else_can_look_into_is_mirrored() -> None:
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


def test_volts_that_could_not_be_written_are_not_shown() -> None:
    """A card that is gone keeps what it had, and its drives, until its watchdog cuts them."""
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


def test_a_watchdog_that_says_so_and_leaves_the_line_on_is_found_at_the_start() -> None:
    rig, registers = watched()
    assert isinstance(rig, VirtualRig)
    rig.card.faults.enable_held = True
    with refused(PlantError, "watchdog_left_drives_on", line="port2/line4", within_s=pytest.approx(2.5)):
        rig.open()
    assert not registers.state().drive_enabled
    rig.close()


@pytest.mark.parametrize("pauses", [1, 2, 3])
def test_a_machine_that_pauses_at_the_start_has_the_watchdog_begin_again(
    pauses: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Nothing is driven yet, so a pause there is no fault; one that comes back each time is."""
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
