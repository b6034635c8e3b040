"""A DAQ card without hardware: the service that NI's device server offers, backed by the simulator.

The real nidaqmx client talks to it through an in-process channel, so what is tried is all of ``plant/daq.py``. Writing
both outputs advances the physics by one period. The registers, watchdog and drive-enable line are those of
``plant/safety_card.py`` and outlive this process. A safety module that has tripped is re-armed by taking the
drive-enable line away, once its cause is gone.
"""

import math
import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace
from typing import Any, NamedTuple, Protocol

import grpc
import session_pb2
from nidaqmx import GrpcSessionOptions
from nidaqmx._stubs import nidaqmx_pb2 as pb
from nidaqmx._stubs import nidaqmx_pb2_grpc
from nidaqmx.constants import AcquisitionType, Level, WDTTaskAction
from nidaqmx.error_codes import DAQmxErrors

from plant.compilation import PrecompiledCall
from plant.daq import Daq
from plant.dynamics import Obstacle
from plant.interface import (
    NOT_MEASURED,
    ONLY_OF_A_CARD,
    ZERO_VOLTS,
    Breakage,
    Broken,
    Measurement,
    MotorCommand,
    PlantError,
    ShaftLoad,
    T_s,
)
from plant.manual_input import NO_HAND, ManualInput
from plant.rig import Rig
from plant.safety_card import WATCHDOG_S, Card, CardState, WatchdogExpiredError
from plant.simulator import Simulator
from plant.terminals import compute_terminals, make_terminals, quantise_volts
from plant.wiring import Wiring, is_wired_alike

# In process ----------------------------------------------------------------------------------------
#
# NI's device service without a network: a channel whose calls are calls, and its errors as the
# server sends them.


class _Entry(NamedTuple):
    key: str
    value: str


class CardError(grpc.RpcError):  # type: ignore[misc]  # grpcio has no types
    """An error of NI-DAQmx, as the device server sends it."""

    def __init__(self, code: DAQmxErrors, text: str) -> None:
        super().__init__(text)
        self._code, self._text = code, text

    def code(self) -> grpc.StatusCode:
        """Return what gRPC calls it."""
        return grpc.StatusCode.UNKNOWN

    def details(self) -> str:
        """Return it in words."""
        return self._text

    def trailing_metadata(self) -> tuple[_Entry, ...]:
        """Return the code of NI-DAQmx, where the client looks for it."""
        return (_Entry("ni-error", str(self._code.value)),)


class CallHandler(Protocol):
    """A service of NI's: every call goes through here."""

    def get_handler(self, method: str) -> Callable[..., Any]:
        """Return what answers a call of this name, given its request. It raises grpc.RpcError."""
        ...


class InProcess(grpc.Channel):  # type: ignore[misc]  # grpcio has no types
    """A channel whose calls are calls: over a socket a cycle takes 1 ms, more than a period."""

    def __init__(self, service: CallHandler) -> None:
        self._service = service

    def unary_unary(self, method: str, *_: Any, **__: Any) -> Callable[..., Any]:
        """Return what answers the call: looked up here, once, and not in each tick."""
        return self._service.get_handler(method.rpartition("/")[2])

    def unary_stream(self, *_: Any, **__: Any) -> None:
        """Not used by the client's tasks."""

    stream_unary = stream_stream = unary_stream

    def subscribe(self, *_: Any, **__: Any) -> None:
        """Do nothing: it is always connected."""

    unsubscribe = subscribe

    def close(self) -> None:
        """Nothing to close."""

    def __enter__(self) -> "InProcess":
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


class UnknownCallError(grpc.RpcError):  # type: ignore[misc]  # grpcio has no types
    """What a server says that does not know a call."""

    def code(self) -> grpc.StatusCode:
        """Return what gRPC calls it."""
        return grpc.StatusCode.UNIMPLEMENTED

    def details(self) -> str:
        """Return it in words."""
        return "the virtual card does not know this call"

    def trailing_metadata(self) -> tuple[()]:
        """Return nothing: there is no code of NI-DAQmx."""
        return ()


class Context:
    """As much of a server's context as the stubs of unknown calls touch."""

    def set_code(self, code: grpc.StatusCode) -> None:
        """Take note of nothing."""

    def set_details(self, details: str) -> None:
        """Take note of nothing."""


# Card channels -------------------------------------------------------------------------------------
#
# Which task owns which channel of the virtual card: what is taken, or not there, is refused as NI-
# DAQmx does.


class Channels(dict[str, list[str]]):
    """Channels of one card by the name of their task, in the order in which they were taken."""

    def __init__(self, device: str) -> None:
        super().__init__()
        self._device = device
        self._owner: dict[str, str] = {}

    def make(self, task: str) -> None:
        """Make a task without channels. Raises CardError where its name is taken."""
        if task in self:
            raise CardError(DAQmxErrors.DUPLICATE_TASK, f"Task name: {task} is taken already")
        self[task] = []

    def release(self, task: str) -> None:
        """Let go of a task and its channels."""
        for channel in self.pop(task, []):
            self._owner.pop(channel, None)

    def take(self, task: str, names: str, kind: str, count: int) -> None:
        """Give channels to a task; ``count`` is how many of this ``kind`` the card has. Raises CardError."""
        for name in names.replace(" ", "").split(","):
            device, _, channel = name.partition("/")
            self.require_device(device)
            number = "".join(filter(str.isdigit, channel.rpartition("/")[2]))
            if not channel.startswith(kind) or not number or int(number) >= count:
                raise CardError(
                    DAQmxErrors.PHYSICAL_CHAN_DOES_NOT_EXIST,
                    f"Physical channel specified does not exist on this device: {channel} of {device}",
                )
            if self._owner.setdefault(channel, task) != task:
                raise CardError(
                    DAQmxErrors.PAL_RESOURCE_RESERVED,
                    f"The specified resource is reserved: {channel} belongs to the task {self._owner[channel]}",
                )
            self[task].append(channel)

    def require_device(self, device: str) -> None:
        """Raise CardError for a card of another name."""
        if device != self._device:
            raise CardError(DAQmxErrors.INVALID_DEVICE_ID, f"Device identifier is invalid: {device}")


class TaskCalls(nidaqmx_pb2_grpc.NiDAQmxServicer):  # type: ignore[misc]  # made by a generator, without types
    """The calls of NI's service that make a task and give it channels."""

    def __init__(self, device: str) -> None:
        self._channels = Channels(device)

    def CreateTask(self, request: Any, context: Any) -> Any:
        """Make a task; its name is free."""
        self._channels.make(request.session_name)
        return pb.CreateTaskResponse(task=session_pb2.Session(name=request.session_name), new_session_initialized=True)

    def GetTaskAttributeString(self, request: Any, context: Any) -> Any:
        """Tell a task's name."""
        return pb.GetTaskAttributeStringResponse(value=request.task.name)

    def CreateAIVoltageChan(self, request: Any, context: Any) -> Any:
        """Take analog inputs."""
        self._channels.take(request.task.name, request.physical_channel, "ai", 32)
        return pb.CreateAIVoltageChanResponse()

    def CreateAOVoltageChan(self, request: Any, context: Any) -> Any:
        """Take analog outputs."""
        self._channels.take(request.task.name, request.physical_channel, "ao", 4)
        return pb.CreateAOVoltageChanResponse()

    def CreateCIAngEncoderChan(self, request: Any, context: Any) -> Any:
        """Take a counter."""
        self._channels.take(request.task.name, request.counter, "ctr", 4)
        return pb.CreateCIAngEncoderChanResponse()

    def CreateDIChan(self, request: Any, context: Any) -> Any:
        """Take lines to read."""
        self._channels.take(request.task.name, request.lines, "port", 48)
        return pb.CreateDIChanResponse()

    def CreateDOChan(self, request: Any, context: Any) -> Any:
        """Take lines to write."""
        self._channels.take(request.task.name, request.lines, "port", 48)
        return pb.CreateDOChanResponse()


# Card faults ---------------------------------------------------------------------------------------
#
# Faults to order that only a card has: as NI-DAQmx tells them, and wires that are not where the
# wiring file says.
#
# A fault that a card notices is an error with NI's code. What it cannot notice is a rig that
# differs from its wiring file: ``apply_miswiring`` says what the terminals are really connected to, and
# the file goes on saying what it says.


LOST_PART = 0.3
"""Part of the edges that an encoder with a bad contact loses."""

_AT_THE_END_V = 20.0
"""Where the amplifier of a saturated load cell would be if it could [V]: twice the range."""

_SWAPS = {
    Breakage.SWAPPED_LOAD_CELLS: ("load_cell_A", "load_cell_B", "channel"),
    Breakage.SWAPPED_ENCODERS: ("encoder_A", "encoder_B", "counter"),
    Breakage.SWAPPED_MOTORS: ("motor_A", "motor_B", "channel"),
}
_SECTIONS = {
    "q": "encoder_q",
    "theta_A": "encoder_A",
    "theta_B": "encoder_B",
    "F_A": "load_cell_A",
    "F_B": "load_cell_B",
}

_ERRORS = {
    Breakage.DEVICE_GONE: (
        DAQmxErrors.DEV_CANNOT_BE_ACCESSED,
        "Device cannot be accessed. It is no longer in the system, or without power (injected)",
    ),
    Breakage.BUFFER_OVERRUN: (
        DAQmxErrors.ACQ_STOPPED_TO_PREVENT_INPUT_BUFFER_OVERWRITE,
        "Onboard device memory overflow: the acquisition has stopped, to keep samples that were not read (injected)",
    ),
    Breakage.LOST_SAMPLE: (
        DAQmxErrors.SAMPLES_NO_LONGER_AVAILABLE,
        "The application is not able to keep up: a sample was overwritten before it was read (injected)",
    ),
}


class CardFaults:
    """What is broken of one card; nothing at first.

    ``enable_held``: something holds the drive-enable line on, whatever loop and watchdog do. As nothing of it is seen
    before the line has to fall, it is not among what is broken in motion. ``kind`` is what else is broken.
    """

    def __init__(self) -> None:
        self.enable_held = False
        self.kind: Breakage | None = None

    def inject(self, broken: Broken | None) -> None:
        """Break something from the next call on; None mends it."""
        self.kind = None if broken is None else broken.kind

    @property
    def is_gone(self) -> bool:
        """Whether the card does not answer any more; its outputs stay as they were, until its watchdog cuts them."""
        return self.kind is Breakage.DEVICE_GONE

    def refuse(self, method: str) -> None:
        """Raise CardError where a call of NI's service, by its name, does not work."""
        if self.kind not in _ERRORS or not (self.is_gone or method == "ReadAnalogF64"):
            return
        code, text = _ERRORS[self.kind]
        if self.kind is Breakage.LOST_SAMPLE:
            self.kind = None
        raise CardError(code, text)


def apply_miswiring(wiring: Wiring, broken: Broken | None) -> Wiring:
    """Return what the terminals are connected to when something is broken of a rig with this wiring."""
    if broken is None:
        return wiring
    if broken.kind in _SWAPS:
        first, second, terminal = _SWAPS[broken.kind]
        one, other = getattr(wiring, first), getattr(wiring, second)
        crossed: dict[str, Any] = {
            first: replace(one, **{terminal: getattr(other, terminal)}),
            second: replace(other, **{terminal: getattr(one, terminal)}),
        }
        return replace(wiring, **crossed)
    section = _SECTIONS[broken.sensor]
    if broken.kind is Breakage.LOST_COUNTS:
        encoder = getattr(wiring, section)
        return replace(wiring, **{section: replace(encoder, counts_per_rev=(1.0 - LOST_PART) * encoder.counts_per_rev)})
    if broken.kind is Breakage.SATURATION:
        return replace(
            wiring, **{section: replace(getattr(wiring, section), slope=1.0, offset=_AT_THE_END_V, table=())}
        )
    return wiring


# Card watchdog -------------------------------------------------------------------------------------
#
# The virtual card's watchdog as a task of NI-DAQmx: what may be asked of it when, and what it has
# done to lines.


_CLEAR = WDTTaskAction.CLEAR_EXPIRATION.value


class WatchdogTask:
    """At most one task; its timer and what it cuts are the registers' own. Raises CardError as NI-DAQmx would."""

    def __init__(self, registers: Card) -> None:
        self.limit_s = 0.0
        self._registers = registers
        self._task = ""
        self._running = False

    def make(self, task: str, limit_s: float) -> None:
        """Make the task, with its time [s]."""
        self._task, self.limit_s = task, limit_s

    def release(self, task: str) -> None:
        """Let go of a task; of this one nothing is watched any more."""
        if task == self._task:
            self._task, self._running, self.limit_s = "", False, 0.0
            self._registers.disarm()

    def start(self, task: str) -> None:
        """Count from this moment, where the task is this one."""
        if task != self._task:
            return
        if self._running:
            raise CardError(DAQmxErrors.CAN_NOT_PERFORM_OP_WHILE_TASK_RUNNING, f"The task is running: {task}")
        self._running = True
        self._registers.start_watching(self.limit_s)

    def stop(self, task: str) -> None:
        """Stop counting, where the task is this one."""
        self._running = self._running and task != self._task

    def control(self, action: int) -> None:
        """Reset the timer, or clear the expiration."""
        if action == _CLEAR:
            self._registers.clear_expiration()
            return
        try:
            self._registers.feed()
        except WatchdogExpiredError:
            text = "The watchdog timer has expired, and cannot be reset before its expiration is cleared"
            raise CardError(DAQmxErrors.CANT_RESET_EXPIRED_WATCHDOG, text) from None

    @property
    def is_expired(self) -> bool:
        """Whether it has expired; available while it runs only."""
        if not self._running:
            text = "The property can be read while the task is reserved, committed or running only"
            raise CardError(DAQmxErrors.CANNOT_GET_PROPERTY_WHEN_TASK_NOT_RESERVED_COMMITTED_OR_RUNNING, text)
        return self._registers.state().expired

    def require_unlocked(self) -> None:
        """Refuse a write to the lines that it holds."""
        if self._registers.state().expired:
            text = "Write failed, because the watchdog timer has expired: clear its expiration first"
            raise CardError(DAQmxErrors.WRITE_FAILED_BECAUSE_WATCHDOG_EXPIRED, text)


# Virtual card --------------------------------------------------------------------------------------


class VirtualCard(TaskCalls):
    """The calls that ``plant/daq.py`` makes; any other is answered as a server too old for it would.

    Method names and messages are those of NI's service.
    """

    def __init__(self, wiring: Wiring, simulator: Simulator, registers: Card, *, has_clock: bool) -> None:
        super().__init__(wiring.card.device)
        self._nominal_wiring = wiring
        self._manual_input = NO_HAND
        self._raw: tuple[float, ...] | None = None
        self._connect(wiring)
        self._at_terminals = PrecompiledCall(compute_terminals, self._wires, NOT_MEASURED, 0.0, 0.0)
        self.faults = CardFaults()
        self._last_output = ZERO_VOLTS
        self._unwritten_s = self._next_s = 0.0
        self._simulator, self._registers = simulator, registers
        self._has_clock = has_clock
        self._clocked: set[str] = set()
        self._watchdog = WatchdogTask(registers)
        self._measurement: Measurement | None = None
        self._counted_from: dict[str, float] = {}
        # Filled anew by each call: the client takes out what it needs before the next one, and making one takes longer
        # than everything else in a call.
        self._volts_read = pb.ReadAnalogF64Response(samps_per_chan_read=1)
        self._count_read = pb.ReadCounterScalarF64Response()
        self._levels_read = pb.ReadDigitalLinesResponse(samps_per_chan_read=1, num_bytes_per_samp=1)
        self._volts_written = pb.WriteAnalogF64Response(samps_per_chan_written=1)
        self._watchdog_response = pb.ControlWatchdogTaskResponse()

    def options(self) -> GrpcSessionOptions:
        """Return what makes a nidaqmx task one of this card."""
        return GrpcSessionOptions(InProcess(self), "")

    def by_hand(self, hand: ManualInput) -> None:
        """Let a hand act on what stands behind the terminals."""
        if self._manual_input.q is not None:
            self._simulator.push(0.0)
        self._manual_input = hand
        self._raw = None
        self._simulator.limit_tension(hand.F_limit)

    def get_handler(self, method: str) -> Callable[..., Any]:
        """Return what answers a call by its name, as far as what is broken lets it."""
        call, faults, context = getattr(self, method), self.faults, Context()

        def answer(request: Any, timeout: float | None = None, metadata: object = None) -> Any:
            if faults.kind is not None:
                if faults.is_gone and method == "WriteAnalogF64":
                    self._advance_unattended()
                faults.refuse(method)
            try:
                return call(request, context)
            except NotImplementedError:
                raise UnknownCallError from None

        return answer

    def inject(self, broken: Broken | None) -> None:
        """Break something of the card or its wires, None to mend it; counters go on from where they stand."""
        before = {counter: self._read_counts(counter) for counter in self._counted_from}
        self.faults.inject(broken)
        self._connect(apply_miswiring(self._nominal_wiring, broken))
        for counter, counts in before.items():
            jump = self._read_counts(counter) - counts
            self._counted_from[counter] += jump if math.isfinite(jump) else 0.0

    def _connect(self, wiring: Wiring) -> None:
        """Say what is at each terminal, and its place in ``_raw``."""
        w = self._wiring = wiring
        self._wires = make_terminals(w)
        self._terminal_index = {
            w.load_cell_B.channel: 1,
            w.load_cell_A.channel: 0,
            w.encoder_q.counter: 2,
            w.encoder_A.counter: 3,
            w.encoder_B.counter: 4,
        }
        enables, trips, ends = (line.active == "high" for line in (w.drive_enable, w.safety_tripped, w.end_switch))
        self._levels = {
            w.end_switch.line: lambda: w.end_switch.is_held_at(self._simulator.x.q) == ends,
            w.safety_tripped.line: lambda: (self._measure().safety_trip > 0.0) == trips,
            w.drive_enable.line: lambda: self._drives_on == enables,
        }
        self._raw = None

    def _advance_unattended(self) -> None:
        """Let what moves go on for a period under the volts that were written last; in stepped time, watch over it."""
        self._unwritten_s += T_s
        if self._registers.watchdog_pid is None and self._unwritten_s > self._watchdog.limit_s:
            self._registers.expire()
        self._advance()

    # The physics behind the terminals.

    def _measure(self) -> Measurement:
        if self._measurement is None:
            self._measurement = self._simulator.read()
        return self._measurement

    def _read_terminals(self) -> tuple[float, ...]:
        """Volts and counts at the terminals, in one compiled call for all of them."""
        hand = self._manual_input
        raw = self._raw = self._at_terminals(self._wires, self._measure(), hand.pull_A, hand.pull_B)
        return raw

    def _read_volts(self, channel: str) -> float:
        index = self._terminal_index.get(channel)
        return 0.0 if index is None else (self._raw or self._read_terminals())[index]

    def _read_counts(self, counter: str) -> float:
        index = self._terminal_index.get(counter)
        return 0.0 if index is None else (self._raw or self._read_terminals())[index]

    def _read_line(self, line: str) -> bool:
        return line in self._levels and self._levels[line]()

    # Tasks.

    def CreateWatchdogTimerTaskEx(self, request: Any, context: Any) -> Any:
        """Make the watchdog's task."""
        self._channels.require_device(request.device_name)
        self._channels.make(request.session_name)
        self._watchdog.make(request.session_name, request.timeout)
        return pb.CreateWatchdogTimerTaskExResponse(
            task=session_pb2.Session(name=request.session_name), new_session_initialized=True
        )

    def ClearTask(self, request: Any, context: Any) -> Any:
        """Let go of a task's channels."""
        self._channels.release(request.task.name)
        self._clocked.discard(request.task.name)
        self._watchdog.release(request.task.name)
        return pb.ClearTaskResponse()

    def StartTask(self, request: Any, context: Any) -> Any:
        """Start; an encoder counts from where it is now, a watchdog from this moment."""
        self._watchdog.start(request.task.name)
        for channel in self._channels[request.task.name]:
            if channel.startswith("ctr"):
                self._counted_from[channel] = self._read_counts(channel)
        return pb.StartTaskResponse()

    def StopTask(self, request: Any, context: Any) -> Any:
        """Stop."""
        self._watchdog.stop(request.task.name)
        return pb.StopTaskResponse()

    def GetSystemInfoAttributeUInt32(self, request: Any, context: Any) -> Any:
        """Tell the driver's version: none, as there is no driver."""
        return pb.GetSystemInfoAttributeUInt32Response(value=0)

    # Reading and writing.

    def ReadAnalogF64(self, request: Any, context: Any) -> Any:
        """Read the load cells; a clocked task waits for the next edge of the card's clock."""
        task = request.task.name
        if task in self._clocked:
            self._wait_for_clock()
        self._volts_read.read_array[:] = [self._read_volts(channel) for channel in self._channels[task]]
        return self._volts_read

    def ReadCounterScalarF64(self, request: Any, context: Any) -> Any:
        """Read an encoder."""
        (counter,) = self._channels[request.task.name]
        self._count_read.value = self._read_counts(counter) - self._counted_from.get(counter, 0.0)
        return self._count_read

    def ReadDigitalLines(self, request: Any, context: Any) -> Any:
        """Read lines, a byte each."""
        self._levels_read.read_array = bytes([self._read_line(line) for line in self._channels[request.task.name]])
        return self._levels_read

    def WriteAnalogF64(self, request: Any, context: Any) -> Any:
        """Write both outputs: the physics goes on by one period."""
        volts = dict(zip(self._channels[request.task.name], request.write_array[:], strict=True))
        A, B = self._wiring.motor_A, self._wiring.motor_B
        V_A, V_B = volts.get(A.channel, 0.0), volts.get(B.channel, 0.0)
        self._last_output = MotorCommand(quantise_volts(V_A) / A.gain, quantise_volts(V_B) / B.gain)
        self._registers.set_outputs(self._last_output)
        self._unwritten_s = 0.0
        self._advance()
        return self._volts_written

    @property
    def _drives_on(self) -> bool:
        return self._registers.drives_on or self.faults.enable_held

    def _advance(self) -> None:
        command = self._last_output if self._drives_on else ZERO_VOLTS
        self._simulator.write(command if self._manual_input is NO_HAND else self._add_manual_input(command))
        self._measurement = self._raw = None
        self._registers.set_trip(self._measure().safety_trip > 0.0)

    def _add_manual_input(self, command: MotorCommand) -> MotorCommand:
        x = self._simulator.x
        if self._manual_input.q is not None:
            self._simulator.push(self._manual_input.compute_push(x))
        torques = self._manual_input.compute_torques(x)
        return MotorCommand(command.u_A + torques.u_A, command.u_B + torques.u_B)

    def WriteDigitalLines(self, request: Any, context: Any) -> Any:
        """Write the drive-enable line."""
        if self._channels[request.task.name] == [self._wiring.drive_enable.line]:
            self._watchdog.require_unlocked()
            on = bool(request.write_array[0]) == (self._wiring.drive_enable.active == "high")
            self._registers.set_drives(on=on)
            if not on:
                self._rearm_safety_module()
        return pb.WriteDigitalLinesResponse(samps_per_chan_written=1)

    def CfgWatchdogDOExpirStates(self, request: Any, context: Any) -> Any:
        """Take note that the watchdog takes the drives away."""
        off = Level.LOW if self._wiring.drive_enable.active == "high" else Level.HIGH
        if list(request.expir_state_array) != [off.value]:
            raise CardError(DAQmxErrors.WATCHDOG_CHANNEL_EXPIRATION_STATE_NOT_SPECIFIED, "the drives would stay on")
        return pb.CfgWatchdogDOExpirStatesResponse()

    def ControlWatchdogTask(self, request: Any, context: Any) -> Any:
        """Reset its timer, or clear its expiration."""
        self._watchdog.control(request.action_raw)
        return self._watchdog_response

    def GetWatchdogAttributeBool(self, request: Any, context: Any) -> Any:
        """Tell whether it has expired."""
        return pb.GetWatchdogAttributeBoolResponse(value=self._watchdog.is_expired)

    def GetDeviceAttributeInt32Array(self, request: Any, context: Any) -> Any:
        """Tell how analog inputs can be timed."""
        offered = [AcquisitionType.FINITE, AcquisitionType.CONTINUOUS]
        if self._has_clock:
            offered.append(AcquisitionType.HW_TIMED_SINGLE_POINT)
        return pb.GetDeviceAttributeInt32ArrayResponse(value_raw=[mode.value for mode in offered])

    def CfgSampClkTiming(self, request: Any, context: Any) -> Any:
        """Let the card's clock time a task."""
        self._clocked.add(request.task.name)
        return pb.CfgSampClkTimingResponse()

    def _wait_for_clock(self) -> None:
        now_s = time.monotonic()
        self._next_s = max(self._next_s + T_s, now_s - now_s % T_s)
        time.sleep(max(self._next_s - now_s, 0.0))

    def _rearm_safety_module(self) -> None:
        with suppress(PlantError):  # its cause is still there: it stays tripped, and says so
            self._simulator.acknowledge()
        self._measurement = self._raw = None


# Virtual rig ---------------------------------------------------------------------------------------
#
# The rig on a virtual card: for training and tests, without hardware.


class VirtualRig(Rig):
    """A rig at a virtual card: what moves can be pushed, loaded and broken to order.

    With ``registers`` it runs in real time under their watchdog, whose time is that of the simulated card: a virtual
    machine pauses for longer than a rig may be left alone. Without, it is stepped as fast as it goes, unwatched.
    ``has_clock``: the card offers hardware timing; None: in real time only.

    ``as_wired`` is how the card really is wired, where that is not as the wiring says: then it has to be brought up
    like any rig. Else it stands at its zero when it is made, and may be controlled at once.
    """

    pushes = True
    loads_shafts = True

    def __init__(
        self,
        wiring: Wiring,
        simulator: Simulator,
        registers: Card | None = None,
        as_wired: Wiring | None = None,
        *,
        directions_proven: bool = False,
        load_cells_measured: bool = False,
        has_clock: bool | None = None,
        drives_off: bool = False,
        wired: str = "",
    ) -> None:
        wiring = replace(wiring, card=replace(wiring.card, watchdog_s=WATCHDOG_S))
        self._has_watchdog = registers is not None
        self.stepped = not self._has_watchdog
        self._card_registers = registers or Card.create()
        if self._has_watchdog:
            self._card_registers.start_watchdog()
        actual = wiring if as_wired is None else as_wired
        has_clock = self._has_watchdog if has_clock is None else has_clock
        self.card = VirtualCard(actual, simulator, self._card_registers, has_clock=has_clock)
        self._simulator = simulator
        is_wired_right = as_wired is None or is_wired_alike(wiring, as_wired)
        super().__init__(
            wiring,
            Daq(wiring, self.card.options),
            directions_proven=directions_proven or is_wired_right,
            load_cells_measured=load_cells_measured or is_wired_right,
            drives_off=drives_off,
            wired=wired,
        )
        self.zeroed = is_wired_right

    def _describe(self) -> str:
        return f"virtual card, {super()._describe()}"

    def _measure_cycle(self) -> None:
        """Spare it: each write would move what is simulated."""

    def _prove_watchdog(self) -> None:
        if self._has_watchdog:
            super()._prove_watchdog()
        self._watchdog_proven = True

    def card_state(self) -> CardState:
        """Return what the card puts out, as anybody may see it."""
        return self._card_registers.state()

    def read(self) -> Measurement:
        """Return what the sensors say now, the push, and the force of a wall. Raises PlantError."""
        m, simulator = super().read(), self._simulator
        return m._replace(F_push=simulator.F_push, F_wall=simulator.F_wall)

    def push(self, F_push: float) -> None:
        """Apply an external force [N] from the next period on."""
        self._simulator.push(F_push)

    def load(self, load: ShaftLoad) -> None:
        """Load the motors' shafts from the next period on. Raises PlantError."""
        self._simulator.load(load)

    def obstacle(self, obstacle: Obstacle | None) -> None:
        """Put a wall in the joint's way from the next period on, None takes it away. Raises PlantError."""
        self._simulator.obstacle(obstacle)

    def inject(self, broken: Broken | None) -> None:
        """Break something of the card or of the simulated plant, None to mend it."""
        of_the_card = broken is not None and broken.kind in ONLY_OF_A_CARD
        self.card.inject(broken if of_the_card else None)
        self._simulator.inject(None if of_the_card else broken)
        if broken is not None and broken.kind is Breakage.WATCHDOG_DEATH:
            self._card_registers.kill_watchdog()

    def by_hand(self, hand: ManualInput) -> None:
        """Let a hand act from the next period on."""
        self.card.by_hand(hand)
