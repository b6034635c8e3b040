"""A change of mode while the joint moves changes the voltages from one sample to the next by no more than is stated."""

import re
from collections.abc import Iterator
from contextlib import closing

import numpy as np
import pytest

from backend.control.motion_primitives import LARGEST_STEP_V
from backend.realtime.commands import RunProgram, SetMode, SetReferences
from backend.realtime.modes import LEGAL, Mode
from backend.realtime.program import Excitation, Law, Program, Segment
from plant.parameters import load_parameters
from tests.docs.faults_page import PAGE
from tests.realtime.changes_at_rest import Session

STEPS = Program(
    Law.CASCADE,
    (Segment(duration_s=9.0, q_ref=1.0, S_ref=14.0), Segment(duration_s=5.0, q_ref=-1.0, S_ref=9.0)),
)
SHAKEN = Program(
    Law.FORCE_HOLD,
    tension_N=25.0,
    settle_s=0.5,
    excitation=Excitation(amplitude_rad=1.0, chip_s=0.3, levels="+-" * 6, periods=1),
)
CHANGES = [
    (before, after)
    for before in (Mode.RUN, Mode.COMPLIANCE, Mode.EXPERIMENT, Mode.IDENTIFY, Mode.PRETENSION)
    for after in LEGAL[before]
    if after is not Mode.OFF and not (before is Mode.PRETENSION and after is not Mode.STOPPING)
]
"""Off takes the voltages away at once, and the moves out of pretension wait until it is reached."""
WORST = [(Mode.RUN, Mode.COMPLIANCE), (Mode.COMPLIANCE, Mode.RUN), (Mode.RUN, Mode.STOPPING)]
AFTER_TICKS = 40


def stated_V() -> float:
    found = re.search(r"by at most (\d+(?:\.\d+)?) V from one sample to the next", " ".join(PAGE.split()))
    assert found is not None
    return float(found[1])


def moving_in(session: Session, mode: Mode) -> None:
    """Let the joint or the motors begin a large move in a mode."""
    session.pretension()
    session.run(3000)
    match mode:
        case Mode.RUN:
            session.order(SetMode(Mode.RUN))
            session.order(SetReferences(1.0, 14.0))
        case Mode.COMPLIANCE:
            session.order(SetMode(Mode.COMPLIANCE))
            session.order(SetReferences(0.0, 14.5))
        case Mode.EXPERIMENT:
            session.order(RunProgram(STEPS))
        case Mode.IDENTIFY:
            session.order(RunProgram(SHAKEN))
            session.run(700)
        case _:  # back to pretension from a move
            session.order(SetMode(Mode.RUN))
            session.order(SetReferences(1.0, 14.0))
            session.run(3000)
            session.order(SetMode(Mode.PRETENSION))


def largest_steps(plant: str, before: Mode, after: Mode, moments: range) -> Iterator[float]:
    """Largest step of a voltage [V] in the change, made so many ticks into the move, in both motions."""
    for u_plan in (0.0, 8.5):
        for ticks in moments:
            with closing(Session(load_parameters(plant), ticks, (u_plan,))) as session:
                moving_in(session, before)
                session.run(ticks)
                if after in (Mode.EXPERIMENT, Mode.IDENTIFY):
                    session.order(RunProgram(STEPS if after is Mode.EXPERIMENT else SHAKEN))
                else:
                    session.order(SetMode(after))
                session.run(AFTER_TICKS)
                yield float(np.max(np.abs(np.diff(session.voltages(AFTER_TICKS + 2), axis=0))))


def require_bound(plant: str, before: Mode, after: Mode, moments: range) -> None:
    # The tick of a soft stop is counted from the voltage that the loop would have gone on with.
    bound = LARGEST_STEP_V + 0.2 if after is Mode.STOPPING else stated_V()
    assert max(largest_steps(plant, before, after, moments)) <= bound


@pytest.mark.parametrize(("before", "after"), WORST)
def test_the_largest_changes_keep_the_bound(before: Mode, after: Mode) -> None:
    require_bound("lab", before, after, range(90, 500, 205))


@pytest.mark.parametrize("plant", ["ideal", "lab", "lab-stick"])
@pytest.mark.parametrize(("before", "after"), CHANGES)
def test_every_change_keeps_the_bound(plant: str, before: Mode, after: Mode) -> None:
    require_bound(plant, before, after, range(15, 700, 40))


def test_the_bound_is_no_larger_than_it_has_to_be() -> None:
    assert max(largest_steps("ideal", Mode.RUN, Mode.COMPLIANCE, range(490, 520, 10))) > 0.8 * stated_V()
