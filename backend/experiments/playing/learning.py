"""What the outside force reads with nothing outside, learned before a computed run that is to reject pushes.

At a rig and at the dashboard a person lets go of the joint and learns; at a computed joint nobody leans.
"""

import numpy as np

from backend.control.decoupler import STIFFNESS_RANGE
from backend.experiments.playing.play import PRETENSION_TIMEOUT_S, SLICE_S, NotPlayedError
from backend.realtime.commands import Accepted, Command, Refused, SetMode, SetReferences
from backend.realtime.headless import Headless
from backend.realtime.program import Mode, Program, SetTouch, SetTuning
from backend.sample import INDEX
from plant.interface import T_s

POINTS = 5
"""Stiffnesses at which the bias is learned, from the lowest reference to the highest."""

LEARNED_S = 1.0
"""So long a point is learned [s]."""

_SETTLING = 6.0
"""Of the slower λ: so long the joint is left to come to rest, after the time that any way takes."""
_WAY_S = 3.0


async def learn_for(loop: object, program: Program, tuning: SetTuning) -> None:
    """Learn where a computed loop begins ``program`` with a rejection, or comes to one; a live one is left alone.

    Raises NotPlayedError where the joint could not be brought to rest for it.
    """
    rejects = any(one.k_ext > 0.0 for one in (tuning, *program.tunings))
    if not rejects or not isinstance(loop, Headless) or loop.learned:
        return
    await _at_rest(loop)
    points = []
    for S_ref in np.linspace(*STIFFNESS_RANGE, POINTS):
        await _taken(loop, SetReferences(0.0, float(S_ref)))
        await loop.advance(_WAY_S + _SETTLING * max(tuning.lam_q, tuning.lam_S))
        await loop.advance(LEARNED_S)
        count = round(LEARNED_S / T_s)
        _, rows, _ = loop.ring.read(loop.ring.count - count, count)
        points.append((float(rows[:, INDEX["S"]].mean()), float(rows[:, INDEX["F_ext_hat"]].mean())))
    await _taken(loop, SetTouch(tuple(points)))
    await _taken(loop, tuning)
    await _taken(loop, SetMode(Mode.PRETENSION))


async def _at_rest(loop: Headless) -> None:
    await _taken(loop, SetMode(Mode.PRETENSION))
    waited_s = 0.0
    while isinstance(answer := await loop.send(SetMode(Mode.RUN)), Refused):
        if waited_s > PRETENSION_TIMEOUT_S:
            raise NotPlayedError(f"nothing was learned of the outside force: {answer.reason}")
        await loop.advance(SLICE_S)
        waited_s += SLICE_S


async def _taken(loop: Headless, command: Command) -> None:
    answer = await loop.send(command)
    if not isinstance(answer, Accepted):
        raise NotPlayedError(f"nothing was learned of the outside force: {answer.reason}")
