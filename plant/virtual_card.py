"""A DAQ card without hardware: the service that NI's device server offers, backed by the simulator.

The real nidaqmx client talks to it through an in-process channel, so what is tried is all of ``plant/daq.py``. Writing
both outputs advances the physics by one period. The registers, watchdog and drive-enable line are those of
``plant/card.py`` and outlive this process. A safety module that has tripped is re-armed by taking the drive-enable line
away, once its cause is gone.
"""

import math
import time
from collections.abc import Callable
from contextlib import suppress
from typing import Any

import session_pb2
from nidaqmx import GrpcSessionOptions
from nidaqmx._stubs import nidaqmx_pb2 as pb
from nidaqmx.constants import AcquisitionType, Level
from nidaqmx.error_codes import DAQmxErrors

from plant.breakage import Broken
from plant.card import Card
from plant.card_channels import TaskCalls
from plant.card_faults import CardFaults, miswired
from plant.card_watchdog import WatchdogTask
from plant.compiled import Specialised
from plant.hand import NO_HAND, Hand
from plant.in_process import CardError, Context, InProcess, UnknownCallError
from plant.interface import NOT_MEASURED, ZERO_VOLTS, Measurement, MotorCommand, PlantError, T_s
from plant.simulator import Simulator
from plant.terminals import at_terminals, converted, wires_of
from plant.wiring import Wiring


class VirtualCard(TaskCalls):
    """The calls that ``plant/daq.py`` makes; any other is answered as a server too old for it would.

    Method names and messages are those of NI's service.
    """

    def __init__(self, wiring: Wiring, simulator: Simulator, registers: Card, *, has_clock: bool) -> None:
        super().__init__(wiring.card.device)
        self._sound = wiring
        self._hand = NO_HAND
        self._raw: tuple[float, ...] | None = None
        self._connect(wiring)
        self._at_terminals = Specialised(at_terminals, self._wires, NOT_MEASURED, 0.0, 0.0)
        self.faults = CardFaults()
        self._held = ZERO_VOLTS
        self._unheard_s = self._next_s = 0.0
        self._simulator, self._registers = simulator, registers
        self._has_clock = has_clock
        self._clocked: set[str] = set()
        self._watchdog = WatchdogTask(registers)
        self._seen: Measurement | None = None
        self._counted_from: dict[str, float] = {}
        # Filled anew by each call: the client takes out what it needs before the next one, and making one takes longer
        # than everything else in a call.
        self._volts_read = pb.ReadAnalogF64Response(samps_per_chan_read=1)
        self._count_read = pb.ReadCounterScalarF64Response()
        self._levels_read = pb.ReadDigitalLinesResponse(samps_per_chan_read=1, num_bytes_per_samp=1)
        self._volts_written = pb.WriteAnalogF64Response(samps_per_chan_written=1)
        self._watchdog_told = pb.ControlWatchdogTaskResponse()

    def options(self) -> GrpcSessionOptions:
        """Return what makes a nidaqmx task one of this card."""
        return GrpcSessionOptions(InProcess(self), "")

    def by_hand(self, hand: Hand) -> None:
        """Let a hand act on what stands behind the terminals."""
        if self._hand.q is not None:
            self._simulator.push(0.0)
        self._hand = hand
        self._raw = None
        self._simulator.limit_tension(hand.F_limit)

    def answering(self, method: str) -> Callable[..., Any]:
        """Return what answers a call by its name, as far as what is broken lets it."""
        call, faults, context = getattr(self, method), self.faults, Context()

        def answer(request: Any, timeout: float | None = None, metadata: object = None) -> Any:
            if faults.kind is not None:
                if faults.gone and method == "WriteAnalogF64":
                    self._go_on_alone()
                faults.refuse(method)
            try:
                return call(request, context)
            except NotImplementedError:
                raise UnknownCallError from None

        return answer

    def inject(self, broken: Broken | None) -> None:
        """Break something of the card or its wires, None to mend it; counters go on from where they stand."""
        before = {counter: self._angle_counts(counter) for counter in self._counted_from}
        self.faults.inject(broken)
        self._connect(miswired(self._sound, broken))
        for counter, counts in before.items():
            jump = self._angle_counts(counter) - counts
            self._counted_from[counter] += jump if math.isfinite(jump) else 0.0

    def _connect(self, wiring: Wiring) -> None:
        """Say what is at each terminal, and its place in ``_raw``."""
        w = self._wiring = wiring
        self._wires = wires_of(w)
        self._places = {
            w.load_cell_B.channel: 1,
            w.load_cell_A.channel: 0,
            w.encoder_q.counter: 2,
            w.encoder_A.counter: 3,
            w.encoder_B.counter: 4,
        }
        enables, trips, ends = (line.active == "high" for line in (w.drive_enable, w.safety_tripped, w.end_switch))
        self._levels = {
            w.end_switch.line: lambda: w.end_switch.held(self._simulator.x.q) == ends,
            w.safety_tripped.line: lambda: (self._measured().safety_trip > 0.0) == trips,
            w.drive_enable.line: lambda: self._drives == enables,
        }
        self._raw = None

    def _go_on_alone(self) -> None:
        """Let what moves go on for a period under the volts that were written last; in stepped time, watch over it."""
        self._unheard_s += T_s
        if self._registers.watchdog_pid is None and self._unheard_s > self._watchdog.limit_s:
            self._registers.expire()
        self._move()

    # The physics behind the terminals.

    def _measured(self) -> Measurement:
        if self._seen is None:
            self._seen = self._simulator.read()
        return self._seen

    def _look(self) -> tuple[float, ...]:
        """Volts and counts at the terminals, in one compiled call for all of them."""
        hand = self._hand
        raw = self._raw = self._at_terminals(self._wires, self._measured(), hand.pull_A, hand.pull_B)
        return raw

    def _volts(self, channel: str) -> float:
        place = self._places.get(channel)
        return 0.0 if place is None else (self._raw or self._look())[place]

    def _angle_counts(self, counter: str) -> float:
        place = self._places.get(counter)
        return 0.0 if place is None else (self._raw or self._look())[place]

    def _level(self, line: str) -> bool:
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
        self._channels.let_go(request.task.name)
        self._clocked.discard(request.task.name)
        self._watchdog.let_go(request.task.name)
        return pb.ClearTaskResponse()

    def StartTask(self, request: Any, context: Any) -> Any:
        """Start; an encoder counts from where it is now, a watchdog from this moment."""
        self._watchdog.start(request.task.name)
        for channel in self._channels[request.task.name]:
            if channel.startswith("ctr"):
                self._counted_from[channel] = self._angle_counts(channel)
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
        self._volts_read.read_array[:] = [self._volts(channel) for channel in self._channels[task]]
        return self._volts_read

    def ReadCounterScalarF64(self, request: Any, context: Any) -> Any:
        """Read an encoder."""
        (counter,) = self._channels[request.task.name]
        self._count_read.value = self._angle_counts(counter) - self._counted_from.get(counter, 0.0)
        return self._count_read

    def ReadDigitalLines(self, request: Any, context: Any) -> Any:
        """Read lines, a byte each."""
        self._levels_read.read_array = bytes([self._level(line) for line in self._channels[request.task.name]])
        return self._levels_read

    def WriteAnalogF64(self, request: Any, context: Any) -> Any:
        """Write both outputs: the physics goes on by one period."""
        volts = dict(zip(self._channels[request.task.name], request.write_array[:], strict=True))
        A, B = self._wiring.motor_A, self._wiring.motor_B
        V_A, V_B = volts.get(A.channel, 0.0), volts.get(B.channel, 0.0)
        self._held = MotorCommand(converted(V_A) / A.gain, converted(V_B) / B.gain)
        self._registers.set_outputs(self._held)
        self._unheard_s = 0.0
        self._move()
        return self._volts_written

    @property
    def _drives(self) -> bool:
        return self._registers.drives or self.faults.enable_held

    def _move(self) -> None:
        driven = self._held if self._drives else ZERO_VOLTS
        self._simulator.write(driven if self._hand is NO_HAND else self._handled(driven))
        self._seen = self._raw = None
        self._registers.show_trip(self._measured().safety_trip > 0.0)

    def _handled(self, driven: MotorCommand) -> MotorCommand:
        x = self._simulator.x
        if self._hand.q is not None:
            self._simulator.push(self._hand.push(x))
        turned = self._hand.turning(x)
        return MotorCommand(driven.u_A + turned.u_A, driven.u_B + turned.u_B)

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
        return self._watchdog_told

    def GetWatchdogAttributeBool(self, request: Any, context: Any) -> Any:
        """Tell whether it has expired."""
        return pb.GetWatchdogAttributeBoolResponse(value=self._watchdog.expired)

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
        self._seen = self._raw = None
