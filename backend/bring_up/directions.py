"""Which way each motor turns, found with a little voltage before any loop is closed on it.

With the joint free, a motor that winds its tendon makes both tensions rise and takes the joint to its own side (A to
+q); one that unwinds does the opposite. So tensions and joint tell what really moved, whatever the wiring says.
"""

import math
from dataclasses import dataclass

import numpy as np

from backend.bring_up.work import Figure, Finding, StepFailedError, Work, known
from backend.realtime.commands import TryMotor
from backend.realtime.commissioning_motions import COAST_S, TRIAL_MAX_V
from backend.realtime.program import Mode
from backend.sample import INDEX
from plant.dynamics import elongation
from plant.interface import T_s
from plant.manual_input import Hand
from plant.parameters import SIDES, Side

START_N = 2.0
START_RANGE_N = (0.8, 5.0)
"""Tensions from which both ways can be told [N]: neither slack nor far from it."""

TURNED_RAD, JOINT_RAD, TENSION_N = 0.05, 0.003, 0.15
"""So much of a change counts: 64 counts of a motor's encoder, 2 of the joint's, 3 standard deviations of a load cell
that has not even been averaged."""

_TRIAL_S = 4.0


@dataclass(frozen=True)
class Seen:
    """Changes while one motor got a positive voltage: of its own encoder and the other's [rad], joint, mean tension."""

    motor: str
    own: float
    other: float
    q: float
    F: float


async def direction(work: Work) -> Finding:
    """Try both motors in turn and say what is wrong with the wiring, if anything."""
    r_m = work.parameters.geometry.r_m
    theta_A, theta_B = (elongation(work.parameters.identified_spring(side), START_N) / r_m for side in SIDES)
    low, high = START_RANGE_N
    await work.drives_off()
    await work.ask(
        f"Turn both motors by hand until both load cells read some {START_N:g} N, take your hands off, and confirm: "
        "the drives come on",
        Hand(theta_A=theta_A, theta_B=theta_B),
    )
    await work.let_go()
    F_A, F_B = await work.mean("F_A", "F_B")
    if not (low <= F_A <= high and low <= F_B <= high):
        raise StepFailedError(
            f"the tendons hold {F_A:.1f} N and {F_B:.1f} N, {low:g} to {high:g} N are asked for: wind them by hand"
        )
    await work.drives_on()
    seen = [await _tried(work, "A"), await _tried(work, "B")]
    figures = [
        figure
        for tried in seen
        for figure in (
            Figure(f"motor {tried.motor} turned by", known(tried.own), "rad"),
            Figure(f"joint moved by, with motor {tried.motor}", known(tried.q), "rad"),
            Figure(f"tensions rose by, with motor {tried.motor}", known(tried.F), "N"),
        )
    ]
    problems = [problem for tried in seen for problem in judged(tried)]
    text = "; ".join(dict.fromkeys(problems)) or "both motors turn as the wiring says"
    return Finding(not problems, text, tuple(figures))


async def _tried(work: Work, motor: Side) -> Seen:
    work.phase(f"motor {motor}")
    first = work.loop.ring.count
    await work.recorded(0.2)
    began = work.loop.ring.count
    work.tried_motors = True
    await work.send(TryMotor(motor))
    # Both ends are seen in the samples: that it began, and that it is over.
    await work.loop.advance_until(lambda: work.loop.ring.count > began + round(0.1 / T_s), 1.0)
    await work.loop.advance_until(lambda: work.mode is not Mode.IDENTIFY, _TRIAL_S)
    if work.mode is not Mode.OFF:
        raise StepFailedError(f"the loop stopped while motor {motor} was tried: it tells why; reset it, and try again")
    rows = work.since(first)
    u = rows[:, INDEX[f"u_{motor}"]]
    out = int(np.argmax(u))
    if not 0.0 < u[out] <= TRIAL_MAX_V + 1e-9:
        raise StepFailedError(f"motor {motor} was not given any voltage: try again")
    top = rows[out + round(0.25 * COAST_S / T_s) : out + round(COAST_S / T_s)]
    rest = rows[: round(0.2 / T_s)]
    change = top.mean(axis=0) - rest.mean(axis=0)
    other = "B" if motor == "A" else "A"
    return Seen(
        motor,
        float(change[INDEX[f"theta_{motor}"]]),
        float(change[INDEX[f"theta_{other}"]]),
        float(change[INDEX["q"]]),
        float(change[INDEX["F_A"]] + change[INDEX["F_B"]]) / 2.0,
    )


def judged(seen: Seen) -> list[str]:
    """Return what is wrong with the wiring of one motor, each with the entry to change."""
    motor, other = seen.motor, "B" if seen.motor == "A" else "A"
    if not abs(seen.F) >= TENSION_N and not abs(seen.q) >= JOINT_RAD:
        if max(abs(seen.own), abs(seen.other)) >= TURNED_RAD:
            return [f"motor {motor} turned and neither joint nor tension followed: look at its tendon"]
        return [f"motor {motor} did not turn: look at motor_{motor}.channel, its amplifier and the drive-enable line"]
    if not (abs(seen.F) >= TENSION_N and abs(seen.q) >= JOINT_RAD):
        return [
            f"motor {motor}: joint ({seen.q:.4f} rad) and tensions ({seen.F:.2f} N) do not go together: look at "
            "encoder_q and the load cells with the wiring test"
        ]
    wound = seen.F > 0.0
    moved = "A" if (seen.q > 0.0) is wound else "B"
    problems = []
    if moved != motor:
        problems.append(
            f"the voltage for motor {motor} turned motor {other}: exchange motor_A.channel and motor_B.channel"
        )
    if not wound:
        problems.append(f"motor {moved} lets out its tendon at a positive voltage: turn the sign of motor_{moved}.gain")
    turned, still = (seen.own, seen.other) if moved == motor else (seen.other, seen.own)
    if not math.isfinite(turned):
        problems.append(f"the encoder of motor {moved} gives no number: look at encoder_{moved}.counter and its cable")
    elif abs(turned) < TURNED_RAD and abs(still) >= TURNED_RAD:
        problems.append("the encoders of the motors are exchanged: exchange encoder_A.counter and encoder_B.counter")
    elif abs(turned) < TURNED_RAD:
        problems.append(f"the encoder of motor {moved} stands still: look at encoder_{moved}.counter and its cable")
    elif (turned > 0.0) is not wound:
        problems.append(f"the encoder of motor {moved} goes backwards: turn the sign of encoder_{moved}.direction")
    return problems
