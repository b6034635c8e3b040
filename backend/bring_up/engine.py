"""Plays one step, whatever becomes of it: at its end nothing is driven and no hand is left."""

import asyncio
from collections.abc import Awaitable, Callable, Mapping
from contextlib import suppress

from backend.bring_up.directions import direction
from backend.bring_up.homing import home
from backend.bring_up.load_cells import calibrate, require_weights, tare
from backend.bring_up.steps import MORE_WEIGHTS, STEP, StepId
from backend.bring_up.tension import pretension, safety_module
from backend.bring_up.wiring_test import wiring_test
from backend.bring_up.work import DirectionsDisprovedError, Finding, StepFailedError, Work
from backend.bring_up.zeroing import zero
from backend.errors import require_within
from backend.realtime.commands import ByHand, ProveDirections, SetMode
from backend.realtime.program import Mode
from backend.realtime.supervisor import LoopDiedError
from plant.manual_input import NO_HAND

_WORK: dict[StepId, Callable[[Work], Awaitable[Finding]]] = {
    StepId.WIRING_TEST: wiring_test,
    StepId.TARE: tare,
    StepId.CALIBRATE: calibrate,
    StepId.ZERO: zero,
    StepId.DIRECTION: direction,
    StepId.HOME: home,
    StepId.PRETENSION: pretension,
    StepId.SAFETY_MODULE: safety_module,
}


def values_of(step: StepId, given: Mapping[str, float]) -> dict[str, float]:
    """Return all numbers that a step asks for, and further weights that are given.

    Raises OutOfRangeError, ValueError for one it does not ask for.
    """
    further = [more for more in MORE_WEIGHTS if more.name in given] if step is StepId.CALIBRATE else []
    asked = {wanted.name: wanted for wanted in (*STEP[step].inputs, *further)}
    unknown = ", ".join(sorted(set(given) - set(asked)))
    if unknown:
        raise ValueError(f"{step} asks for no {unknown}; it asks for {', '.join(asked) or 'nothing'}")
    values = {name: float(given.get(name, wanted.default)) for name, wanted in asked.items()}
    for name, value in values.items():
        wanted = asked[name]
        require_within(name, value, wanted.minimum, wanted.maximum, wanted.unit, words=wanted.words)
    if step is StepId.CALIBRATE:
        require_weights(values)
    return values


async def perform(step: StepId, work: Work) -> Finding:
    """Play a step; what it fails on is its finding. Raises LoopDiedError, and CancelledError where it is given up.

    To give up the trial of a motor is a finding: who does may have seen it go the wrong way.
    """
    try:
        finding = await _WORK[step](work)
        if step is StepId.DIRECTION and finding.passed:
            await work.send(ProveDirections())
    except StepFailedError as failed:
        finding = Finding(False, str(failed), disproves_directions=isinstance(failed, DirectionsDisprovedError))
    except TimeoutError as late:
        finding = Finding(False, str(late))
    except asyncio.CancelledError:
        if not work.tried_motors:
            raise
        finding = Finding(False, "it was given up after a motor had been tried: do it again")
    finally:
        await _left_safe(work)
    doubted = finding.disproves_directions or step in (StepId.WIRING_TEST, StepId.DIRECTION)
    if doubted and not finding.passed:
        with suppress(LoopDiedError):  # the next one starts unproven
            await work.loop.send(ProveDirections(proven=False))
    return finding


async def _left_safe(work: Work) -> None:
    try:
        if work.computed:
            await work.loop.send(ByHand(NO_HAND))
        # Whatever the newest sample says: a command of the last tick may not be in it. In OFF it is refused.
        await work.loop.send(SetMode(Mode.STOPPING))
    except LoopDiedError:
        pass  # what it drove is at zero volts without it
