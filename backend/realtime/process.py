"""Loop process: its entry point, and the rehearsal before the first deadline."""

import gc
import select
import signal
import socket
import sys
import time
from collections import deque
from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace

from backend.control import NO_REFERENCE
from backend.faults import Fault
from backend.realtime import messages
from backend.realtime.channel import Channel, ChannelClosedError
from backend.realtime.commands import (
    Command,
    Heartbeat,
    ReadinessChanged,
    Refused,
    RunProgram,
    SetMode,
    SetReferences,
    Stop,
    SwitchDrives,
)
from backend.realtime.commissioning_motions import Homing
from backend.realtime.control_loop import Loop
from backend.realtime.gains import build_cascade_tuning
from backend.realtime.ipc import (
    ChannelError,
    Failed,
    FromLoop,
    LongProgram,
    ProgramPart,
    ProgramParts,
    Ready,
    Setup,
    decode_to_loop,
    encode,
)
from backend.realtime.modes import CommandRejectedError, Mode
from backend.realtime.motions import BASELINES, IdleMotion
from backend.realtime.player import PlayerLoop
from backend.realtime.program import Excitation, Law, Program, Segment, SetTuning, TensionLeg, VoltageStep
from backend.realtime.ring_buffer import Ring
from backend.realtime.timing import Pacer, request_real_time
from backend.tuning import collect_plant_knowledge, motor_model
from plant import (
    Card,
    HasWiring,
    ParameterError,
    Plant,
    PlantError,
    PlantParameters,
    Replay,
    Simulator,
    SinewError,
    T_s,
    load_parameters,
    make_plant,
)

# Rehearsal -----------------------------------------------------------------------------------------
# Execute every mode once on a simulator, so that nothing is compiled or loaded after the first real deadline.


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


class WarmUpError(SinewError):
    """The loop fails on the simulator with these parameters and this tuning."""


def warm_up(parameters: PlantParameters, tuning: SetTuning) -> None:
    """Execute pretension, run, compliance, all programs, soft stop and homing.

    Raises WarmUpError.
    """
    ring = Ring.create(capacity=16)
    loop = Loop(Simulator(parameters), parameters, ring, tuning)
    plain = replace(tuning, k_ext=0.0)  # no bias is calibrated here
    S_ref = 0.5 * (loop.bounds.S_min + loop.bounds.S_max)
    _send_command(loop, SetMode(Mode.PRETENSION))
    _run_pretension(loop)
    for program in _IDENTIFYING:
        _send_command(loop, RunProgram(program))
        _run_while(loop, Mode.IDENTIFY)
        _run_pretension(loop)
    # The single loop does not accept every λ of the cascade; any λ in its range runs the same compiled code.
    short = 4.0 * min(motor_model(parameters, "A").T_m, motor_model(parameters, "B").T_m)
    brisk = replace(plain, lam_q=min(tuning.lam_q, short), lam_S=min(tuning.lam_S, short))
    for law in (Law.CASCADE, *BASELINES):
        _send_command(loop, brisk if law in BASELINES else plain)
        _send_command(loop, RunProgram(Program(law, (Segment(duration_s=0.005, q_ref=0.0, S_ref=S_ref),))))
        _run_while(loop, Mode.EXPERIMENT)
        _run_pretension(loop)
    for command in (SetMode(Mode.RUN), SetReferences(0.0, S_ref), plain, SetMode(Mode.COMPLIANCE), Stop(hard=False)):
        _send_command(loop, command)
        loop.tick()
    loop.close()
    ring.close()
    _warm_up_homing(parameters, tuning)


def _warm_up_homing(parameters: PlantParameters, tuning: SetTuning) -> None:
    """Execute a homing step, which calls all compiled code of commissioning motions."""
    plant = Simulator(parameters)
    gains = build_cascade_tuning(tuning, collect_plant_knowledge(parameters))
    homing = Homing(
        motor_loops=IdleMotion(gains.motors).get_motor_loops(),
        target=NO_REFERENCE,
        m=plant.read(),
        position=0.5,
        ratio=1.0,
        at_end=lambda: False,
    )
    homing.step(gains, plant.read())


def _send_command(loop: Loop, command: Command) -> None:
    loop.handle(0, command)
    for event in loop.drain_events():
        if isinstance(event, Refused):
            raise WarmUpError(messages.rehearsed_command_rejected(command=type(command).__name__, reason=event.reason))


def _run_pretension(loop: Loop) -> None:
    for _ in range(_PRETENSION_TICKS):
        if loop.is_pretension_done:
            return
        loop.tick()
    raise WarmUpError(messages.rehearsal_without_pretension(ticks=_PRETENSION_TICKS, mode=loop.mode))


def _run_while(loop: Loop, mode: Mode) -> None:
    while loop.mode is mode:
        loop.tick()


# Worker --------------------------------------------------------------------------------------------
# The loop process: ``python -m backend.realtime.process RING_FD CHANNEL_FD CARD_FD PARAMETERS``, see ``launching.py``.
#
# It never waits for the service. However it ends, its last action is zero volts; without heartbeat from the service the
# loop stops softly on its own.


SILENCE_S = 0.34
"""Time without a message from the service [s] after which the loop stops softly. Braking takes 0.14 s, so the joint
stands within 0.5 s of the last message."""

MAX_COUNTED_GAP_S = 0.02
"""Longest time between two ticks that counts as silence [s]: if the whole machine pauses, no message can arrive."""

COMMANDS_PER_TICK = 4
BYTES_PER_TICK = 4000
"""Limits per tick; the rest waits for the next one, so that no burst of commands and no long program delays a tick."""

_MOTIONLESS_MODES = (Mode.OFF, Mode.TRIPPED)


class Worker:
    """One loop and its channel to the service.

    ``drives_off``: people may be working at the rig already.
    """

    def __init__(self, plant: Plant, loop: Loop | PlayerLoop, channel: Channel, *, drives_off: bool = False) -> None:
        self._plant = plant
        self._loop = loop
        self._channel = channel
        self._outbox: deque[bytes] = deque()
        self._silence_s = 0.0
        self._tick = 0
        self._service_alive = True
        self._terminated = False
        self._readiness: tuple[str, bool] | None = None
        self._parts = ProgramParts()
        self._paused = False
        if drives_off:  # a drive-enable line that stays on still leaves the loop locked
            loop.handle(0, SwitchDrives(on=False))

    def terminate(self) -> None:
        """End after the current tick (SIGTERM)."""
        self._terminated = True

    def queue_message(self, message: FromLoop) -> None:
        """Queue a message to the service, which is sent when the channel accepts it."""
        self._outbox.append(encode(message))

    def run(self, pacer: Pacer, now_s: Callable[[], float] = time.monotonic) -> None:
        """Run until terminated, or until the service is lost and the outputs are zero."""
        before_s = now_s()
        while not (self._terminated or self._loop.finished or self._is_abandoned()):
            lateness_s = pacer.met() if self._plant.paces_loop else pacer.wait()
            begun_s = now_s()
            self._silence_s += min(begun_s - before_s, MAX_COUNTED_GAP_S)
            before_s = begun_s
            self._receive_commands()
            if self._paused:
                pacer.resume()
                self._paused = False
            self._loop.tick(lateness_s, pacer.overruns)
            self._tick += 1
            if (readiness := self._loop.readiness) != self._readiness:
                self._readiness = readiness
                # before the reply to the command that changed it
                self.queue_message(ReadinessChanged(self._tick, *readiness))
            for event in self._loop.drain_events():
                self.queue_message(event)
            if self._outbox:
                self._send()

    def _is_abandoned(self) -> bool:
        return not self._service_alive and self._loop.mode in _MOTIONLESS_MODES

    def _receive_commands(self) -> None:
        try:
            received = 0
            for _ in range(COMMANDS_PER_TICK):
                packet = self._channel.receive() if received < BYTES_PER_TICK else None
                if packet is None:
                    break
                self._silence_s = 0.0
                received += len(packet)
                self._handle_packet(packet)
        except ChannelClosedError:
            self._service_alive = False
        lost = self._silence_s > SILENCE_S or not self._service_alive
        if lost and self._loop.mode not in (*_MOTIONLESS_MODES, Mode.STOPPING):
            self._loop.handle(0, Stop(Fault.SERVICE_LOST, hard=False))

    def _handle_packet(self, packet: bytes) -> None:
        try:
            sequence, message = decode_to_loop(packet)
        except ChannelError as error:
            self.queue_message(Refused(error.sequence, self._tick, error.message))
            return
        match message:
            case Heartbeat():
                pass
            case Setup():
                self.queue_message(Refused(sequence, self._tick, messages.set_up_already()))
            case ProgramPart():
                self._parts.add(sequence, message)
            case LongProgram():
                try:
                    self._loop.handle(sequence, self._parts.whole(sequence, message))
                except CommandRejectedError as refused:
                    self.queue_message(Refused(sequence, self._tick, refused.message))
            case command:
                self._loop.handle(sequence, command)
                # The proof test of the watchdog may have run, at zero volts, which takes time.
                self._paused = self._paused or (isinstance(command, SwitchDrives) and command.on)

    def _send(self) -> None:
        try:
            while self._outbox and self._channel.send(self._outbox[0]):
                self._outbox.popleft()
        except ChannelClosedError:
            self._service_alive = False
            self._outbox.clear()


def _receive_setup(channel: Channel) -> Setup:
    select.select([channel], [], [])
    packet = channel.receive()
    if packet is None:
        raise ChannelError(messages.woken_without_message())
    _, message = decode_to_loop(packet)
    if not isinstance(message, Setup):
        raise ChannelError(messages.first_message_not_setup(message_type=type(message).__name__))
    return message


def _run_loop(ring: Ring, channel: Channel, card: Card) -> None:
    setup = _receive_setup(channel)
    parameters = load_parameters(setup.parameters).with_identified(setup.identified)
    plant = make_plant(
        setup.plant, parameters, setup.seed, card, setup.commissioning_results, drives_off=setup.drives_off
    )
    warm_up(parameters, setup.tuning)
    # These take a while, so they precede opening: an opened card's watchdog waits for the first tick.
    gc.collect()
    gc.freeze()
    gc.disable()
    granted = request_real_time()
    if isinstance(plant, Replay):
        loop: Loop | PlayerLoop = PlayerLoop(plant.recording, ring)
    else:
        loop = Loop(plant, parameters, ring, setup.tuning)
    try:
        worker = Worker(plant, loop, channel, drives_off=setup.drives_off)
        signal.signal(signal.SIGTERM, lambda *_: worker.terminate())
        worker.queue_message(Ready(granted, plant.description, plant.wired if isinstance(plant, HasWiring) else ""))
        worker.run(Pacer(T_s))
    finally:
        loop.close()


def main() -> int:
    """Run the loop on the descriptors of the command line; return the exit status."""
    # Ctrl-C and the closing of a terminal reach every process: the service decides and commands this one.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGHUP, signal.SIG_IGN)
    ring = Ring.attach(int(sys.argv[1]))
    channel = Channel(socket.socket(fileno=int(sys.argv[2])))
    with suppress(Exception):  # an error is reported when the parameters are needed
        Simulator(load_parameters(sys.argv[4]))  # loads compiled code while the service is starting
    try:
        _run_loop(ring, channel, Card(int(sys.argv[3])))
    except ChannelClosedError:
        return 0
    except (PlantError, ParameterError) as error:
        # Not a programming error: the service reports the message.
        channel.send(encode(Failed(str(error))))
        return 1
    except Exception as error:
        channel.send(encode(Failed(f"{type(error).__name__}: {error}")))
        raise
    return 0


if __name__ == "__main__":
    sys.exit(main())
