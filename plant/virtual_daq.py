"""DAQ card without hardware: NI's device service, backed by the simulator.

The real nidaqmx client uses it through an in-process channel, so all of ``plant/daq.py`` is exercised. Writing both
outputs advances the physics by one period. The registers, watchdog and drive-enable line are those of
``plant/safety_card.py`` and outlive this process. Switching the drive-enable line off re-arms a tripped safety module
once its cause is gone.
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

from plant import messages
from plant.compilation import PrecompiledCall
from plant.daq import Daq
from plant.dynamics import Obstacle
from plant.interface import (
    NOT_MEASURED,
    ONLY_OF_A_CARD,
    ZERO_VOLTS,
    InjectedFault,
    InjectedFaultKind,
    Measurement,
    MotorCommand,
    PlantError,
    ShaftLoad,
    T_s,
)
from plant.manual_input import NO_MANUAL_INPUT, ManualInput
from plant.rig import Rig
from plant.safety_card import WATCHDOG_S, Card, CardState, WatchdogExpiredError
from plant.simulator import Simulator
from plant.terminals import compute_terminals, make_terminals, quantize_volts
from plant.wiring import Wiring, is_wired_alike

# In-process channel --------------------------------------------------------------------------------
# NI's device service without a network: a channel that calls it directly, and errors as the server sends them.


class _Entry(NamedTuple):
    key: str
    value: str


class CardError(grpc.RpcError):  # type: ignore[misc]  # grpcio has no types
    """An error of NI-DAQmx, as the device server sends it."""

    def __init__(self, code: DAQmxErrors, text: str) -> None:
        super().__init__(text)
        self._code, self._text = code, text

    def code(self) -> grpc.StatusCode:
        """Return the gRPC status code."""
        return grpc.StatusCode.UNKNOWN

    def details(self) -> str:
        """Return the message."""
        return self._text

    def trailing_metadata(self) -> tuple[_Entry, ...]:
        """Return the NI-DAQmx code in the entry that the client reads."""
        return (_Entry("ni-error", str(self._code.value)),)


class CallHandler(Protocol):
    """Service of NI; every call goes through it."""

    def get_handler(self, method: str) -> Callable[..., Any]:
        """Return the function that handles a call; it takes a request.

        It raises grpc.RpcError.
        """
        ...


class InProcess(grpc.Channel):  # type: ignore[misc]  # grpcio has no types
    """Channel that calls its service directly.

    Over a socket a cycle takes 1 ms, a whole period.
    """

    def __init__(self, service: CallHandler) -> None:
        self._service = service

    def unary_unary(self, method: str, *_: Any, **__: Any) -> Callable[..., Any]:
        """Return the handler of a call, looked up once and not at each tick."""
        return self._service.get_handler(method.rpartition("/")[2])

    def unary_stream(self, *_: Any, **__: Any) -> None:
        """Unused by the client's tasks."""

    stream_unary = stream_stream = unary_stream

    def subscribe(self, *_: Any, **__: Any) -> None:
        """Do nothing: the channel is always connected."""

    unsubscribe = subscribe

    def close(self) -> None:
        """Do nothing."""

    def __enter__(self) -> "InProcess":
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


class UnknownCallError(grpc.RpcError):  # type: ignore[misc]  # grpcio has no types
    """Response of a server to an unknown call."""

    def code(self) -> grpc.StatusCode:
        """Return the gRPC status code."""
        return grpc.StatusCode.UNIMPLEMENTED

    def details(self) -> str:
        """Return the message."""
        return "the virtual card does not support this call"

    def trailing_metadata(self) -> tuple[()]:
        """Return no metadata: there is no NI-DAQmx code."""
        return ()


class Context:
    """The part of a server context that stubs of unknown calls use."""

    def set_code(self, code: grpc.StatusCode) -> None:
        """Ignore the code."""

    def set_details(self, details: str) -> None:
        """Ignore the details."""


# Card channels -------------------------------------------------------------------------------------
# Ownership of the virtual card's channels by tasks; conflicts are errors as in NI-DAQmx.


class Channels(dict[str, list[str]]):
    """Channels of one card by task name, in the order of their reservation."""

    def __init__(self, device: str) -> None:
        super().__init__()
        self._device = device
        self._owner: dict[str, str] = {}

    def make(self, task: str) -> None:
        """Create a task without channels. Raises CardError if its name exists."""
        if task in self:
            raise CardError(DAQmxErrors.DUPLICATE_TASK, f"Task name: {task} is taken already")
        self[task] = []

    def release(self, task: str) -> None:
        """Release a task and its channels."""
        for channel in self.pop(task, []):
            self._owner.pop(channel, None)

    def take(self, task: str, names: str, kind: str, count: int) -> None:
        """Reserve channels for a task. Raises CardError.

        ``count`` is the number of channels of this ``kind`` on the card.
        """
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
    """Calls of NI's service that create a task and reserve channels."""

    def __init__(self, device: str) -> None:
        self._channels = Channels(device)

    def CreateTask(self, request: Any, context: Any) -> Any:
        """Create a task with a new name."""
        self._channels.make(request.session_name)
        return pb.CreateTaskResponse(task=session_pb2.Session(name=request.session_name), new_session_initialized=True)

    def GetTaskAttributeString(self, request: Any, context: Any) -> Any:
        """Return a task's name."""
        return pb.GetTaskAttributeStringResponse(value=request.task.name)

    def CreateAIVoltageChan(self, request: Any, context: Any) -> Any:
        """Reserve analog inputs."""
        self._channels.take(request.task.name, request.physical_channel, "ai", 32)
        return pb.CreateAIVoltageChanResponse()

    def CreateAOVoltageChan(self, request: Any, context: Any) -> Any:
        """Reserve analog outputs."""
        self._channels.take(request.task.name, request.physical_channel, "ao", 4)
        return pb.CreateAOVoltageChanResponse()

    def CreateCIAngEncoderChan(self, request: Any, context: Any) -> Any:
        """Reserve a counter."""
        self._channels.take(request.task.name, request.counter, "ctr", 4)
        return pb.CreateCIAngEncoderChanResponse()

    def CreateDIChan(self, request: Any, context: Any) -> Any:
        """Reserve digital inputs."""
        self._channels.take(request.task.name, request.lines, "port", 48)
        return pb.CreateDIChanResponse()

    def CreateDOChan(self, request: Any, context: Any) -> Any:
        """Reserve digital outputs."""
        self._channels.take(request.task.name, request.lines, "port", 48)
        return pb.CreateDOChanResponse()


# Card faults ---------------------------------------------------------------------------------------
# Injected faults that only a card has: errors as NI-DAQmx reports them, and wrong wiring.
#
# A fault that a card detects is an error with NI's code. It cannot detect a rig that differs from its wiring file:
# ``apply_miswiring`` returns the actual connections, while the wiring file stays unchanged.


LOST_PART = 0.3
"""Fraction of the edges that an encoder with a bad contact loses."""

_AT_THE_END_V = 20.0
"""Voltage of a saturated load cell's amplifier without its limit [V]: twice the range."""

_SWAPS = {
    InjectedFaultKind.SWAPPED_LOAD_CELLS: ("load_cell_A", "load_cell_B", "channel"),
    InjectedFaultKind.SWAPPED_ENCODERS: ("encoder_A", "encoder_B", "counter"),
    InjectedFaultKind.SWAPPED_MOTORS: ("motor_A", "motor_B", "channel"),
}
_SECTIONS = {
    "q": "encoder_q",
    "theta_A": "encoder_A",
    "theta_B": "encoder_B",
    "F_A": "load_cell_A",
    "F_B": "load_cell_B",
}

_ERRORS = {
    InjectedFaultKind.DEVICE_GONE: (
        DAQmxErrors.DEV_CANNOT_BE_ACCESSED,
        "Device cannot be accessed. It is no longer in the system, or without power (injected)",
    ),
    InjectedFaultKind.BUFFER_OVERRUN: (
        DAQmxErrors.ACQ_STOPPED_TO_PREVENT_INPUT_BUFFER_OVERWRITE,
        "Onboard device memory overflow: the acquisition has stopped, to keep samples that were not read (injected)",
    ),
    InjectedFaultKind.LOST_SAMPLE: (
        DAQmxErrors.SAMPLES_NO_LONGER_AVAILABLE,
        "The application is not able to keep up: a sample was overwritten before it was read (injected)",
    ),
}


class CardFaults:
    """Active fault of one card; none at first.

    ``enable_held``: the drive-enable line stays on, independent of loop and watchdog. It has no effect until the line
    must fall, so it is not a ``kind`` of fault that is injected during motion. ``kind``: any other fault.
    """

    def __init__(self) -> None:
        self.enable_held = False
        self.kind: InjectedFaultKind | None = None

    def inject(self, injected_fault: InjectedFault | None) -> None:
        """Inject a fault from the next call on; None clears it."""
        self.kind = None if injected_fault is None else injected_fault.kind

    @property
    def is_gone(self) -> bool:
        """Whether the card does not respond; its outputs stay until its watchdog expires."""
        return self.kind is InjectedFaultKind.DEVICE_GONE

    def refuse(self, method: str) -> None:
        """Raise CardError if a fault affects a call of NI's service, given by name."""
        if self.kind not in _ERRORS or not (self.is_gone or method == "ReadAnalogF64"):
            return
        code, text = _ERRORS[self.kind]
        if self.kind is InjectedFaultKind.LOST_SAMPLE:
            self.kind = None
        raise CardError(code, text)


def apply_miswiring(wiring: Wiring, injected_fault: InjectedFault | None) -> Wiring:
    """Return the actual connections of the terminals under a fault of the wiring."""
    if injected_fault is None:
        return wiring
    if injected_fault.kind in _SWAPS:
        first, second, terminal = _SWAPS[injected_fault.kind]
        one, other = getattr(wiring, first), getattr(wiring, second)
        crossed: dict[str, Any] = {
            first: replace(one, **{terminal: getattr(other, terminal)}),
            second: replace(other, **{terminal: getattr(one, terminal)}),
        }
        return replace(wiring, **crossed)
    section = _SECTIONS[injected_fault.sensor]
    if injected_fault.kind is InjectedFaultKind.LOST_COUNTS:
        encoder = getattr(wiring, section)
        return replace(wiring, **{section: replace(encoder, counts_per_rev=(1.0 - LOST_PART) * encoder.counts_per_rev)})
    if injected_fault.kind is InjectedFaultKind.SATURATION:
        return replace(
            wiring, **{section: replace(getattr(wiring, section), slope=1.0, offset=_AT_THE_END_V, table=())}
        )
    return wiring


# Card watchdog -------------------------------------------------------------------------------------
# The virtual card's watchdog as a task of NI-DAQmx: permitted calls and effect on lines.


_CLEAR = WDTTaskAction.CLEAR_EXPIRATION.value


class WatchdogTask:
    """At most one watchdog task; its timer and action are those of the registers.

    Raises CardError as NI-DAQmx would.
    """

    def __init__(self, registers: Card) -> None:
        self.limit_s = 0.0
        self._registers = registers
        self._task = ""
        self._running = False

    def make(self, task: str, limit_s: float) -> None:
        """Create the task with its timeout [s]."""
        self._task, self.limit_s = task, limit_s

    def release(self, task: str) -> None:
        """Release a task; releasing the watchdog's disarms it."""
        if task == self._task:
            self._task, self._running, self.limit_s = "", False, 0.0
            self._registers.disarm()

    def start(self, task: str) -> None:
        """Start the timer if the task is the watchdog's."""
        if task != self._task:
            return
        if self._running:
            raise CardError(DAQmxErrors.CAN_NOT_PERFORM_OP_WHILE_TASK_RUNNING, f"The task is running: {task}")
        self._running = True
        self._registers.start_watching(self.limit_s)

    def stop(self, task: str) -> None:
        """Stop the timer if the task is the watchdog's."""
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
        """Whether it has expired; raises CardError unless the task is running."""
        if not self._running:
            text = "The property can be read while the task is reserved, committed or running only"
            raise CardError(DAQmxErrors.CANNOT_GET_PROPERTY_WHEN_TASK_NOT_RESERVED_COMMITTED_OR_RUNNING, text)
        return self._registers.state().expired

    def require_unlocked(self) -> None:
        """Raise CardError if the watchdog has locked the line."""
        if self._registers.state().expired:
            text = "Write failed, because the watchdog timer has expired: clear its expiration first"
            raise CardError(DAQmxErrors.WRITE_FAILED_BECAUSE_WATCHDOG_EXPIRED, text)


# Virtual card --------------------------------------------------------------------------------------


class VirtualCard(TaskCalls):
    """Calls that ``plant/daq.py`` makes; any other fails as on an outdated server.

    Method names and messages are those of NI's service.
    """

    def __init__(self, wiring: Wiring, simulator: Simulator, registers: Card, *, has_clock: bool) -> None:
        super().__init__(wiring.card.device)
        self._nominal_wiring = wiring
        self._manual_input = NO_MANUAL_INPUT
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
        # The responses are reused: the client copies what it needs before the next call, and creating one takes longer
        # than the rest of a call.
        self._volts_read = pb.ReadAnalogF64Response(samps_per_chan_read=1)
        self._count_read = pb.ReadCounterScalarF64Response()
        self._levels_read = pb.ReadDigitalLinesResponse(samps_per_chan_read=1, num_bytes_per_samp=1)
        self._volts_written = pb.WriteAnalogF64Response(samps_per_chan_written=1)
        self._watchdog_response = pb.ControlWatchdogTaskResponse()

    def options(self) -> GrpcSessionOptions:
        """Return the options of a nidaqmx task on this card."""
        return GrpcSessionOptions(InProcess(self), "")

    def apply_manual_input(self, manual_input: ManualInput) -> None:
        """Apply a simulated hand to the simulated rig."""
        if self._manual_input.q is not None:
            self._simulator.push(0.0)
        self._manual_input = manual_input
        self._raw = None
        self._simulator.limit_tension(manual_input.F_limit)

    def get_handler(self, method: str) -> Callable[..., Any]:
        """Return the handler of a call, which raises CardError under a fault."""
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

    def inject(self, injected_fault: InjectedFault | None) -> None:
        """Inject a fault of the card or its wiring, None clears it.

        Counters keep their counts.
        """
        before = {counter: self._read_counts(counter) for counter in self._counted_from}
        self.faults.inject(injected_fault)
        self._connect(apply_miswiring(self._nominal_wiring, injected_fault))
        for counter, counts in before.items():
            jump = self._read_counts(counter) - counts
            self._counted_from[counter] += jump if math.isfinite(jump) else 0.0

    def _connect(self, wiring: Wiring) -> None:
        """Set what is connected to each terminal, and its index in ``_raw``."""
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
        """Advance a period with the last voltages.

        Without a watchdog process, check its limit.
        """
        self._unwritten_s += T_s
        if self._registers.watchdog_pid is None and self._unwritten_s > self._watchdog.limit_s:
            self._registers.expire()
        self._advance()

    # Physics behind the terminals.

    def _measure(self) -> Measurement:
        if self._measurement is None:
            self._measurement = self._simulator.read()
        return self._measurement

    def _read_terminals(self) -> tuple[float, ...]:
        """Return volts and counts of all terminals, from one compiled call."""
        manual_input = self._manual_input
        raw = self._raw = self._at_terminals(self._wires, self._measure(), manual_input.pull_A, manual_input.pull_B)
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
        """Create the watchdog's task."""
        self._channels.require_device(request.device_name)
        self._channels.make(request.session_name)
        self._watchdog.make(request.session_name, request.timeout)
        return pb.CreateWatchdogTimerTaskExResponse(
            task=session_pb2.Session(name=request.session_name), new_session_initialized=True
        )

    def ClearTask(self, request: Any, context: Any) -> Any:
        """Release a task and its channels."""
        self._channels.release(request.task.name)
        self._clocked.discard(request.task.name)
        self._watchdog.release(request.task.name)
        return pb.ClearTaskResponse()

    def StartTask(self, request: Any, context: Any) -> Any:
        """Start a task: an encoder counts from its position, a watchdog from now."""
        self._watchdog.start(request.task.name)
        for channel in self._channels[request.task.name]:
            if channel.startswith("ctr"):
                self._counted_from[channel] = self._read_counts(channel)
        return pb.StartTaskResponse()

    def StopTask(self, request: Any, context: Any) -> Any:
        """Stop a task."""
        self._watchdog.stop(request.task.name)
        return pb.StopTaskResponse()

    def GetSystemInfoAttributeUInt32(self, request: Any, context: Any) -> Any:
        """Return 0 as the driver's version: there is no driver."""
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
        """Read lines, one byte each."""
        self._levels_read.read_array = bytes([self._read_line(line) for line in self._channels[request.task.name]])
        return self._levels_read

    def WriteAnalogF64(self, request: Any, context: Any) -> Any:
        """Write both outputs and advance the physics by one period."""
        volts = dict(zip(self._channels[request.task.name], request.write_array[:], strict=True))
        A, B = self._wiring.motor_A, self._wiring.motor_B
        V_A, V_B = volts.get(A.channel, 0.0), volts.get(B.channel, 0.0)
        self._last_output = MotorCommand(quantize_volts(V_A) / A.gain, quantize_volts(V_B) / B.gain)
        self._registers.set_outputs(self._last_output)
        self._unwritten_s = 0.0
        self._advance()
        return self._volts_written

    @property
    def _drives_on(self) -> bool:
        return self._registers.drives_on or self.faults.enable_held

    def _advance(self) -> None:
        command = self._last_output if self._drives_on else ZERO_VOLTS
        self._simulator.write(command if self._manual_input is NO_MANUAL_INPUT else self._add_manual_input(command))
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
        """Check that the watchdog is configured to disable the drives."""
        off = Level.LOW if self._wiring.drive_enable.active == "high" else Level.HIGH
        if list(request.expir_state_array) != [off.value]:
            raise CardError(DAQmxErrors.WATCHDOG_CHANNEL_EXPIRATION_STATE_NOT_SPECIFIED, "the drives would stay on")
        return pb.CfgWatchdogDOExpirStatesResponse()

    def ControlWatchdogTask(self, request: Any, context: Any) -> Any:
        """Reset the watchdog's timer, or clear its expiration."""
        self._watchdog.control(request.action_raw)
        return self._watchdog_response

    def GetWatchdogAttributeBool(self, request: Any, context: Any) -> Any:
        """Return whether the watchdog has expired."""
        return pb.GetWatchdogAttributeBoolResponse(value=self._watchdog.is_expired)

    def GetDeviceAttributeInt32Array(self, request: Any, context: Any) -> Any:
        """Return the timing modes of the analog inputs."""
        offered = [AcquisitionType.FINITE, AcquisitionType.CONTINUOUS]
        if self._has_clock:
            offered.append(AcquisitionType.HW_TIMED_SINGLE_POINT)
        return pb.GetDeviceAttributeInt32ArrayResponse(value_raw=[mode.value for mode in offered])

    def CfgSampClkTiming(self, request: Any, context: Any) -> Any:
        """Time a task by the card's clock."""
        self._clocked.add(request.task.name)
        return pb.CfgSampClkTimingResponse()

    def _wait_for_clock(self) -> None:
        now_s = time.monotonic()
        self._next_s = max(self._next_s + T_s, now_s - now_s % T_s)
        time.sleep(max(self._next_s - now_s, 0.0))

    def _rearm_safety_module(self) -> None:
        with suppress(PlantError):  # while its cause persists it stays tripped and reports that
            self._simulator.acknowledge()
        self._measurement = self._raw = None


# Virtual rig ---------------------------------------------------------------------------------------
# The rig on a virtual card, for training and tests without hardware.


class VirtualRig(Rig):
    """Rig at a virtual card: it can be pushed and loaded, and faults can be injected.

    With ``registers`` it runs in real time under their watchdog. Its timeout is that of the simulated card, because a
    virtual machine pauses for longer than a rig may be left unattended. Without ``registers`` it is stepped at any
    speed and has no watchdog process. ``has_clock``: the card offers hardware timing; None: only in real time.

    ``as_wired`` is the actual wiring of the card if it differs from ``wiring``: the rig then needs commissioning like
    any other. Otherwise it is at its zero when it is made, and may be controlled at once.
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
        return messages.virtual_card(card=super()._describe())

    def _measure_cycle(self) -> None:
        """Skip the measurement: each write would advance the simulation."""

    def _prove_watchdog(self) -> None:
        if self._has_watchdog:
            super()._prove_watchdog()
        self._watchdog_proven = True

    def card_state(self) -> CardState:
        """Return the values of the card's registers, which any process can read."""
        return self._card_registers.state()

    def read(self) -> Measurement:
        """Return the measurement with push and obstacle force. Raises PlantError."""
        m, simulator = super().read(), self._simulator
        return m._replace(F_push=simulator.F_push, F_wall=simulator.F_wall)

    def push(self, F_push: float) -> None:
        """Apply an external force [N] from the next period on."""
        self._simulator.push(F_push)

    def load(self, load: ShaftLoad) -> None:
        """Load the motors' shafts from the next period on. Raises PlantError."""
        self._simulator.load(load)

    def obstacle(self, obstacle: Obstacle | None) -> None:
        """Set the obstacle from the next period on, None removes it. Raises PlantError."""
        self._simulator.obstacle(obstacle)

    def inject(self, injected_fault: InjectedFault | None) -> None:
        """Inject a fault of the card or of the simulated plant, None clears it."""
        of_the_card = injected_fault is not None and injected_fault.kind in ONLY_OF_A_CARD
        self.card.inject(injected_fault if of_the_card else None)
        self._simulator.inject(None if of_the_card else injected_fault)
        if injected_fault is not None and injected_fault.kind is InjectedFaultKind.WATCHDOG_DEATH:
            self._card_registers.kill_watchdog()

    def apply_manual_input(self, manual_input: ManualInput) -> None:
        """Apply a simulated hand from the next period on."""
        self.card.apply_manual_input(manual_input)
