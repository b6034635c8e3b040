"""A DAQ card without hardware: the service that NI's device server offers, backed by the simulator.

The real nidaqmx client talks to it through an in-process channel, so what is tried is all of ``plant/daq.py``. Writing
both outputs advances the physics by one period. The registers, watchdog and drive-enable line are those of
``plant/card.py`` and outlive this process. A safety module that has tripped is re-armed by taking the drive-enable line
away, once its cause is gone.
"""

import math
import time
from contextlib import suppress
from typing import Any

import session_pb2
from nidaqmx import GrpcSessionOptions
from nidaqmx._stubs import nidaqmx_pb2 as pb
from nidaqmx._stubs import nidaqmx_pb2_grpc
from nidaqmx.constants import AcquisitionType, Level, WDTTaskAction
from nidaqmx.error_codes import DAQmxErrors

from plant.card import Card, WatchdogExpiredError
from plant.daq import RANGE_V
from plant.hand import NO_HAND, Hand
from plant.in_process import CardError, InProcess
from plant.interface import ZERO_VOLTS, Measurement, MotorCommand, PlantError, T_s
from plant.simulator import Simulator
from plant.wiring import LoadCellWiring, Wiring

_STEP_V = 2.0 * RANGE_V / 2**16
"""One code of the 16-bit converters [V]."""


class VirtualCard(nidaqmx_pb2_grpc.NiDAQmxServicer):  # type: ignore[misc]  # made by a generator, without types
    """The calls that ``plant/daq.py`` makes; any other is answered as a server too old for it would.

    Method names and messages are those of NI's service.
    """

    def __init__(self, wiring: Wiring, simulator: Simulator, registers: Card, *, has_clock: bool) -> None:
        self._wiring = wiring
        self._simulator = simulator
        self._registers = registers
        self._has_clock = has_clock
        self._clocked: set[str] = set()
        self._next_s = 0.0
        self._watchdog_s: dict[str, float] = {}
        self._channels: dict[str, list[str]] = {}
        self._owner: dict[str, str] = {}
        self._seen: Measurement | None = None
        self._counted_from: dict[str, float] = {}
        self._hand = NO_HAND

    def options(self) -> GrpcSessionOptions:
        """Return what makes a nidaqmx task one of this card."""
        return GrpcSessionOptions(InProcess(self), "")

    def by_hand(self, hand: Hand) -> None:
        """Let a hand act on what stands behind the terminals."""
        if self._hand.q is not None:
            self._simulator.push(0.0)
        self._hand = hand
        self._simulator.limit_tension(hand.F_limit)

    # The physics behind the terminals.

    def _measured(self) -> Measurement:
        if self._seen is None:
            self._seen = self._simulator.read()
        return self._seen

    def _volts(self, channel: str) -> float:
        m = self._measured()
        F_A, F_B = m.F_A + self._hand.pull_A, m.F_B + self._hand.pull_B
        for wired, F in ((self._wiring.load_cell_A, F_A), (self._wiring.load_cell_B, F_B)):
            if wired.channel == channel:
                return _converted(_volts_of(wired, F))
        return 0.0

    def _angle_counts(self, counter: str) -> float:
        w, m = self._wiring, self._measured()
        for wired, angle in ((w.encoder_q, m.q), (w.encoder_A, m.theta_A), (w.encoder_B, m.theta_B)):
            if wired.counter == counter:
                return wired.direction * round(angle * wired.counts_per_rev / (2.0 * math.pi))
        return 0.0

    def _level(self, line: str) -> bool:
        w = self._wiring
        if line == w.safety_tripped.line:
            return (self._measured().safety_trip > 0.0) == (w.safety_tripped.active == "high")
        if line != w.end_switch.line:
            return False
        return w.end_switch.held(self._simulator.x.q) == (w.end_switch.active == "high")

    # Tasks.

    def CreateTask(self, request: Any, context: Any) -> Any:
        """Make a task; its name is free."""
        if request.session_name in self._channels:
            raise CardError(DAQmxErrors.DUPLICATE_TASK, f"Task name: {request.session_name} is taken already")
        self._channels[request.session_name] = []
        return pb.CreateTaskResponse(task=session_pb2.Session(name=request.session_name), new_session_initialized=True)

    def CreateWatchdogTimerTaskEx(self, request: Any, context: Any) -> Any:
        """Make the watchdog's task."""
        self._require_device(request.device_name)
        self._channels[request.session_name] = []
        self._watchdog_s[request.session_name] = request.timeout
        return pb.CreateWatchdogTimerTaskExResponse(
            task=session_pb2.Session(name=request.session_name), new_session_initialized=True
        )

    def ClearTask(self, request: Any, context: Any) -> Any:
        """Let go of a task's channels."""
        for channel in self._channels.pop(request.task.name, []):
            self._owner.pop(channel, None)
        self._clocked.discard(request.task.name)
        if self._watchdog_s.pop(request.task.name, None) is not None:
            self._registers.disarm()
        return pb.ClearTaskResponse()

    def StartTask(self, request: Any, context: Any) -> Any:
        """Start; an encoder counts from where it is now, a watchdog from this moment."""
        if (limit_s := self._watchdog_s.get(request.task.name)) is not None:
            self._registers.watch_from_now(limit_s)
        for channel in self._channels[request.task.name]:
            if channel.startswith("ctr"):
                self._counted_from[channel] = self._angle_counts(channel)
        return pb.StartTaskResponse()

    def StopTask(self, request: Any, context: Any) -> Any:
        """Stop."""
        return pb.StopTaskResponse()

    def GetTaskAttributeString(self, request: Any, context: Any) -> Any:
        """Tell a task's name."""
        return pb.GetTaskAttributeStringResponse(value=request.task.name)

    def GetSystemInfoAttributeUInt32(self, request: Any, context: Any) -> Any:
        """Tell the driver's version: none, as there is no driver."""
        return pb.GetSystemInfoAttributeUInt32Response(value=0)

    def CreateAIVoltageChan(self, request: Any, context: Any) -> Any:
        """Take analog inputs."""
        self._take(request.task.name, request.physical_channel, "ai", 32)
        return pb.CreateAIVoltageChanResponse()

    def CreateAOVoltageChan(self, request: Any, context: Any) -> Any:
        """Take analog outputs."""
        self._take(request.task.name, request.physical_channel, "ao", 4)
        return pb.CreateAOVoltageChanResponse()

    def CreateCIAngEncoderChan(self, request: Any, context: Any) -> Any:
        """Take a counter."""
        self._take(request.task.name, request.counter, "ctr", 4)
        return pb.CreateCIAngEncoderChanResponse()

    def CreateDIChan(self, request: Any, context: Any) -> Any:
        """Take lines to read."""
        self._take(request.task.name, request.lines, "port", 48)
        return pb.CreateDIChanResponse()

    def CreateDOChan(self, request: Any, context: Any) -> Any:
        """Take lines to write."""
        self._take(request.task.name, request.lines, "port", 48)
        return pb.CreateDOChanResponse()

    # Reading and writing.

    def ReadAnalogF64(self, request: Any, context: Any) -> Any:
        """Read the load cells; a clocked task waits for the next edge of the card's clock."""
        if request.task.name in self._clocked:
            self._wait_for_clock()
        volts = [self._volts(channel) for channel in self._channels[request.task.name]]
        return pb.ReadAnalogF64Response(read_array=volts, samps_per_chan_read=1)

    def ReadCounterScalarF64(self, request: Any, context: Any) -> Any:
        """Read an encoder."""
        (counter,) = self._channels[request.task.name]
        counts = self._angle_counts(counter) - self._counted_from.get(counter, 0.0)
        return pb.ReadCounterScalarF64Response(value=counts)

    def ReadDigitalLines(self, request: Any, context: Any) -> Any:
        """Read lines, a byte each."""
        levels = bytes(self._level(line) for line in self._channels[request.task.name])
        return pb.ReadDigitalLinesResponse(read_array=levels, samps_per_chan_read=1, num_bytes_per_samp=1)

    def WriteAnalogF64(self, request: Any, context: Any) -> Any:
        """Write both outputs: the physics goes on by one period."""
        volts = dict(zip(self._channels[request.task.name], request.write_array, strict=True))
        w = self._wiring
        u_A, u_B = (_converted(volts[motor.channel]) / motor.gain for motor in (w.motor_A, w.motor_B))
        self._registers.set_outputs(MotorCommand(u_A, u_B))
        driven = MotorCommand(u_A, u_B) if self._registers.drives else ZERO_VOLTS
        self._simulator.write(driven if self._hand == NO_HAND else self._handled(driven))
        self._seen = None
        self._registers.show_trip(self._measured().safety_trip > 0.0)
        return pb.WriteAnalogF64Response(samps_per_chan_written=1)

    def _handled(self, driven: MotorCommand) -> MotorCommand:
        x = self._simulator.x
        if self._hand.q is not None:
            self._simulator.push(self._hand.push(x))
        turned = self._hand.turning(x)
        return MotorCommand(driven.u_A + turned.u_A, driven.u_B + turned.u_B)

    def WriteDigitalLines(self, request: Any, context: Any) -> Any:
        """Write the drive-enable line."""
        if self._channels[request.task.name] == [self._wiring.drive_enable.line]:
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
        if request.action_raw == WDTTaskAction.CLEAR_EXPIRATION.value:
            self._registers.clear_expiration()
        else:
            try:
                self._registers.feed()
            except WatchdogExpiredError:
                text = "The watchdog timer has expired, and cannot be reset before its expiration is cleared"
                raise CardError(DAQmxErrors.CANT_RESET_EXPIRED_WATCHDOG, text) from None
        return pb.ControlWatchdogTaskResponse()

    def GetWatchdogAttributeBool(self, request: Any, context: Any) -> Any:
        """Tell whether it has expired."""
        return pb.GetWatchdogAttributeBoolResponse(value=self._registers.state().expired)

    def GetDeviceAttributeInt32Array(self, request: Any, context: Any) -> Any:
        """Tell how analog inputs can be timed."""
        offered = [AcquisitionType.FINITE, AcquisitionType.CONTINUOUS]
        if self._has_clock:
            offered.append(AcquisitionType.HW_TIMED_SINGLE_POINT)
        return pb.GetDeviceAttributeInt32ArrayResponse(value=[mode.value for mode in offered])

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
        self._seen = None

    def _take(self, task: str, names: str, kind: str, count: int) -> None:
        for name in names.replace(" ", "").split(","):
            device, _, channel = name.partition("/")
            self._require_device(device)
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
            self._channels[task].append(channel)

    def _require_device(self, device: str) -> None:
        if device != self._wiring.card.device:
            raise CardError(DAQmxErrors.INVALID_DEVICE_ID, f"Device identifier is invalid: {device}")


def _volts_of(wired: LoadCellWiring, F: float) -> float:
    if not wired.table:
        return wired.offset + F / wired.slope
    points = sorted((newtons, volts) for volts, newtons in wired.table)
    below = [point for point in points if point[0] <= F] or points[:1]
    above = [point for point in points if point[0] > F] or points[-1:]
    (F_0, V_0), (F_1, V_1) = below[-1], above[0]
    return V_0 if F_1 == F_0 else V_0 + (V_1 - V_0) * (F - F_0) / (F_1 - F_0)


def _converted(V: float) -> float:
    """Volts as a 16-bit converter gives them, at its end where they are beyond."""
    return min(max(round(V / _STEP_V), -(2**15)), 2**15 - 1) * _STEP_V
