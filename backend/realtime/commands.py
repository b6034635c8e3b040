"""Commands to the loop and its events, as plain data."""

from dataclasses import dataclass

from backend.faults import Fault
from backend.realtime.modes import Mode, Why
from backend.realtime.program import BiasLost as BiasLost
from backend.realtime.program import ConfigureContactDetection as ConfigureContactDetection
from backend.realtime.program import ContactDetected as ContactDetected
from backend.realtime.program import EntryGains as EntryGains
from backend.realtime.program import MotorGains as MotorGains
from backend.realtime.program import Program
from backend.realtime.program import SetTuning as SetTuning
from plant import Broken, ManualInput, Obstacle, Side

# Play recording ------------------------------------------------------------------------------------
#
# What is asked of a recording that is played, and what is told of it, as plain data.


SPEED_MIN, SPEED_MAX = 0.25, 4.0
"""Samples of the recording for each tick: slower repeats samples, faster leaves some out."""


@dataclass(frozen=True)
class PlayRecording:
    """Play or pause, set the speed [samples per tick], go to a sample; None leaves a thing as it is."""

    playing: bool | None = None
    speed: float | None = None
    sample: int | None = None


@dataclass(frozen=True)
class PlayerMoved:
    """From ``tick`` on, which shows ``sample``, a recording of ``samples`` plays at ``speed``, or stands there.

    While it plays, the tick that comes n later shows the sample ``floor(sample + n * speed)``, at most the last one.
    """

    tick: int
    playing: bool
    speed: float
    sample: float
    samples: int


# Commands ------------------------------------------------------------------------------------------
#
# What may be asked of the loop (imperatives) and what it tells (past tense), as plain data.
#
# Both travel as JSON between the service and the loop process; ``backend.realtime.ipc`` writes and
# reads them.


@dataclass(frozen=True)
class SetMode:
    """Move to a mode; ``run`` is the stored run that the samples from there on belong to, 0 for none."""

    mode: Mode
    run: int = 0


@dataclass(frozen=True)
class SetReferences:
    """New references of the cascade, both at once."""

    q_ref: float
    S_ref: float


@dataclass(frozen=True)
class RunProgram:
    """Play a program in IDENTIFY (laws IDENTIFYING) or EXPERIMENT; back to PRETENSION when it has ended."""

    program: Program
    run: int = 0


@dataclass(frozen=True)
class ApplyPush:
    """Push the joint by an external force [N] for a time [s], where the plant can (the simulator); 0 N lets go."""

    F_push: float
    duration_s: float


@dataclass(frozen=True)
class Obstruct:
    """Put a wall in the joint's way where the plant takes one (the simulator); None takes it away."""

    obstacle: Obstacle | None


@dataclass(frozen=True)
class Inject:
    """Break something where the plant can (the simulator), to try a reaction; None mends it."""

    broken: Broken | None


@dataclass(frozen=True)
class Zero:
    """Say where joint and motors stand [rad]; OFF only. ``at_switch``: while the joint holds its end switch."""

    q: float
    theta_A: float
    theta_B: float
    at_switch: bool = False


@dataclass(frozen=True)
class TryMotor:
    """Turn one motor ("A" or "B") a little, by a small voltage that rises, and back; from OFF to OFF."""

    motor: Side


@dataclass(frozen=True)
class TryModule:
    """Hold the pretension, and keep commanding for a moment once the safety module trips; from PRETENSION only."""


@dataclass(frozen=True)
class Home:
    """Drive the joint to its end switch, which holds it at ``position`` [rad], and take its zero there; OFF to OFF."""

    position: float


@dataclass(frozen=True)
class ProveDirections:
    """Both motors turn as the wiring says: the plant may be controlled; OFF only. Withdrawn in any mode."""

    proven: bool = True


@dataclass(frozen=True)
class SwitchDrives:
    """Take the drives away while hands are at the rig, or give them back, in OFF only. Off, nothing starts.

    To take them away is refused in no mode: what moves is stopped hard.
    """

    on: bool


@dataclass(frozen=True)
class SimulateManualInput:
    """Let a hand act on a plant that is computed, as a person would at a rig."""

    hand: ManualInput


@dataclass(frozen=True)
class Stop:
    """Stop and latch: hard (zero volts at once) or soft (joint to rest under tension, then zero volts).

    ``detail`` is put on record with the fault: what was seen, or who ended what.
    """

    fault: Fault = Fault.STOP_PRESSED
    hard: bool = True
    detail: str = ""


@dataclass(frozen=True)
class Reset:
    """Clear the latched fault, if its cause is gone."""


@dataclass(frozen=True)
class Heartbeat:
    """The service is alive."""


@dataclass(frozen=True)
class Shutdown:
    """Zero volts, close the plant, end the process."""


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
    """The command numbered ``sequence`` was carried out in ``tick``."""

    sequence: int
    tick: int


@dataclass(frozen=True)
class Refused:
    """The command numbered ``sequence`` was not carried out; nothing changed."""

    sequence: int
    tick: int
    reason: str
    legal: tuple[Mode, ...] = ()


@dataclass(frozen=True)
class ModeChanged:
    """The loop moved between modes."""

    tick: int
    before: Mode
    after: Mode
    cause: Why


@dataclass(frozen=True)
class PretensionReached:
    """Both tendons hold the pretension: the moves towards motion are granted from here on."""

    tick: int


@dataclass(frozen=True)
class PushReleased:
    """The loop has let go of a push that was ordered, by itself, and ``why``."""

    tick: int
    why: str


@dataclass(frozen=True)
class Stopped:
    """The proof of a stop: the tick it arrived, the tick the outputs were zero, and the time between."""

    fault: Fault
    hard: bool
    arrived_tick: int
    zero_tick: int
    milliseconds: float
    detail: str = ""


@dataclass(frozen=True)
class RunEnded:
    """A run or, with ``run`` 0, a program without one ended, after its last sample; ``completed`` if not cut short."""

    tick: int
    run: int
    completed: bool
    why: Why
    detail: str = ""


@dataclass(frozen=True)
class TuningChanged:
    """A program has put its tuning ``number`` into use, 0: the one from before it, which is back; λ in s."""

    tick: int
    number: int
    lam_q: float
    lam_S: float


@dataclass(frozen=True)
class WallChanged:
    """Another wall stands in the joint's way, None: no one; ``number`` is the program's, 0 for the operator's."""

    tick: int
    number: int
    wall: Obstacle | None


@dataclass(frozen=True)
class PlantFailing:
    """The plant cannot be read or written since ``tick``; told once, whatever else is latched."""

    tick: int
    reason: str


@dataclass(frozen=True)
class PlantAnswers:
    """The plant has been read and written without a failure for a while."""

    tick: int


@dataclass(frozen=True)
class ReadinessChanged:
    """``unready`` is what has to come before pretension on what is driven, empty where nothing has; told at start.

    ``drives_off``: the drives are locked off, as hands may be at the rig.
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
