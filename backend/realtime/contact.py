"""Contact reaction, manual pushes, and loads and obstacles of a program."""

import math
from contextlib import suppress
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from backend.control import Bounds, CascadeTuning, MotorLoopState, Setpoint, decoupler
from backend.errors import check_range
from backend.realtime import messages
from backend.realtime.commands import ApplyPush, Event, PushReleased, WallChanged
from backend.realtime.gains import ActiveGains
from backend.realtime.modes import CommandRejectedError, Mode
from backend.realtime.motions import Tracking
from backend.realtime.program import (
    CONTACT_MAX_N,
    CONTACT_MIN_N,
    IDENTIFYING,
    MAX_CONTACT_DETECTIONS,
    MAX_WALLS,
    NEIGHBOUR,
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
# Reaction to an external force that counts as a contact: the joint yields until an operator chooses a mode.
#
# The loop reacts within one tick: position loop open, reference at the joint's position. At rest it goes to the lowest
# stiffness. A program is aborted; TAIL_S of what follows still belong to its run.
#
# A program may have its own contact detection (``ContactDetection``): a contact then ends one part, for the rest of
# whose time the joint yields, and the program continues at the time at which it would have continued without. The
# operator's threshold takes precedence.


SETTLING_S = 0.15
"""Time in which the motors only stop the joint, before its stiffness is reduced [s]."""

TAIL_S = 0.5
"""Time for which a program's run continues after a contact, so that it contains the reaction [s]."""

SETTLING_TICKS, TAIL_TICKS = round(SETTLING_S / T_s), round(TAIL_S / T_s)

MAX_POINTS = 64


class ActiveInputs(NamedTuple):
    """Inputs that a program has set and that are active; 0 where it sets none.

    Push [N], loads [N·m], and the numbers of tuning, obstacle and contact detection.
    """

    F_push: float
    load: ShaftLoad
    tuning: int
    obstacle: int
    contact_detection: int


NO_ACTIVE_INPUTS = ActiveInputs(0.0, NO_LOAD, 0, 0, 0)


class Contact:
    """Contact detection and the state of the reaction.

    ``is_active``: the loop is reacting to a contact. ``paused`` is the rest of a program after a contact of its own.
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
        """Set bias and threshold.

        Raises OutOfRangeError, ValueError or CommandRejectedError, without any change.
        """
        check_range("points", len(command.bias), 0, MAX_POINTS, "1", label=messages.number_of_bias_points())
        bias = np.array(command.bias, dtype=np.float64).reshape(-1, 2)
        if not np.all(np.isfinite(bias)) or np.any(np.diff(bias[:, 0]) <= 0.0):
            raise ValueError(messages.bias_not_increasing())
        if len(bias) == 0 and self._tunings.gains.disturbance_feedforward.k_ext > 0.0:
            raise CommandRejectedError(messages.bias_in_use())
        if command.contact_N != 0.0:
            check_range(
                "contact_N",
                command.contact_N,
                minimum=CONTACT_MIN_N,
                maximum=CONTACT_MAX_N,
                unit="N",
                remedy=messages.zero_disables_reaction(),
            )
        self._operator_bias, self._threshold_N = bias, command.contact_N or math.inf
        self._apply_bias()

    def reset(self, tick: int) -> None:
        """Reset bias and threshold after the encoders' zeros have changed."""
        self._tunings.disable_feedforward()
        if len(self._operator_bias) or self._threshold_N != math.inf:
            self._operator_bias, self._threshold_N = np.zeros((0, 2)), math.inf
            self._events.append(BiasLost(tick))
        self.end()

    def require_program(self, program: Program) -> None:
        """Raise CommandRejectedError or OutOfRangeError for impossible contact detections."""
        detections = program.contact_detections
        words = messages.number_of_reaction_changes()
        check_range("touches", len(detections), None, MAX_CONTACT_DETECTIONS, "1", label=words)
        for segment in program.segments:
            if not 0 <= segment.contact_detection <= len(detections):
                raise CommandRejectedError(
                    messages.unknown_contact_detection(number=segment.contact_detection, count=len(detections))
                )
        for detection in detections:
            if detection.contact_N != 0.0:
                check_range(
                    "contact_N",
                    detection.contact_N,
                    minimum=CONTACT_MIN_N,
                    maximum=CONTACT_MAX_N,
                    unit="N",
                    remedy=messages.zero_disables_reaction(),
                )
        if detections and program.law is not Law.CASCADE:
            raise CommandRejectedError(messages.law_without_contact_reaction(law=program.law))
        if self._threshold_N != math.inf and any(detection.contact_N for detection in detections):
            raise CommandRejectedError(messages.contact_reaction_armed(threshold_N=self._threshold_N))

    def begin(self, program: Program) -> None:
        """Store the contact detections of a program, numbered from 1."""
        self._program_detections = program.contact_detections

    def use(self, number: int) -> None:
        """Activate a contact detection of the program.

        Without a calibrated bias no contact is detected.
        """
        detection = self._program_detections[number - 1] if number else ContactDetection()
        if detection.calibrates_bias:
            self._calibrate_bias()
        is_reliable = bool(self._program_bias) and detection.contact_N >= SIGMAS * self._noise_N
        self._program_threshold_N = detection.contact_N if is_reliable and detection.contact_N else math.inf

    def end(self) -> None:
        """Discard the program's bias and threshold; the operator's become active."""
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
        """Use the bias that the program has calibrated, else the operator's."""
        self._step.set_bias(np.array(self._program_bias).reshape(-1, 2) if self._program_bias else self._operator_bias)

    def compute_threshold(self, motion: object) -> float:
        """Return the force [N] of a contact now, inf while none is detected."""
        return (
            min(self._threshold_N, self._program_threshold_N)
            if isinstance(motion, Tracking) and not self.is_active
            else math.inf
        )

    def require_none(self, legal: tuple[Mode, ...]) -> None:
        """Raise CommandRejectedError while the loop reacts to a contact."""
        if self.is_active:
            raise CommandRejectedError(messages.compliant_after_contact(), legal)

    def begin_reaction(self, tick: int) -> bool:
        """Begin the reaction to a contact and report it; return whether it is new."""
        is_new, self.is_active = not self.is_active, True
        if is_new:
            self._events.append(ContactDetected(tick, self._step.F_ext_hat, self._threshold_N))
        return is_new

    def pause(self, program: Program | None, motion: object) -> int:
        """Pause a program after a contact of its own; return for how many ticks.

        0 if the contact is the operator's.
        """
        is_program_contact = abs(self._step.F_ext_hat) <= self._threshold_N
        if program is None or not is_program_contact or self.is_active or not isinstance(motion, Tracking):
            return 0
        player = motion.current.state.player
        ticks, self.paused = _split_program(program, player.position, player.elapsed)
        self.is_active = True
        return max(ticks - 1, 1)  # one tick more reports their end

    def resume(self, paused: Program) -> Program:
        """Return the rest of a program after the reaction to its contact."""
        self.paused, self.is_active, self._program_threshold_N = None, False, math.inf
        return paused


def _split_program(program: Program, position: int, elapsed: int) -> tuple[int, Program]:
    """Return the ticks until the next contact detection, and the program from there.

    ``elapsed`` ticks of the segment at ``position`` have passed. The rest begins with the tuning and the obstacle that
    would be active there.
    """
    segments = program.segments
    ends = range(position + 1, len(segments))
    end = next((index for index in ends if segments[index].contact_detection), len(segments))
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
    """Return a motion that yields at the current position and ends after ``ticks``.

    The ``active`` inputs continue. The joint first stops and then reduces its stiffness: both together would share the
    motors' voltage.
    """
    F_push, (load_A, load_B), number, obstacle, detection = active
    q = min(max(m.q, bounds.q_min), bounds.q_max)
    S = decoupler.measured_stiffness(tuning.decoupler, m.q, m.theta_A, m.theta_B)
    S_now = min(max(S, bounds.S_min), bounds.S_max)
    segments = tuple(
        Segment(
            T_s * count,
            q,
            S_ref,
            F_push,
            load_A=load_A,
            load_B=load_B,
            tuning=number,
            wall=obstacle,
            contact_detection=detection,
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


# Manual push ---------------------------------------------------------------------------------------
# An operator's push on the joint of a plant that can be pushed (the simulator), for a limited time.
#
# The loop ends the push when its duration has elapsed, and when it leaves the modes for manual pushes, so no push
# outlives the page, the service or the control lease of its operator.


PUSH_MAX_S = 10.0
"""Longest push [s]; it can be renewed."""

PUSH_MODES = (Mode.RUN, Mode.COMPLIANCE)
"""Modes in which an operator may push: the joint is under control, and no program applies pushes."""


class ManualDisturbance:
    """Push of an operator; a new one replaces the previous one."""

    def __init__(self, plant: Plant) -> None:
        self._plant = plant
        self._until: int | None = None

    @property
    def is_idle(self) -> bool:
        """Whether there is no manual push."""
        return self._until is None

    def begin(self, command: ApplyPush, tick: int, mode: Mode) -> None:
        """Push from ``tick`` on; 0 N ends the push.

        Raises CommandRejectedError in other modes, OutOfRangeError, and PlantError for a plant that cannot be pushed.
        """
        if command.F_push != 0.0 and mode not in PUSH_MODES:
            raise CommandRejectedError(messages.push_not_in_mode(mode=mode, push_modes=PUSH_MODES))
        check_range("F_push", command.F_push, None, None, "N")
        check_range(
            "duration_s",
            command.duration_s,
            minimum=0.0,
            maximum=PUSH_MAX_S,
            unit="s",
            remedy=messages.repeat_push(),
        )
        if command.F_push == 0.0 and self._until is None:
            return  # a program's push is not the operator's to end
        self._plant.push(command.F_push)
        self._until = tick + round(command.duration_s / T_s) if command.F_push != 0.0 else None

    def step(self, tick: int, mode: Mode) -> tuple[PushReleased, ...]:
        """End the push at the end of its time or of the mode; return the event."""
        if self._until is None or (mode in PUSH_MODES and tick < self._until):
            return ()
        self._until = None
        try:
            self._plant.push(0.0)
        except PlantError:  # a plant that cannot be reached no longer pushes
            return ()
        why = messages.push_duration_elapsed() if mode in PUSH_MODES else messages.push_ended_by_mode(mode=mode)
        return (PushReleased(tick, why),)


# Program push --------------------------------------------------------------------------------------
# Disturbances of a program on a plant that can be pushed, loaded and obstructed.


class ProgramDisturbances:
    """Pushes, loads, obstacles and contact detections of a program on the plant.

    ``F_push`` [N], ``load`` [N·m] and the numbers of obstacle and contact detection are the active ones. A method of
    the plant is called only for a change. The operator's obstacle, number 0, is restored at the end of a program.
    """

    def __init__(self, plant: Plant, events: list[Event], contact: Contact) -> None:
        self._plant = plant
        self._events = events
        self._contact = contact
        self.F_push, self.load, self.obstacle, self.contact_detection = 0.0, NO_LOAD, 0, 0
        self._obstacles: tuple[Obstacle | None, ...] = (None,)  # index 0: the operator's

    def set_obstacle(self, obstacle: Obstacle | None, tick: int) -> None:
        """Set an operator's obstacle, None removes it.

        Raises CommandRejectedError during a program with obstacles and on a plant without, PlantError.
        """
        if len(self._obstacles) > 1:
            raise CommandRejectedError(messages.program_sets_obstacles())
        self._set_obstacle(obstacle, 0, tick)
        self._obstacles = (obstacle,)

    def require_program(self, program: Program) -> None:
        """Raise CommandRejectedError or OutOfRangeError for impossible disturbances.

        Checks the obstacles and the contact detections of the program.
        """
        self._contact.require_program(program)
        obstacles = program.walls
        check_range("walls", len(obstacles), None, MAX_WALLS, "1", label=messages.number_of_obstacle_changes())
        if obstacles and program.law in IDENTIFYING:
            raise CommandRejectedError(messages.law_without_obstacle(law=program.law))
        if obstacles:
            self._require_obstructed()
        for segment in program.segments:
            if not 0 <= segment.wall <= len(obstacles):
                raise CommandRejectedError(messages.unknown_obstacle(number=segment.wall, count=len(obstacles)))

    def begin(self, program: Program) -> None:
        """Store a program's obstacles and contact detections, numbered from 1."""
        self._obstacles = (self._obstacles[0], *program.walls)
        self._contact.begin(program)

    def apply_setpoint(self, setpoint: Setpoint, tick: int) -> None:
        """Apply push, loads, obstacle and contact detection of a setpoint.

        Raises PlantError.
        """
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
        """End all disturbances.

        The operator's obstacle is not restored if the joint is inside it.
        """
        with suppress(PlantError):  # a plant that cannot be reached no longer pushes
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
        """Set push and load to their values after a batch of steps."""
        self.F_push, self.load = F_push, load

    def _set_obstacle(self, obstacle: Obstacle | None, number: int, tick: int) -> None:
        self._require_obstructed().obstacle(obstacle)
        self._events.append(WallChanged(tick, number, obstacle))

    def _require_obstructed(self) -> Obstructed:
        if not isinstance(self._plant, Obstructed):
            raise CommandRejectedError(messages.plant_without_obstacles())
        return self._plant
