"""Go through every mode once on a simulator, so that nothing is compiled or loaded after the first real deadline."""

from dataclasses import replace

from backend.control.motion_types import NO_REFERENCE
from backend.loop.commands import Command, Refused, RunProgram, SetMode, SetReferences, Stop
from backend.loop.homing import Homing
from backend.loop.loop import Loop
from backend.loop.mode import Mode
from backend.loop.motion import BASELINES, Rest
from backend.loop.program import Excitation, Law, Program, Segment, TensionLeg, VoltageStep
from backend.loop.ring import Ring
from backend.loop.set_tuning import SetTuning
from backend.loop.tuned import tuning_of
from backend.tuning.gains import knowledge
from backend.tuning.models import motor_model
from plant.parameters import PlantParameters
from plant.simulator import Simulator

_PRETENSION_TICKS = 20_000
_IDENTIFYING = (
    Program(
        Law.FORCE_HOLD,
        tension_N=10.0,
        settle_s=0.005,
        excitation=Excitation(amplitude_rad=0.01, chip_s=0.001, levels="+-", periods=1),
    ),
    Program(Law.TENSION_SWEEP, tension_N=10.0, legs=(TensionLeg(tension_N=10.0, duration_s=0.005),)),
    Program(Law.MOTOR_STEPS, steps=(VoltageStep(theta_start=0.0, u=0.1, duration_s=0.005, travel_rad=1.0),)),
)


class RehearsalError(Exception):
    """The loop cannot even work on the simulator with these parameters and this tuning."""


def rehearse(parameters: PlantParameters, tuning: SetTuning) -> None:
    """Run pretension, run, compliance, every kind of program, a soft stop and a homing. Raises RehearsalError."""
    ring = Ring.create(capacity=16)
    loop = Loop(Simulator(parameters), parameters, ring, tuning)
    plain = replace(tuning, k_ext=0.0)  # nothing is learned here
    S_ref = 0.5 * (loop.bounds.S_min + loop.bounds.S_max)
    _order(loop, SetMode(Mode.PRETENSION))
    _pretension(loop)
    for program in _IDENTIFYING:
        _order(loop, RunProgram(program))
        _tick_while(loop, Mode.IDENTIFY)
        _pretension(loop)
    # The single loop does not take each λ of the cascade: any λ of its range calls the same compiled code.
    short = 4.0 * min(motor_model(parameters, "A").T_m, motor_model(parameters, "B").T_m)
    brisk = replace(plain, lam_q=min(tuning.lam_q, short), lam_S=min(tuning.lam_S, short))
    for law in (Law.CASCADE, *BASELINES):
        _order(loop, brisk if law in BASELINES else plain)
        _order(loop, RunProgram(Program(law, (Segment(duration_s=0.005, q_ref=0.0, S_ref=S_ref),))))
        _tick_while(loop, Mode.EXPERIMENT)
        _pretension(loop)
    for command in (SetMode(Mode.RUN), SetReferences(0.0, S_ref), plain, SetMode(Mode.COMPLIANCE), Stop(hard=False)):
        _order(loop, command)
        loop.tick()
    loop.close()
    ring.close()
    _bring_up(parameters, tuning)


def _bring_up(parameters: PlantParameters, tuning: SetTuning) -> None:
    """Step what the interpreter steps; of what is compiled, a homing takes all that the bring-up does."""
    plant = Simulator(parameters)
    gains = tuning_of(tuning, knowledge(parameters))
    homing = Homing(Rest(gains.motors).carry(), NO_REFERENCE, plant.read(), 0.5, 1.0, lambda: False)
    homing.step(gains, plant.read())


def _order(loop: Loop, command: Command) -> None:
    loop.handle(0, command)
    for event in loop.drain_events():
        if isinstance(event, Refused):
            raise RehearsalError(f"{type(command).__name__} refused in rehearsal on the simulator: {event.reason}")


def _pretension(loop: Loop) -> None:
    for _ in range(_PRETENSION_TICKS):
        if loop.pretension_done:
            return
        loop.tick()
    raise RehearsalError(f"pretension was not reached within {_PRETENSION_TICKS} ticks; the mode is {loop.mode}")


def _tick_while(loop: Loop, mode: Mode) -> None:
    while loop.mode is mode:
        loop.tick()
