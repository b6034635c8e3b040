"""Contacts and pushes: compliance after a contact, pushes of an operator, loads and walls of a program."""

import math
from contextlib import suppress
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from backend.control import Bounds, CascadeTuning, MotorLoopState, Setpoint, decoupler
from backend.errors import check_range
from backend.realtime.commands import ApplyPush, Event, PushReleased, WallChanged
from backend.realtime.gains import ActiveGains
from backend.realtime.modes import CommandRejectedError, Mode
from backend.realtime.motions import Tracking
from backend.realtime.program import (
    CONTACT_MAX_N,
    CONTACT_MIN_N,
    IDENTIFYING,
    MAX_TOUCHES,
    MAX_WALLS,
    NEIGHBOUR,
    NO_WALL,
    SIGMAS,
    BiasLost,
    ConfigureContactDetection,
    ContactDetected,
    ContactDetection,
    Law,
    Program,
    Segment,
)
from backend.realtime.shared_state import StepContext
from plant import NO_LOAD, Measurement, Obstacle, Obstructed, Plant, PlantError, ShaftLoad, T_s

# Contact -------------------------------------------------------------------------------------------
#
# What comes of an outside force that is a contact: the joint gives way, until somebody says
# otherwise.
#
# The reaction is the loop's own and takes one tick: position loop open, reference where the joint
# is. Once it stands it goes to the lowest stiffness. A program is played no further; TAIL_S of what
# follows still belong to its run. It stays so until an operator chooses a mode again.
#
# A program may have contacts of its own (``ContactDetection``): they end a part of it, for the rest of whose
# time the joint gives way, and then the program goes on, no later than without. What the operator
# gives way to goes before that.


SETTLING_S = 0.15
"""How long the motors have to themselves for bringing the joint to a stand [s], before it gets soft."""

TAIL_S = 0.5
"""How long a program's run goes on after a contact [s], so that it holds what came of it."""

SETTLING_TICKS, TAIL_TICKS = round(SETTLING_S / T_s), round(TAIL_S / T_s)

MAX_POINTS = 64


class ActiveInputs(NamedTuple):
    """Push [N], loads [N·m] and numbers of tuning, wall and touch as a program has them in force, if any."""

    F_push: float
    load: ShaftLoad
    tuning: int
    obstacle: int
    contact_detection: int


NO_ACTIVE_INPUTS = ActiveInputs(0.0, NO_LOAD, 0, 0, 0)


class Contact:
    """Whether contacts are reacted to, from what force on [N], and whether one has been felt.

    ``paused`` is what of a program is still to be played, where one of its own contacts has ended a part of it.
    """

    def __init__(self, step: StepContext, events: list[Event], tunings: ActiveGains) -> None:
        self.is_active = False
        self.paused: Program | None = None
        self._tunings = tunings
        self._threshold_N = self._program_threshold_N = math.inf
        self._operator_bias: NDArray[np.float64] = np.zeros((0, 2))
        self._program_bias: list[tuple[float, float]] = []
        self._noise_N = math.inf
        self._program_detections: tuple[ContactDetection, ...] = ()
        self._step = step
        self._events = events

    def configure(self, command: ConfigureContactDetection) -> None:
        """Use another bias and threshold.

        Raises OutOfRangeError, ValueError, CommandRejectedError: nothing has changed.
        """
        check_range("points", len(command.bias), 0, MAX_POINTS, "1", words="number of points of the bias")
        bias = np.array(command.bias, dtype=np.float64).reshape(-1, 2)
        if not np.all(np.isfinite(bias)) or np.any(np.diff(bias[:, 0]) <= 0.0):
            raise ValueError("the bias of the outside force is to rise in S from point to point: it was left as it is")
        if len(bias) == 0 and self._tunings.gains.disturbance_feedforward.k_ext > 0.0:
            raise CommandRejectedError("pushes are rejected by what was learned: set k_ext to 0 before it is forgotten")
        if command.contact_N != 0.0:
            check_range(
                "contact_N",
                command.contact_N,
                minimum=CONTACT_MIN_N,
                maximum=CONTACT_MAX_N,
                unit="N",
                remedy="0 N reacts to nothing",
            )
        self._operator_bias, self._threshold_N = bias, command.contact_N or math.inf
        self._apply_bias()

    def reset(self, tick: int) -> None:
        """Reset bias and threshold, as the encoders' zeros have changed."""
        self._tunings.disable_feedforward()
        if len(self._operator_bias) or self._threshold_N != math.inf:
            self._operator_bias, self._threshold_N = np.zeros((0, 2)), math.inf
            self._events.append(BiasLost(tick))
        self.end()

    def require_program(self, program: Program) -> None:
        """Raise CommandRejectedError or OutOfRangeError for a program's own contacts that cannot be given way to."""
        detections = program.touches
        words = "number of changes of what is given way to"
        check_range("touches", len(detections), None, MAX_TOUCHES, "1", words=words)
        for segment in program.segments:
            if not 0 <= segment.touch <= len(detections):
                raise CommandRejectedError(f"a segment wants touch {segment.touch} of the program's {len(detections)}")
        for detection in detections:
            if detection.contact_N != 0.0:
                check_range(
                    "contact_N",
                    detection.contact_N,
                    minimum=CONTACT_MIN_N,
                    maximum=CONTACT_MAX_N,
                    unit="N",
                    remedy="0 N reacts to nothing",
                )
        if detections and program.law is not Law.CASCADE:
            raise CommandRejectedError(f"a {program.law} program gives way to nothing: play it by the cascade")
        if self._threshold_N != math.inf and any(detection.contact_N for detection in detections):
            raise CommandRejectedError(
                f"the joint gives way to contacts from {self._threshold_N:g} N on, and stays so: that would end this "
                "program at its first contact. Have it give way to none first, the program gives way by itself"
            )

    def begin(self, program: Program) -> None:
        """Be ready for a program's touches, numbered from 1 on."""
        self._program_detections = program.touches

    def use(self, number: int) -> None:
        """Give way to what a program's touch says from now on; where nothing was learned, to nothing."""
        detection = self._program_detections[number - 1] if number else ContactDetection()
        if detection.learns:
            self._calibrate_bias()
        is_reliable = bool(self._program_bias) and detection.contact_N >= SIGMAS * self._noise_N
        self._program_threshold_N = detection.contact_N if is_reliable and detection.contact_N else math.inf

    def end(self) -> None:
        """Forget what a program has learned and given way to: what the operator did is in force."""
        self.paused, self._program_threshold_N, self._program_bias, self._noise_N, self._program_detections = (
            None,
            math.inf,
            [],
            math.inf,
            (),
        )
        self._apply_bias()

    def _calibrate_bias(self) -> None:
        S, F, std = self._step.rest_statistics
        if not math.isfinite(F + std):
            return
        self._noise_N = std if not self._program_bias else max(std, self._noise_N)
        self._program_bias = sorted(
            [*(point for point in self._program_bias if abs(point[0] - S) >= NEIGHBOUR), (S, F)]
        )
        self._apply_bias()

    def _apply_bias(self) -> None:
        """Take off what a program has learned itself, else what the operator has."""
        self._step.set_bias(np.array(self._program_bias).reshape(-1, 2) if self._program_bias else self._operator_bias)

    def compute_threshold(self, motion: object) -> float:
        """Force [N] from which on a contact counts now; inf where none does, or one is being reacted to."""
        return (
            min(self._threshold_N, self._program_threshold_N)
            if isinstance(motion, Tracking) and not self.is_active
            else math.inf
        )

    def require_none(self, legal: tuple[Mode, ...]) -> None:
        """Raise CommandRejectedError while one is being reacted to."""
        if self.is_active:
            raise CommandRejectedError("the joint gives way to a contact: choose a mode to go on, then move it", legal)

    def begin_reaction(self, tick: int) -> bool:
        """Begin the reaction to a contact and report it; return whether it is new."""
        is_new, self.is_active = not self.is_active, True
        if is_new:
            self._events.append(ContactDetected(tick, self._step.F_ext_hat, self._threshold_N))
        return is_new

    def pause(self, program: Program | None, motion: object) -> int:
        """Take note of a contact that a program gives way to itself; for how many ticks, 0 where it is none."""
        is_program_contact = abs(self._step.F_ext_hat) <= self._threshold_N
        if program is None or not is_program_contact or self.is_active or not isinstance(motion, Tracking):
            return 0
        player = motion.current.state.player
        ticks, self.paused = _split_program(program, player.position, player.elapsed)
        self.is_active = True
        return max(ticks - 1, 1)  # in one more it is told that they are over

    def resume(self, paused: Program) -> Program:
        """Return what of a program is still to be played, now that the joint has given way."""
        self.paused, self.is_active, self._program_threshold_N = None, False, math.inf
        return paused


def _split_program(program: Program, position: int, elapsed: int) -> tuple[int, Program]:
    """Return how many ticks are left up to the next touch, behind ``elapsed`` of a segment, and the rest from there.

    The rest begins with the tuning and the wall that would be in force there.
    """
    segments = program.segments
    ends = range(position + 1, len(segments))
    end = next((index for index in ends if segments[index].touch), len(segments))
    ticks = sum(round(segment.duration_s / T_s) for segment in segments[position:end]) - elapsed
    rest = segments[end:]
    if rest:
        earlier = segments[end::-1]
        tuning = next((segment.tuning for segment in earlier if segment.tuning), 0)
        wall = next((segment.wall for segment in earlier if segment.wall), 0)
        rest = (replace(rest[0], tuning=tuning, wall=wall), *rest[1:])
    return ticks, replace(program, segments=rest)


def make_yielding_motion(
    tuning: CascadeTuning,
    motor_loops: MotorLoopState,
    m: Measurement,
    bounds: Bounds,
    active: ActiveInputs,
    ticks: int = TAIL_TICKS,
) -> Tracking:
    """Return the motion that yields at the present position under the ``active`` inputs; it ends after ``ticks``.

    The joint stops first and gets soft then: both at once would share the motors' voltage.
    """
    F_push, (load_A, load_B), number, obstacle, detection = active
    q = min(max(m.q, bounds.q_min), bounds.q_max)
    S = decoupler.stiffness(tuning.decoupler, m.theta_A, m.theta_B)
    S_now = min(max(S, bounds.S_min), bounds.S_max)
    segments = tuple(
        Segment(
            T_s * count, q, S_ref, F_push, load_A=load_A, load_B=load_B, tuning=number, wall=obstacle, touch=detection
        )
        for count, S_ref in ((min(SETTLING_TICKS, ticks), S_now), (max(ticks - SETTLING_TICKS, 0), bounds.S_min))
    )
    return Tracking(
        tuning=tuning,
        motor_loops=motor_loops,
        m=m,
        bounds=bounds,
        position_loop=False,
        program=Program(Law.COMPLIANCE, segments),
        yields=True,
    )


# Hand push -----------------------------------------------------------------------------------------
#
# A push on the joint that an operator orders, where the plant can push (the simulator): held for a
# time and let go.
#
# The loop itself lets go when the time is over and whenever it leaves the modes in which a hand may
# push, so that no push outlives the page, the service or the control that ordered it.


PUSH_MAX_S = 10.0
"""Longest push [s]: what is to last is ordered again."""

PUSH_MODES = (Mode.RUN, Mode.COMPLIANCE)
"""Modes in which an operator may push: the joint is under control, and no program pushes by itself."""


class ManualDisturbance:
    """At most one push at a time; a new one takes the place of the one before."""

    def __init__(self, plant: Plant) -> None:
        self._plant = plant
        self._until: int | None = None

    @property
    def is_idle(self) -> bool:
        """Whether nothing is pushed by hand."""
        return self._until is None

    def begin(self, command: ApplyPush, tick: int, mode: Mode) -> None:
        """Push from ``tick`` on; 0 N lets go.

        Raises CommandRejectedError in another mode, OutOfRangeError, and PlantError where nothing can push.
        """
        if command.F_push != 0.0 and mode not in PUSH_MODES:
            modes = " and ".join(PUSH_MODES)
            raise CommandRejectedError(
                f"a push takes a joint under the operator's control, in {modes}; the mode is {mode}"
            )
        check_range("F_push", command.F_push, None, None, "N")
        check_range(
            "duration_s",
            command.duration_s,
            minimum=0.0,
            maximum=PUSH_MAX_S,
            unit="s",
            remedy="order it again to push for longer",
        )
        if command.F_push == 0.0 and self._until is None:
            return  # a program's push is not an operator's to let go of
        self._plant.push(command.F_push)
        self._until = tick + round(command.duration_s / T_s) if command.F_push != 0.0 else None

    def step(self, tick: int, mode: Mode) -> tuple[PushReleased, ...]:
        """At the start of a tick: let go when the time is over or the mode is another, and tell so."""
        if self._until is None or (mode in PUSH_MODES and tick < self._until):
            return ()
        self._until = None
        try:
            self._plant.push(0.0)
        except PlantError:  # whoever pushes the plant has let go of it with it
            return ()
        return (PushReleased(tick, "its time is over" if mode in PUSH_MODES else f"the mode is {mode}"),)


# Program push --------------------------------------------------------------------------------------
#
# What a program does to the joint and the shafts, where the plant can push, load and be obstructed.


class ProgramDisturbances:
    """``F_push`` [N], ``load`` [N·m], numbers of the ``wall`` and of the ``touch`` in force by a program.

    What can do none of these is not asked to. The operator's wall, number 0, is back where a program has ended.
    """

    def __init__(self, plant: Plant, events: list[Event], contact: Contact) -> None:
        self._plant = plant
        self._events = events
        self._contact = contact
        self.F_push, self.load, self.obstacle, self.contact_detection = 0.0, NO_LOAD, 0, 0
        self._obstacles: tuple[Obstacle | None, ...] = (None,)  # the operator's first

    def set_obstacle(self, obstacle: Obstacle | None, tick: int) -> None:
        """Put an operator's wall in the joint's way, None takes it away.

        Raises CommandRejectedError while a program puts up its own and on a plant that takes none, PlantError.
        """
        if len(self._obstacles) > 1:
            raise CommandRejectedError("the program puts up walls by itself: wait for its end or stop it")
        self._set_obstacle(obstacle, 0, tick)
        self._obstacles = (obstacle,)

    def require_program(self, program: Program) -> None:
        """Raise CommandRejectedError or OutOfRangeError for walls and contact reactions that are not possible."""
        self._contact.require_program(program)
        obstacles = program.walls
        check_range("walls", len(obstacles), None, MAX_WALLS, "1", words="number of changes of the obstacle")
        if obstacles and program.law in IDENTIFYING:
            raise CommandRejectedError(f"no wall stands while a {program.law} program plays: leave it out")
        if obstacles:
            self._require_obstructed()
        for segment in program.segments:
            if not 0 <= segment.wall <= len(obstacles):
                raise CommandRejectedError(f"a segment wants wall {segment.wall} of the program's {len(obstacles)}")

    def begin(self, program: Program) -> None:
        """Be ready for a program's walls and touches, numbered from 1 on."""
        self._obstacles = (self._obstacles[0], *program.walls)
        self._contact.begin(program)

    def apply_setpoint(self, setpoint: Setpoint, tick: int) -> None:
        """Apply push, loads, obstacle and contact detection of a setpoint. Raises PlantError."""
        if setpoint.contact_detection != self.contact_detection:
            self.contact_detection = setpoint.contact_detection
            self._contact.use(setpoint.contact_detection)
        if setpoint.obstacle != self.obstacle:
            self.obstacle = setpoint.obstacle
            self._set_obstacle(self._obstacles[setpoint.obstacle], setpoint.obstacle, tick)
        self._apply_force_and_load(setpoint.F_push, setpoint.load)

    def get_active_inputs(self, tuning: int) -> ActiveInputs:
        """Return the active inputs, with the number of the ``tuning``."""
        return ActiveInputs(self.F_push, self.load, tuning, self.obstacle, self.contact_detection)

    def _apply_force_and_load(self, F_push: float, load: ShaftLoad) -> None:
        (F_before, load_before), (self.F_push, self.load) = (self.F_push, self.load), (F_push, load)
        if load != load_before:
            self._plant.load(load)
        if F_push != F_before:
            self._plant.push(F_push)

    def end(self, tick: int) -> None:
        """End all disturbances; an operator's obstacle is not restored where the joint is inside it."""
        with suppress(PlantError):  # whoever pushes the plant has let go of it with it
            self._apply_force_and_load(0.0, NO_LOAD)
        self.contact_detection = 0
        self._contact.end()
        operator_obstacle, self._obstacles = self._obstacles[0], self._obstacles[:1]
        if self.obstacle:
            self.obstacle = 0
            try:
                self._set_obstacle(operator_obstacle, 0, tick)
            except PlantError:
                self._obstacles = (None,)
                with suppress(PlantError):
                    self._set_obstacle(None, 0, tick)

    def set_state(self, F_push: float, load: ShaftLoad) -> None:
        """Set push and load as a batch of steps has left them."""
        self.F_push, self.load = F_push, load

    def _set_obstacle(self, obstacle: Obstacle | None, number: int, tick: int) -> None:
        self._require_obstructed().obstacle(obstacle)
        self._events.append(WallChanged(tick, number, obstacle))

    def _require_obstructed(self) -> Obstructed:
        if not isinstance(self._plant, Obstructed):
            raise CommandRejectedError(NO_WALL)
        return self._plant
