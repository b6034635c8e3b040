"""The drive lockout is stored for the next start of the service, separately for each rig."""

import asyncio
from contextlib import closing, suppress
from pathlib import Path

import pytest

from backend.commissioning.session import DriveLockout, switch_drives
from backend.realtime.commands import Accepted, Command, Refused
from backend.realtime.gains import make_tuning_command
from backend.realtime.ipc import Setup
from backend.realtime.program import SetTuning
from backend.realtime.supervisor import LoopExitedError, Supervisor
from backend.storage.database import open_database
from backend.tuning.gains import TuningParameters
from plant.interface import SIMULATOR, PlantChoice, PlantKind
from plant.parameters import load_parameters

RIG, VIRTUAL = PlantChoice(PlantKind.RIG), PlantChoice(PlantKind.VIRTUAL_CARD)


@pytest.fixture(scope="module")
def tuning() -> SetTuning:
    return make_tuning_command(load_parameters("ideal"), TuningParameters())


def test_the_lockout_is_known_after_a_restart_until_it_is_released(tmp_path: Path) -> None:
    def left(plant: PlantChoice) -> str:
        with closing(open_database(tmp_path)) as database:
            lockout = DriveLockout(database, plant).previous_lock
            return "" if lockout is None else lockout.who

    def said(plant: PlantChoice, is_locked: bool, who: str) -> None:
        with closing(open_database(tmp_path)) as database:
            lockout = DriveLockout(database, plant)
            asyncio.run(lockout.store(is_locked, who))
            assert (lockout.previous_lock, lockout.problem) == (
                None,
                "",
            )  # it was in this run of the service, and the page shows it

    assert left(RIG) == ""
    said(RIG, True, "Ada")
    assert left(RIG) == "Ada"
    assert left(VIRTUAL) == left(SIMULATOR) == ""
    said(VIRTUAL, True, "Bob")
    said(VIRTUAL, False, "Bob")  # to practise says nothing of the rig
    assert left(RIG) == "Ada"
    said(RIG, False, "Cleo")
    assert left(RIG) == ""


def test_a_lockout_that_cannot_be_stored_is_reported(tmp_path: Path) -> None:
    database = open_database(tmp_path)
    lockout = DriveLockout(database, RIG)
    for file in tmp_path.iterdir():
        file.unlink()
    tmp_path.rmdir()
    database.close()
    asyncio.run(lockout.store(True, "Ada"))
    assert "could not be kept for the next start" in lockout.problem


class NeverAnswers(Supervisor):
    """A loop that never replies to a command."""

    async def send(self, command: Command) -> Accepted | Refused:
        return await asyncio.Future()


def test_a_lockout_is_stored_without_a_reply_of_the_loop(tmp_path: Path, tuning: SetTuning) -> None:
    async def given_up(on: bool) -> None:
        with suppress(TimeoutError):
            await asyncio.wait_for(switch_drives(supervisor, DriveLockout(database, RIG), on, "Ada"), 0.05)

    with closing(open_database(tmp_path)) as database:
        supervisor = NeverAnswers(Setup(RIG, "ideal", 0, tuning))
        asyncio.run(given_up(False))
        assert DriveLockout(database, RIG).previous_lock is not None
        asyncio.run(given_up(True))  # not known whether they came on: hands may be is_locked
        assert DriveLockout(database, RIG).previous_lock is not None
        supervisor.ring.close()


def test_without_a_loop_the_drives_can_be_switched_off_and_not_on(tmp_path: Path, tuning: SetTuning) -> None:
    """They are off already, and the next loop starts with locked drives."""
    with closing(open_database(tmp_path)) as database:
        supervisor, lockout = Supervisor(Setup(RIG, "ideal", 0, tuning)), DriveLockout(database, RIG)
        asyncio.run(switch_drives(supervisor, lockout, False, "Ada"))
        assert supervisor.setup.drives_off
        assert DriveLockout(database, RIG).previous_lock is not None
        with pytest.raises(LoopExitedError):
            asyncio.run(switch_drives(supervisor, lockout, True, "Ada"))
        assert DriveLockout(database, RIG).previous_lock is not None
        supervisor.ring.close()
