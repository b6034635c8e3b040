"""Pretension under watch, and the safety module's trip, provoked at that tension."""

import numpy as np

from backend.bring_up.work import Figure, Finding, Rows, Signal, StepFailedError, Work, known
from backend.faults import FAULT_CODE, Fault
from backend.loop.commands import Reset, SetMode, Stop
from backend.loop.mode import Mode
from backend.loop.motion import PRETENSION_N
from backend.sample import INDEX
from plant.hand import Hand

TENSION_MAX_N = 18.0
"""Beyond this [N] the pretension of 10 N has gone wrong, and is stopped hard."""

APART_N = 6.0
"""So much may one tension be ahead of the other [N] on the way up: the joint is free, so that they rise together."""

NEAR_N = 1.0
WINDING_S = 60.0
LOOK_S = 0.05
TRIP_S = 20.0
LOWERED_N = 5.0


async def pretension(work: Work) -> Finding:
    """Wind up, both tensions watched, hold, and let go again."""
    highest, apart = await _wound(work)
    F = await work.mean("F_A", "F_B", seconds=0.5)
    F_A, F_B = (float(held) for held in F)
    await work.send(SetMode(Mode.OFF))
    await work.loop.advance(0.2)
    figures = (
        Figure("tension of tendon A", known(F_A), "N"),
        Figure("tension of tendon B", known(F_B), "N"),
        Figure("highest tension on the way", highest, "N"),
        Figure("most that one was ahead of the other", apart, "N"),
    )
    if not near_pretension(F):
        raise StepFailedError(f"the tendons hold {F_A:.1f} N and {F_B:.1f} N, not {PRETENSION_N:g} N: calibrate them")
    return Finding(True, f"both tendons rose together to {PRETENSION_N:g} N", figures)


async def safety_module(work: Work) -> Finding:
    """At the pretension, have the module's limit lowered below it, see the trip, and have it set back."""
    work.phase("winding up to the pretension")
    await _wound(work)
    before = await work.mean("F_A", "F_B")
    first = work.loop.ring.count
    await work.ask(
        f"Lower the tension limit at the safety module below {PRETENSION_N:g} N: it has to trip; then confirm",
        Hand(F_limit=LOWERED_N),
    )
    work.phase("waiting for the trip")
    try:
        await work.loop.advance_until(lambda: work.mode is Mode.TRIPPED, TRIP_S)
    except TimeoutError:
        raise StepFailedError(
            f"the module did not trip within {TRIP_S:g} s below the tension that the tendons held: do not go on; look "
            "at its limit, its supply, and safety_tripped in the wiring file"
        ) from None
    await work.loop.advance(1.0)
    rows = work.since(first)
    tripped = rows[rows[:, INDEX["mode"]] == rows[-1, INDEX["mode"]]]
    if tripped[-1, INDEX["fault"]] != FAULT_CODE[Fault.SAFETY_MODULE]:
        raise StepFailedError(
            "the loop stopped, but not because of the safety module: the status line says why; set the module's limit "
            "back to what it was"
        )
    still_driven = float(np.abs(tripped[1:, [INDEX["u_A"], INDEX["u_B"]]]).max(initial=0.0))
    after = tripped[-100:, [INDEX["F_A"], INDEX["F_B"]]].mean(axis=0)
    if not (still_driven == 0.0 and let_go(before, after)):
        raise StepFailedError(
            "the module tripped, but that the motors let go was not seen: do not go on; look at how it cuts the "
            "drives, and set its limit back to what it was"
        )
    await work.ask("Set the module's limit back to what it was, acknowledge it there, and confirm")
    await work.let_go()
    await work.send(Reset())
    figures = (
        Figure("tension before", float(before.mean()), "N"),
        Figure("tension 1 s after", float(after.mean()), "N"),
        Figure("voltage after the trip", still_driven, "V"),
    )
    return Finding(True, "the module tripped, the outputs went to zero volts, and the motors let go", figures)


def near_pretension(F: Signal) -> bool:
    """Tell whether both tensions [2] are the pretension; no number is not."""
    return bool((np.abs(F - PRETENSION_N) <= NEAR_N).all())


def let_go(before: Signal, after: Signal) -> bool:
    """Tell whether both tensions [2] have fallen by more than NEAR_N; no number has not."""
    return bool((after < before - NEAR_N).all())


def peaks(F: Rows) -> tuple[float, float]:
    """Return the highest tension of [n, 2] and the most that one was ahead of the other [N]; nan for no number."""
    return float(F.max()), float(np.abs(F[:, 0] - F[:, 1]).max())


async def _wound(work: Work) -> tuple[float, float]:
    """Go to pretension under watch; return the highest tension and the most that one was ahead [N]."""
    work.phase("winding up")
    await work.ask("Take your hands off: the motors wind up. Confirm to begin")
    await work.let_go()
    await work.drives_on()
    first = work.loop.ring.count
    await work.send(SetMode(Mode.PRETENSION))
    waited_s, highest, apart, steady_s = 0.0, 0.0, 0.0, 0.0
    while waited_s < WINDING_S:
        await work.loop.advance(LOOK_S)
        waited_s += LOOK_S
        rows = work.since(first)
        first += len(rows)
        if not len(rows):
            continue
        F = rows[:, [INDEX["F_A"], INDEX["F_B"]]]
        # NumPy's maximum keeps a nan, Python's max may drop it.
        highest, apart = (float(most) for most in np.maximum((highest, apart), peaks(F)))
        if not (highest <= TENSION_MAX_N and apart <= APART_N):
            await work.loop.send(Stop(Fault.STOP_PRESSED, hard=True, detail="the pretension went wrong"))
            raise StepFailedError(
                f"stopped: up to {highest:.1f} N, one tendon ahead by up to {apart:.1f} N; at most {TENSION_MAX_N:g} N "
                f"and {APART_N:g} N belong to a pretension of {PRETENSION_N:g} N: do the steps before anew"
            )
        if work.mode is not Mode.PRETENSION:
            raise StepFailedError("the loop stopped on the way up: the status line says why")
        steady_s = steady_s + LOOK_S if near_pretension(F.mean(axis=0)) else 0.0
        if steady_s >= 2.0:
            return highest, apart
    raise StepFailedError(f"the pretension was not reached within {WINDING_S:g} s")
