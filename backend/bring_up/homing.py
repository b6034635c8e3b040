"""The zero found by motion: the motors drive the joint to its end switch, once their directions are proven."""

import numpy as np

from backend.bring_up.work import DirectionsDisprovedError, Figure, Finding, StepFailedError, Work, known
from backend.realtime.commands import Event, Home, ModeChanged
from backend.realtime.commissioning_motions import HOMING_MAX_V, TENSION_MAX_N, TIME_MAX_S, travel_to
from backend.realtime.program import MODE_CODE, HomingEnd, Mode, Why
from backend.realtime.supervisor import LoopDied
from backend.sample import INDEX

_REMEDIES = {
    HomingEnd.NOT_REACHED: "turn the joint to its middle, look at end_switch.line, its cable and end_switch.position",
    HomingEnd.STUCK_CLOSED: "look at the switch, at end_switch.line and end_switch.active",
    HomingEnd.WRONG_WAY: "do the wiring test and the direction step again",
    HomingEnd.JOINT_HELD: "look what holds the joint, and at encoder_q",
    HomingEnd.MOTOR_OFF: "do the direction step again",
    HomingEnd.TENSION: "look what holds the joint, and calibrate the load cells",
    HomingEnd.SLACK: "look at the tendons on their reels, and at the load cells",
    HomingEnd.TOO_LONG: "turn the joint to its middle and try again",
}


async def home(work: Work) -> Finding:
    """Have the loop drive the joint to its end switch, and take the zero that it found there."""
    position = work.wiring.end_switch.position
    await work.drives_off()
    await work.ask(
        "Turn the joint by hand near to its middle, slacken the tendons, take your hands off, and confirm: the drives "
        f"come on, and with {HOMING_MAX_V:g} V at most the motors drive the joint to its end switch at "
        f"{position:.4g} rad, by {travel_to(position):.4g} rad at most"
    )
    await work.let_go()
    await work.drives_on()
    ends: list[Why] = []

    def hear(event: Event | LoopDied) -> None:
        if isinstance(event, ModeChanged) and event.before is Mode.IDENTIFY:
            ends.append(event.cause)

    work.phase("homing")
    forget = work.loop.listen(hear)
    first = work.loop.ring.count
    try:
        await work.send(Home(position))
        await work.loop.advance_until(lambda: bool(ends), TIME_MAX_S + 1.0)
    finally:
        forget()
    await work.loop.advance(0.2)
    if ends[0] in (HomingEnd.WRONG_WAY, HomingEnd.MOTOR_OFF):
        raise DirectionsDisprovedError(_told(ends[0]))
    if ends[0] is not HomingEnd.HOMED:
        raise StepFailedError(_told(ends[0]))
    rows = work.since(first)
    way = rows[rows[:, INDEX["mode"]] == MODE_CODE[Mode.IDENTIFY]]
    figures = (
        Figure("joint was driven over", known(float(np.ptp(way[:, INDEX["q"]]))), "rad"),
        Figure("highest tension", known(float(way[:, [INDEX["F_A"], INDEX["F_B"]]].max())), "N"),
        Figure("largest voltage", known(float(np.abs(way[:, [INDEX["u_A"], INDEX["u_B"]]]).max())), "V"),
        Figure("joint position now", known(float(rows[-1, INDEX["q"]])), "rad"),
    )
    return Finding(True, f"the joint's encoder counts from the end switch at {position:.4g} rad", figures)


def _told(cause: Why) -> str:
    if not isinstance(cause, HomingEnd) or cause not in _REMEDIES:
        return f"the loop stopped on the way ({cause}): the status line says why; reset it, and try again"
    limit = f", {TENSION_MAX_N:g} N at most" if cause is HomingEnd.TENSION else ""
    return f"{cause}{limit}: {_REMEDIES[cause]}"
