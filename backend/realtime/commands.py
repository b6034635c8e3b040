"""Commands to the control loop and events from it, as dataclasses."""

from dataclasses import dataclass

from backend.faults import Fault
from backend.realtime.modes import Mode, ModeCause
from backend.realtime.program import BiasLost as BiasLost
from backend.realtime.program import ConfigureContactDetection as ConfigureContactDetection
from backend.realtime.program import ContactDetected as ContactDetected
from backend.realtime.program import EntryGains as EntryGains
from backend.realtime.program import MotorGains as MotorGains
from backend.realtime.program import Program
from backend.realtime.program import SetTuning as SetTuning
from plant import InjectedFault, ManualInput, Obstacle, Side

# Play recording ------------------------------------------------------------------------------------
# Commands to a replay and its events.


SPEED_MIN, SPEED_MAX = 0.25, 4.0
"""Recorded samples per tick: a slower replay repeats samples, a faster one omits some."""


@dataclass(frozen=True)
class PlayRecording:
    """Play or pause, set the speed [samples per tick], or seek; None changes nothing."""

    playing: bool | None = None
    speed: float | None = None
    sample: int | None = None


@dataclass(frozen=True)
class PlayerMoved:
    """State of a replay from ``tick`` on, which shows ``sample``.

    At ``speed`` the tick that comes n later shows the sample ``floor(sample + n * speed)`` of ``samples``, at most the
    last one. While not ``playing`` the sample does not change.
    """

    tick: int
    playing: bool
    speed: float
    sample: float
    samples: int


# Commands ------------------------------------------------------------------------------------------
# Commands to the control loop (imperatives) and its events (past tense).
#
# Both are sent as JSON between the service and the loop process; ``backend.realtime.ipc`` encodes and decodes them.


@dataclass(frozen=True)
class SetMode:
    """Enter a mode; ``run`` is the stored run of the samples from then on, 0 for none."""

    mode: Mode
    run: int = 0


@dataclass(frozen=True)
class SetReferences:
    """Set both references of the cascade."""

    q_ref: float
    S_ref: float


@dataclass(frozen=True)
class RunProgram:
    """Play a program in IDENTIFY (laws IDENTIFYING) or EXPERIMENT.

    The mode returns to PRETENSION when it has ended.
    """

    program: Program
    run: int = 0


@dataclass(frozen=True)
class ApplyPush:
    """Push the joint by an external force [N] for a time [s]; 0 N ends the push.

    Only for a plant that can be pushed (simulator, virtual card).
    """

    F_push: float
    duration_s: float


@dataclass(frozen=True)
class Obstruct:
    """Set an obstacle, None removes it; only for a simulated plant."""

    obstacle: Obstacle | None


@dataclass(frozen=True)
class Inject:
    """Inject a fault, None clears it; only for a simulated plant."""

    injected_fault: InjectedFault | None


@dataclass(frozen=True)
class Zero:
    """Set the positions of joint and motors [rad]; OFF only.

    ``at_switch``: only while the joint holds its end switch.
    """

    q: float
    theta_A: float
    theta_B: float
    at_switch: bool = False


@dataclass(frozen=True)
class TryMotor:
    """Turn one motor ("A" or "B") slightly and back by a small voltage; OFF to OFF."""

    motor: Side


@dataclass(frozen=True)
class TryModule:
    """Hold the pretension and continue to drive briefly after the safety module trips.

    From PRETENSION only.
    """


@dataclass(frozen=True)
class Home:
    """Move the joint to its end switch at ``position`` [rad] and set the zero.

    From OFF to OFF.
    """

    position: float


@dataclass(frozen=True)
class ProveDirections:
    """Confirm that both motors turn as in the wiring file; OFF only.

    The confirmation can be withdrawn in any mode.
    """

    proven: bool = True


@dataclass(frozen=True)
class SwitchDrives:
    """Lock the drives off while people work at the rig, or enable them in OFF.

    While they are off, no motion starts. Locking is accepted in every mode: a motion is stopped hard.
    """

    on: bool


@dataclass(frozen=True)
class SimulateManualInput:
    """Apply a simulated hand to a simulated plant."""

    manual_input: ManualInput


@dataclass(frozen=True)
class Stop:
    """Stop and latch: hard (zero volts at once) or soft (rest under tension first).

    ``detail`` is recorded with the fault: the observation, or who ended what.
    """

    fault: Fault = Fault.STOP_PRESSED
    hard: bool = True
    detail: str = ""


@dataclass(frozen=True)
class Reset:
    """Clear the latched fault if its cause is gone."""


@dataclass(frozen=True)
class Heartbeat:
    """Sign that the service is alive."""


@dataclass(frozen=True)
class Shutdown:
    """Write zero volts, close the plant, end the process."""


Command = (
    SetMode
    | SetReferences
    | SetTuning
    | ConfigureContactDetection
    | RunProgram
    | ApplyPush
    | Inject
    | Obstruct
    | PlayRecording
    | Zero
    | TryMotor
    | TryModule
    | Home
    | ProveDirections
    | SwitchDrives
    | SimulateManualInput
    | Stop
    | Reset
    | Heartbeat
    | Shutdown
)


@dataclass(frozen=True)
class Accepted:
    """The command numbered ``sequence`` was executed in ``tick``."""

    sequence: int
    tick: int


@dataclass(frozen=True)
class Refused:
    """The command numbered ``sequence`` was rejected; nothing changed."""

    sequence: int
    tick: int
    reason: str
    legal: tuple[Mode, ...] = ()


@dataclass(frozen=True)
class ModeChanged:
    """The mode changed."""

    tick: int
    before: Mode
    after: Mode
    cause: ModeCause


@dataclass(frozen=True)
class PretensionReached:
    """Both tendons hold the pretension; the modes with motion are now permitted."""

    tick: int


@dataclass(frozen=True)
class PushReleased:
    """The loop ended an operator's push; ``why`` gives the reason."""

    tick: int
    why: str


@dataclass(frozen=True)
class Stopped:
    """Record of a stop: ticks of its arrival and of zero volts, and the time between."""

    fault: Fault
    hard: bool
    arrived_tick: int
    zero_tick: int
    milliseconds: float
    detail: str = ""


@dataclass(frozen=True)
class RunEnded:
    """A run, or with ``run`` 0 a program without one, ended after its last sample.

    ``completed``: it was not cut short.
    """

    tick: int
    run: int
    completed: bool
    why: ModeCause
    detail: str = ""


@dataclass(frozen=True)
class TuningChanged:
    """A program activated its tuning ``number``, 0 for the one before it; λ in s."""

    tick: int
    number: int
    lam_q: float
    lam_S: float


@dataclass(frozen=True)
class WallChanged:
    """The obstacle changed, None for no obstacle.

    ``number`` is that in the program, 0 for the operator's.
    """

    tick: int
    number: int
    wall: Obstacle | None


@dataclass(frozen=True)
class PlantFailing:
    """The plant cannot be read or written since ``tick``; reported once."""

    tick: int
    reason: str


@dataclass(frozen=True)
class PlantAnswers:
    """The plant has been read and written without failure for a while."""

    tick: int


@dataclass(frozen=True)
class ReadinessChanged:
    """The readiness for pretension changed; also sent at the start.

    ``unready`` says what must precede pretension, empty for nothing. ``drives_off``: the drives are locked off because
    people may be working at the rig.
    """

    tick: int
    unready: str
    drives_off: bool = False


Event = (
    Accepted
    | Refused
    | ModeChanged
    | PretensionReached
    | ContactDetected
    | BiasLost
    | PushReleased
    | Stopped
    | RunEnded
    | TuningChanged
    | WallChanged
    | PlantFailing
    | PlantAnswers
    | PlayerMoved
    | ReadinessChanged
)
