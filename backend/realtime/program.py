"""Programs of the loop as dataclasses, with their tunings and contact detections."""

import math
from collections.abc import Collection
from dataclasses import dataclass
from enum import StrEnum

from backend.control import STEP_BRAKING_S, ZERO_VOLTS_S
from backend.errors import check_range
from backend.realtime import messages
from backend.realtime.modes import LEGAL, CommandRejectedError, Mode
from plant import Obstacle

# Contact detection commands ------------------------------------------------------------------------
# Commands and events of contact detection.


CONTACT_MIN_N, CONTACT_MAX_N = 1.0, 30.0
"""Range of the contact threshold [N]: below, the estimate's error in a fast move could exceed it."""

NEIGHBOUR = 0.25
"""Distance below which two calibration points are merged [N·m/rad]; the newer one counts."""

SIGMAS = 6.0
"""Least contact threshold, in standard deviations of the estimate at rest."""


@dataclass(frozen=True)
class ConfigureContactDetection:
    """Set the calibrated bias and the threshold of contacts [N], 0 for no reaction.

    ``bias`` are points of rising S [N·m/rad] and the force [N] that is estimated there without external force.
    """

    bias: tuple[tuple[float, float], ...] = ()
    contact_N: float = 0.0


@dataclass(frozen=True)
class ContactDetected:
    """The estimated external force ``F_ext_hat`` [N] exceeded ``contact_N`` [N].

    The joint yields.
    """

    tick: int
    F_ext_hat: float
    contact_N: float


@dataclass(frozen=True)
class BiasLost:
    """The motors' zeros were set again: the bias is reset, contact reaction is off."""

    tick: int


# Tuning commands -----------------------------------------------------------------------------------
# All gains of the cascade: a command, and part of programs that change them.


@dataclass(frozen=True)
class EntryGains:
    """Gains of both outer loops at one operating point of the bank.

    Scaled for the decoupler (erratum E3).
    """

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

    The service computes gains from models and λ; the loop only applies them. ``interpolate`` selects interpolation
    instead of switching with hysteresis between several entries. ``u_plan`` [V] is the voltage limit of time-optimal
    motion, 0 for lambda motion. ``k_ext`` [1]: gain of the disturbance rejection, which needs a calibrated bias.
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
# Programs that the loop plays: references over time, an excitation, an external push.
#
# A program is sent completely before it starts, so its timing depends on the loop alone and on no messages.


MAX_SEGMENTS = 1000
"""Most segments of a program: forty packets, each received in its own tick."""

MAX_TUNINGS = 50
"""Most changes of the tuning in a program, each its own packet."""

MAX_WALLS = 50
"""Most changes of the obstacle in a program."""

MAX_CONTACT_DETECTIONS = 200
"""Most changes of the contact detection in a program."""


class Law(StrEnum):
    """Control law of a program."""

    CASCADE = "cascade"
    COMPLIANCE = "compliance"
    SINGLE_LOOP = "single-loop"
    FEEDBACK_LINEARIZATION = "feedback-linearization"
    FORCE_HOLD = "force_hold"
    MOTOR_STEPS = "motor_steps"
    TENSION_SWEEP = "tension_sweep"


IDENTIFYING = (Law.FORCE_HOLD, Law.MOTOR_STEPS, Law.TENSION_SWEEP)
"""Laws that move the motors without the cascade, in the mode IDENTIFY."""


def program_mode(law: Law) -> Mode:
    """Return the mode in which a program of this law plays."""
    return Mode.IDENTIFY if law in IDENTIFYING else Mode.EXPERIMENT


def may_start_from(law: Law, mode: Mode) -> bool:
    """Return whether a program of this law may start from a mode.

    ``COMPLIANCE`` only from pretension: without a position loop nothing moves the joint gently to the start of the
    pushes.
    """
    return program_mode(law) in LEGAL[mode] and (law is not Law.COMPLIANCE or mode is Mode.PRETENSION)


class Shape(StrEnum):
    """Transition of a segment from the previous segment's values to its own."""

    STEP = "step"
    RAMP = "ramp"
    SINE = "sine"
    SWEEP = "sweep"
    PRBS = "prbs"
    MULTISINE = "multisine"


OSCILLATING = (Shape.SINE, Shape.SWEEP, Shape.PRBS, Shape.MULTISINE)
"""Shapes that oscillate around the previous values; the amplitude is the difference to their own."""


@dataclass(frozen=True)
class ContactDetection:
    """Contact detection of a program from a segment on.

    An external force above ``contact_N`` [N] ends the current part up to the next change of contact detection: for the
    rest of that time the joint yields, then the program continues. 0 disables detection. ``calibrates_bias``: the
    estimate at the start of the segment, after rest, is stored as bias.
    """

    contact_N: float = 0.0
    calibrates_bias: bool = False


@dataclass(frozen=True)
class Segment:
    """One segment of a program.

    ``STEP`` jumps to the values and holds them; ``RAMP`` moves linearly and arrives at the end; ``SINE`` oscillates
    around the previous values with the difference as amplitude and ``period_s``; ``SWEEP`` likewise from ``period_s``
    to ``period_end_s``, its frequency changing by the same factor in equal times; ``PRBS`` is a maximum-length sequence
    of a register of ``count`` bits with chips of ``period_s``; ``MULTISINE`` the sum of the first ``count`` harmonics
    of ``period_s``, divided by its largest value ``peak``. After the last three the references return to their values
    before.

    ``load_A`` and ``load_B`` [N·m] load the motors' shafts during the whole segment. ``tuning``, ``wall`` and
    ``contact_detection`` are numbers from 1 in the program's ``tunings``, ``walls`` and ``contact_detections``, active
    from the first tick of the segment; 0 changes nothing.
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
    contact_detection: int = 0


def final_references(segment: Segment, q_ref: float, S_ref: float) -> tuple[float, float]:
    """Return the references [rad, N·m/rad] after a segment, from those before it."""
    if segment.shape is Shape.SINE:
        share = math.sin(2.0 * math.pi * segment.duration_s / segment.period_s)
    else:
        share = 0.0 if segment.shape in OSCILLATING else 1.0
    return q_ref + share * (segment.q_ref - q_ref), S_ref + share * (segment.S_ref - S_ref)


def require_few(segments: Collection[Segment]) -> None:
    """Raise OutOfRangeError for more segments than a program may have."""
    words, remedy = messages.number_of_segments(), messages.split_program()
    check_range("segments", len(segments), minimum=None, maximum=MAX_SEGMENTS, unit="1", remedy=remedy, label=words)


NO_WALL = messages.plant_without_obstacles()


def require_plant_ability(segment: Segment, *, pushes: bool, loads_shafts: bool) -> None:
    """Raise CommandRejectedError for a push or load that this plant cannot apply.

    Raises OutOfRangeError for one that is invalid on any plant.
    """
    check_range("F_push", segment.F_push, None, None, "N")
    if segment.F_push and not pushes:
        raise CommandRejectedError(messages.plant_without_push())
    for load in filter(None, (segment.load_A, segment.load_B)):
        if not loads_shafts:
            raise CommandRejectedError(messages.plant_without_shaft_load())
        check_range("load", load, minimum=0.0, maximum=None, unit="N·m", remedy=messages.load_pulls_tendon())


@dataclass(frozen=True)
class Excitation:
    """Binary sequence added to theta_A_ref (method section 4).

    ``levels`` is one period, a character per chip: "+" adds the amplitude, "-" subtracts it. It is repeated ``periods``
    times.
    """

    amplitude_rad: float
    chip_s: float
    levels: str
    periods: int

    @property
    def duration_s(self) -> float:
        """Duration of the whole excitation [s]."""
        return self.periods * len(self.levels) * self.chip_s


@dataclass(frozen=True)
class VoltageStep:
    """Voltage ``u`` [V] on both motors with slack tendons, from rest.

    It starts at ``theta_start`` [rad] and ends after ``duration_s``, or when a motor has turned by ``travel_rad``.
    """

    theta_start: float
    u: float
    duration_s: float
    travel_rad: float


@dataclass(frozen=True)
class TensionLeg:
    """Wind both motors evenly to ``tension_N`` in both tendons within ``duration_s``."""

    tension_N: float
    duration_s: float


@dataclass(frozen=True)
class Program:
    """Control law with its inputs.

    ``CASCADE``, ``COMPLIANCE`` and both baselines play the segments. ``FORCE_HOLD`` (actuator identification, figure 5
    of the paper): theta_B_ref is 0, a slow force loop holds ``tension_N``, and after ``settle_s`` the excitation
    starts. ``MOTOR_STEPS``: both tendons are slack, and each of ``steps`` starts after ``settle_s`` at its angle.
    ``TENSION_SWEEP``: both motors wind to ``tension_N``, wait for ``settle_s``, and follow ``legs``.

    Segments activate ``tunings``, ``walls`` (obstacles, None for no obstacle) and ``contact_detections`` (contact
    detections); the tuning, obstacle and contact detection from before the program are restored after it, however it
    ends.
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
    contact_detections: tuple[ContactDetection, ...] = ()

    @property
    def duration_s(self) -> float:
        """Duration of the program [s], without the approach to its start.

        Voltage steps may end earlier.
        """
        if self.excitation is not None:
            return self.settle_s + self.excitation.duration_s
        if self.steps:
            around_each = self.settle_s + ZERO_VOLTS_S + STEP_BRAKING_S
            return sum(around_each + step.duration_s for step in self.steps)
        if self.legs:
            return self.settle_s + sum(leg.duration_s for leg in self.legs)
        return sum(segment.duration_s for segment in self.segments)
