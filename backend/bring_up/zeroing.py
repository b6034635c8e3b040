"""Where joint and motors stand: at the joint's zero mark, or at its end switch where its position is known."""

import math

from backend.bring_up.work import SLACK, Figure, Finding, StepFailedError, Work
from backend.realtime.commands import Zero
from backend.sample import INDEX
from plant.manual_input import Hand

NEAR_RAD = 0.01
"""The joint reads so near [rad] to where it was put, once that was said."""


async def zero(work: Work) -> Finding:
    """Set the encoders; the motors' own zeros are found by the pretension each time."""
    await work.drives_off()
    position = work.wiring.end_switch.position
    homing = not math.isnan(position)
    if homing:
        # Slack enough for the joint to get there: what it takes up of a tendon, its motor has to let out.
        out = -abs(position) * work.parameters.geometry.r_j / work.parameters.geometry.r_m
        hand = Hand(q=1.02 * position, theta_A=out, theta_B=out)
        await work.ask(
            f"Slacken both tendons, turn the joint slowly by hand onto its end switch at {position:.4g} rad, hold it "
            "there, and confirm",
            hand,
        )
    else:
        position = 0.0
        await work.ask("Turn the joint by hand to its zero mark, hold it there, and confirm", SLACK)
    work.phase("setting the encoders")
    await work.send(Zero(position, 0.0, 0.0, at_switch=homing))
    await work.recorded(0.1)
    newest = work.loop.ring.newest()
    q = math.nan if newest is None else float(newest[INDEX["q"]])
    if not abs(q - position) <= NEAR_RAD:
        raise StepFailedError(
            f"the joint reads {q:.4f} rad after it was set to {position:.4f}: hold it still and try again"
        )
    if homing:
        await work.ask("Turn the joint back to its middle, and confirm", SLACK)
    await work.let_go()
    how = "the end switch" if homing else "its zero mark"
    return Finding(
        True, f"the joint's encoder counts from {how}", (Figure("joint position that was set", position, "rad"),)
    )
