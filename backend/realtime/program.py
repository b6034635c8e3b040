"""Programs of the loop as plain data: modes, segments, tunings, touch, and causes of transitions."""

import math
from collections.abc import Collection
from dataclasses import dataclass
from enum import StrEnum

from backend.control import STEP_BRAKING_S, ZERO_VOLTS_S
from backend.errors import check_range
from backend.realtime.modes import LEGAL, CommandRejectedError, Mode
from plant import Obstacle

# Set touch -----------------------------------------------------------------------------------------
#
# What is asked of touch, and what is told of it, as plain data.


CONTACT_MIN_N, CONTACT_MAX_N = 1.0, 30.0
"""Force that may count as a contact [N]: with less, the estimate's own error in a fast move could."""

NEIGHBOUR = 0.25
"""Points nearer to each other than this [N·m/rad] are one, and the newer counts."""

SIGMAS = 6.0
"""The least force of a contact, in standard deviations of the estimate at rest."""


@dataclass(frozen=True)
class ConfigureContactDetection:
    """What the estimate of the outside force has learned, and from what force on [N] a contact is reacted to, 0: never.

    ``bias`` are points of S [N·m/rad], rising, and the force [N] that is estimated there with nothing outside.
    """

    bias: tuple[tuple[float, float], ...] = ()
    contact_N: float = 0.0


@dataclass(frozen=True)
class ContactDetected:
    """An outside force estimated at ``F_ext_hat`` [N] was a contact, as ``contact_N`` [N] says: the joint gives way."""

    tick: int
    F_ext_hat: float
    contact_N: float


@dataclass(frozen=True)
class BiasLost:
    """The motors' zeros were found anew: what the outside force had learned is gone, and nothing is given way to."""

    tick: int


# Set tuning ----------------------------------------------------------------------------------------
#
# All gains of the cascade, as plain data: a command of its own, and part of a program that changes
# them.


@dataclass(frozen=True)
class EntryGains:
    """Gains of the two outer loops at one point of the bank, scaled for the decoupler (erratum E3)."""

    S_nominal: float
    k_p_q: float
    k_i_q: float
    k_r_q: float
    k_p_S: float
    k_i_S: float
    k_r_S: float


@dataclass(frozen=True)
class MotorGains:
    """Gains of the inner I-PD loops (table 2)."""

    k_p: float
    k_i: float
    k_d: float
    t_f: float


@dataclass(frozen=True)
class SetTuning:
    """Replace all gains at once, bumpless: the motor voltages do not jump.

    The service computes gains from models and λ; the loop only applies them. ``interpolate`` chooses between gain
    scheduling and switching with hysteresis when there is more than one entry. ``u_plan`` [V] is the voltage limit of
    time-optimal motion, 0 for lambda motion. ``k_ext`` [1]: share of the outside force that is rejected by
    feed-forward, where its bias was learned.
    """

    lam_q: float
    lam_S: float
    motor_A: MotorGains
    motor_B: MotorGains
    entries: tuple[EntryGains, ...]
    interpolate: bool
    u_plan: float = 0.0
    k_ext: float = 0.0


# Program -------------------------------------------------------------------------------------------
#
# What the loop can play by itself: references over time, an excitation, an external push.
#
# A program is plain data, sent whole before it starts, so that its timing is the loop's own and no
# message has to arrive in time while it plays.


MAX_SEGMENTS = 1000
"""Most segments of a program: forty packets, each taken in a tick of its own."""

MAX_TUNINGS = 50
"""Most changes of the tuning in a program, each a packet of its own."""

MAX_WALLS = 50
"""Most changes of the obstacle in a program."""

MAX_TOUCHES = 200
"""Most changes in a program of what is given way to."""


class Law(StrEnum):
    """Which control law a program runs under."""

    CASCADE = "cascade"
    COMPLIANCE = "compliance"
    SINGLE_LOOP = "single-loop"
    FEEDBACK_LINEARIZATION = "feedback-linearization"
    FORCE_HOLD = "force_hold"
    MOTOR_STEPS = "motor_steps"
    TENSION_SWEEP = "tension_sweep"


IDENTIFYING = (Law.FORCE_HOLD, Law.MOTOR_STEPS, Law.TENSION_SWEEP)
"""Laws that move the motors below the cascade, in the mode IDENTIFY."""


def program_mode(law: Law) -> Mode:
    """Return the mode in which a program of this law plays."""
    return Mode.IDENTIFY if law in IDENTIFYING else Mode.EXPERIMENT


def may_start_from(law: Law, mode: Mode) -> bool:
    """Whether a program of this law may start from a mode.

    Under ``COMPLIANCE`` from pretension only: no joint loop brings the joint gently to where the pushes begin.
    """
    return program_mode(law) in LEGAL[mode] and (law is not Law.COMPLIANCE or mode is Mode.PRETENSION)


class Shape(StrEnum):
    """How a segment moves from the previous segment's values to its own."""

    STEP = "step"
    RAMP = "ramp"
    SINE = "sine"
    SWEEP = "sweep"
    PRBS = "prbs"
    MULTISINE = "multisine"


OSCILLATING = (Shape.SINE, Shape.SWEEP, Shape.PRBS, Shape.MULTISINE)
"""Shapes that move around the previous values, with the difference to their own as amplitude."""


@dataclass(frozen=True)
class ContactDetection:
    """What a program does about contacts from a segment on.

    An outside force above ``contact_N`` [N] ends what is played up to the next change of this: for the rest of that
    time the joint gives way, and then the program goes on. 0 is no contact of the program's own. ``learns``: what the
    estimate reads as the segment begins, at rest before it, is what it reads with nothing outside.
    """

    contact_N: float = 0.0
    learns: bool = False


@dataclass(frozen=True)
class Segment:
    """One stretch of a program.

    ``STEP`` jumps to the values at once and holds them; ``RAMP`` moves linearly and arrives at the end;
    ``SINE`` oscillates around the previous values with the difference as amplitude and ``period_s``; ``SWEEP`` likewise
    from ``period_s`` to ``period_end_s``, its frequency growing or falling by the same factor in equal times;
    ``PRBS`` is a maximum-length sequence of a register of ``count`` bits with chips of ``period_s``; ``MULTISINE`` the
    sum of the first ``count`` harmonics of ``period_s``, divided by its largest value ``peak``. After the last three
    the references are back where they were before. ``load_A`` and ``load_B`` [N·m] load the motors' shafts, for the
    whole of the segment whatever its shape. From its first tick on ``tuning`` is in force, a number in the program's
    ``tunings`` from 1 on; 0 leaves what is. So are ``wall``, in the program's ``walls``, and ``touch``, in ``touches``.
    """

    duration_s: float
    q_ref: float
    S_ref: float
    F_push: float = 0.0
    shape: Shape = Shape.STEP
    period_s: float = 1.0
    load_A: float = 0.0
    load_B: float = 0.0
    period_end_s: float = 1.0
    count: int = 0
    peak: float = 1.0
    tuning: int = 0
    wall: int = 0
    touch: int = 0


def final_references(segment: Segment, q_ref: float, S_ref: float) -> tuple[float, float]:
    """Return where a segment leaves the references [rad, N·m/rad] that were here before it."""
    if segment.shape is Shape.SINE:
        share = math.sin(2.0 * math.pi * segment.duration_s / segment.period_s)
    else:
        share = 0.0 if segment.shape in OSCILLATING else 1.0
    return q_ref + share * (segment.q_ref - q_ref), S_ref + share * (segment.S_ref - S_ref)


def require_few(segments: Collection[Segment]) -> None:
    """Raise OutOfRangeError for more segments than a program may have."""
    words = "number of segments"
    check_range(
        "segments", len(segments), minimum=None, maximum=MAX_SEGMENTS, unit="1", remedy="split the program", words=words
    )


NO_WALL = "no wall can be put in this joint's way by command: play it as a dry run"


def require_plant_ability(segment: Segment, *, pushes: bool, loads_shafts: bool) -> None:
    """Raise CommandRejectedError for a push or load that this plant cannot give.

    Raises OutOfRangeError for one that no plant can give.
    """
    check_range("F_push", segment.F_push, None, None, "N")
    if segment.F_push and not pushes:
        raise CommandRejectedError("nothing here pushes the joint by command: push by hand, or play it as a dry run")
    for load in filter(None, (segment.load_A, segment.load_B)):
        if not loads_shafts:
            raise CommandRejectedError("this rig cannot load its motors' shafts by itself: play it as a dry run")
        check_range("load", load, minimum=0.0, maximum=None, unit="N·m", remedy="loads pull as tendons do")


@dataclass(frozen=True)
class Excitation:
    """Binary sequence added to theta_A_ref (method section 4).

    ``levels`` is one period, a character per chip: "+" adds the amplitude, "-" subtracts it. It is repeated
    ``periods`` times.
    """

    amplitude_rad: float
    chip_s: float
    levels: str
    periods: int

    @property
    def duration_s(self) -> float:
        """Length of the whole excitation [s]."""
        return self.periods * len(self.levels) * self.chip_s


@dataclass(frozen=True)
class VoltageStep:
    """Both motors, tendons slack, from rest at ``theta_start`` [rad] under ``u`` [V].

    It ends after ``duration_s``, or as soon as a motor has turned by ``travel_rad``.
    """

    theta_start: float
    u: float
    duration_s: float
    travel_rad: float


@dataclass(frozen=True)
class TensionLeg:
    """Wind both motors evenly to the angles that hold ``tension_N`` in both tendons, within ``duration_s``."""

    tension_N: float
    duration_s: float


@dataclass(frozen=True)
class Program:
    """A law and what it is fed.

    Under ``CASCADE``, ``COMPLIANCE`` and the two baselines the segments are played. Under ``FORCE_HOLD`` (actuator
    identification, figure 5 of the paper) theta_B_ref is 0, a slow force loop holds ``tension_N``, and after
    ``settle_s`` the excitation starts. Under ``MOTOR_STEPS`` both tendons are let slack, and each of ``steps`` starts
    after ``settle_s`` at its angle. Under ``TENSION_SWEEP`` both motors wind to ``tension_N``, wait for ``settle_s``,
    and go through ``legs``. ``tunings`` are those that segments put into use; the one from before the program is back
    after it, however it ends. So are ``walls``, obstacles in the joint's way; None is a way without one. ``touches``
    are what contacts are given way to on the way, and what is learned for it; an operator's are back after it.
    """

    law: Law
    segments: tuple[Segment, ...] = ()
    tension_N: float = 0.0
    settle_s: float = 0.0
    excitation: Excitation | None = None
    steps: tuple[VoltageStep, ...] = ()
    legs: tuple[TensionLeg, ...] = ()
    tunings: tuple[SetTuning, ...] = ()
    walls: tuple[Obstacle | None, ...] = ()
    touches: tuple[ContactDetection, ...] = ()

    @property
    def duration_s(self) -> float:
        """Length of the whole program [s], without the way to where it starts; steps may end earlier."""
        if self.excitation is not None:
            return self.settle_s + self.excitation.duration_s
        if self.steps:
            around_each = self.settle_s + ZERO_VOLTS_S + STEP_BRAKING_S
            return sum(around_each + step.duration_s for step in self.steps)
        if self.legs:
            return self.settle_s + sum(leg.duration_s for leg in self.legs)
        return sum(segment.duration_s for segment in self.segments)
