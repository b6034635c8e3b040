"""No change of mode, law, bank or tuning moves what is at rest: neither the voltages nor the joint."""

import numpy as np
import pytest

from backend.control.motion_primitives import LARGEST_STEP_V
from backend.realtime.commands import SetMode, SetReferences
from backend.realtime.modes import Mode
from plant.parameters import load_parameters
from tests.realtime.changes_at_rest import Moved, Session, changes_at_rest

MOTIONS = {"lambda": (0.0,), "time-optimal": (8.5,), "both": (0.0, 8.5, 3.0)}


def require_still(moved: list[Moved]) -> None:
    """Neither in one tick nor in 2.5 s does a voltage move by 0.1 V, nor the joint by more than a count."""
    for change in moved:
        assert change.u <= 0.1, change
        assert change.counts <= 1.01, change


@pytest.mark.parametrize("name", ["lab", "lab-stick"])
@pytest.mark.parametrize("motion", list(MOTIONS))
def test_changes_at_rest_move_nothing(name: str, motion: str) -> None:
    plant = load_parameters(name)
    require_still(changes_at_rest(plant, 7, number=6, places=2, budgets=MOTIONS[motion]))


@pytest.mark.parametrize("name", ["lab", "lab-stick"])
@pytest.mark.parametrize("motion", list(MOTIONS))
def test_200_changes_at_rest_move_nothing(name: str, motion: str) -> None:
    plant = load_parameters(name)
    moved = [
        change
        for seed in range(4)
        for change in changes_at_rest(plant, seed, number=10, places=5, budgets=MOTIONS[motion])
    ]
    assert len(moved) == 200
    require_still(moved)


@pytest.mark.parametrize("u_plan", [0.0, 8.5])
@pytest.mark.parametrize("ticks", [0, 60, 700])
def test_a_soft_stop_changes_the_voltages_gradually(u_plan: float, ticks: int) -> None:
    """At rest it lets them go by less than half a volt at once, in a move no faster than a move changes them."""
    session = Session(load_parameters("lab"), 1, (u_plan,))
    session.pretension()
    session.order(SetMode(Mode.RUN))
    session.order(SetReferences(-1.0, 10.0))
    session.run(9000)
    if ticks:
        session.order(SetReferences(1.0, 14.0))
        session.run(ticks)
    session.order(SetMode(Mode.STOPPING))
    session.run(450)
    u = session.voltages(451)
    # The first step counts from the voltage that the loop would have gone on with.
    assert np.max(np.abs(np.diff(u, axis=0))) <= (LARGEST_STEP_V + 0.2 if ticks else 0.3)
    session.close()
