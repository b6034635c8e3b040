"""Pretension under watch, and the safety module's trip, provoked at that tension."""

import numpy as np

from backend.bring_up.work import Figure, Finding, Rows, Signal, StepFailedError, Work, known
from backend.control.motion_primitives import PRETENSION_N
from backend.faults import FAULT_CODE, Fault
from backend.realtime.commands import Reset, SetMode, Stop, TryModule
from backend.realtime.commissioning_motions import DRIVEN_S
from backend.realtime.program import Mode
from backend.sample import INDEX
from plant.interface import T_s
from plant.manual_input import Hand

TENSION_MAX_N = 18.0
"""Beyond this [N] the pretension of 10 N has gone wrong, and is stopped hard."""

APART_N = 6.0
"""So much may one tension be ahead of the other [N] on the way up: the joint is free, so that they rise together."""

NEAR_N = 1.0
WINDING_S = 60.0
LOOK_S = 0.05
TRIP_S = 20.0
LOWERED_N = 5.0

TURNED_BACK_RAD = 0.01
"""A motor that loses its drive is turned back by its tendon, by so much at least [rad]: 13 counts of its encoder. In
the model it is 0.04 rad; one that keeps its drive winds up by as much and more."""

DRIVEN_MIN_V = 0.5
"""So much at least is on the outputs at the end [V]: more than friction holds a motor against."""

_SET_BACK = "; set the module's limit back to what it was"


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
    """At the pretension, have the module's limit lowered below it: it has to trip, and to cut motors that are driven.

    From the trip on the loop drives them for DRIVEN_S more, so that it is the module that lets go.
    """
    work.phase("winding up to the pretension")
    await _wound(work)
    before = await work.mean("F_A", "F_B")
    first = work.loop.ring.count
    await work.send(TryModule())
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
            f"at its limit, its supply, and safety_tripped in the wiring file{_SET_BACK}"
        ) from None
    await work.loop.advance(1.0)
    rows = work.since(first)
    tripped = int(np.argmax(rows[:, INDEX["mode"]] == rows[-1, INDEX["mode"]]))
    if rows[-1, INDEX["fault"]] != FAULT_CODE[Fault.SAFETY_MODULE]:
        raise StepFailedError(
            f"the loop stopped, but not because of the safety module: the status line says why{_SET_BACK}"
        )
    driven = rows[max(tripped - round(DRIVEN_S / T_s), 0) : tripped]
    volts = driven[:, [INDEX["u_A"], INDEX["u_B"]]].max(axis=0)
    turned = driven[-1, [INDEX["theta_A"], INDEX["theta_B"]]] - driven[0, [INDEX["theta_A"], INDEX["theta_B"]]]
    after = rows[-100:, [INDEX["F_A"], INDEX["F_B"]]].mean(axis=0)
    still_driven = float(np.abs(rows[tripped:, [INDEX["u_A"], INDEX["u_B"]]]).max())
    figures = (
        Figure("tension before", known(float(before.mean())), "N"),
        Figure("voltage that motor A was still given", known(float(volts[0])), "V"),
        Figure("voltage that motor B was still given", known(float(volts[1])), "V"),
        Figure("motor A turned by meanwhile", known(float(turned[0])), "rad"),
        Figure("motor B turned by meanwhile", known(float(turned[1])), "rad"),
        Figure("tension 1 s after", known(float(after.mean())), "N"),
    )
    problem = "" if still_driven == 0.0 else "the loop did not go to zero volts"
    problem = problem or uncut(volts, turned)
    problem = problem or ("" if let_go(before, after) else "the tension did not fall after it")
    if problem:
        return Finding(False, f"the module tripped, but {problem}: do not go on{_SET_BACK}", figures)
    await work.ask("Set the module's limit back to what it was, acknowledge it there, and confirm")
    await work.let_go()
    await work.send(Reset())
    return Finding(True, "the module tripped and cut both motors while they were still given voltage", figures)


def uncut(volts: Signal, turned: Signal) -> str:
    """Return what tells that the drives were not cut: ``turned`` [2] in rad while up to ``volts`` [2] were given."""
    for motor, u, way in zip("AB", volts, turned, strict=True):
        if not u >= DRIVEN_MIN_V:
            return f"motor {motor} was given {u:.2f} V only: whether its drive was cut cannot be told"
        if not way <= -TURNED_BACK_RAD:
            return (
                f"motor {motor} did not let go while it was given {u:.2f} V for {DRIVEN_S:g} s more (it turned by "
                f"{way:.4f} rad, {-TURNED_BACK_RAD:g} rad are letting go): look at how the module cuts the drives"
            )
    return ""


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
