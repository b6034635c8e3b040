"""DAQ card through NI-DAQmx: tasks, volts and counts, drive enable, watchdog.

Only this module accesses a card; other modules imitate one. Conversion to SI units is in ``plant/rig.py``. On an X
Series card the watchdog covers digital lines but no analog outputs, so it disables the drive-enable line.
"""

from contextlib import ExitStack, suppress
from typing import TYPE_CHECKING, Any, Final, NamedTuple, NoReturn, TypeVar

import numpy as np
from nidaqmx import DaqError, Task
from nidaqmx.constants import AcquisitionType, AngleUnits, EncoderType, Level, LineGrouping, TerminalConfiguration
from nidaqmx.error_codes import DAQmxErrors
from nidaqmx.errors import DaqFunctionNotSupportedError, DaqNotFoundError, DaqNotSupportedError, RpcError
from nidaqmx.stream_readers import (
    AnalogMultiChannelReader,
    CounterReader,
    DigitalMultiChannelReader,
    DigitalSingleChannelReader,
)
from nidaqmx.stream_writers import AnalogMultiChannelWriter, DigitalSingleChannelWriter
from nidaqmx.system import Device, System
from nidaqmx.system.watchdog import WatchdogTask
from nidaqmx.types import DOExpirationState

from plant import messages
from plant.interface import PlantError, T_s
from plant.safety_card import WatchdogExpiredError
from plant.terminals import RANGE_V
from plant.wiring import EncoderWiring, Wiring

if TYPE_CHECKING:
    from collections.abc import Callable

    from nidaqmx import GrpcSessionOptions

_Stream = TypeVar("_Stream", bound=Any)

_TIMEOUT_S: Final = 0.01
"""Timeout of one call to the card [s]: more than a few periods would be a fault anyway."""

_RATE_Hz: Final = 1.0 / T_s
_FAILED: Final = (DaqError, RpcError, DaqNotFoundError, DaqNotSupportedError, DaqFunctionNotSupportedError)
_EXPIRED: Final = (DAQmxErrors.CANT_RESET_EXPIRED_WATCHDOG, DAQmxErrors.WRITE_FAILED_BECAUSE_WATCHDOG_EXPIRED)


def read_driver_version() -> str:
    """Return name and version of NI's driver and its cards. Raises PlantError."""
    try:
        system = System.local()
        version = system.driver_version
        cards = [(device.name, device.product_type) for device in system.devices]
    except _FAILED as error:
        _raise_plant_error(error)
    return messages.driver_version(major=version.major_version, minor=version.minor_version, cards=cards)


class Raw(NamedTuple):
    """One reading of the card: load cell volts, encoder counts, levels of the lines."""

    V_A: float
    V_B: float
    n_q: float
    n_A: float
    n_B: float
    tripped: bool
    at_end: bool


class Daq:
    """DAQ card; opens at zero volts with the drives off.

    Methods raise PlantError with the message of NI-DAQmx.
    """

    def __init__(self, wiring: Wiring, options: "Callable[[], GrpcSessionOptions] | None" = None) -> None:
        self._wiring = wiring
        self._options = options
        self._tasks = ExitStack()
        self._volts = np.zeros(2)
        self._levels = np.zeros(2, dtype=bool)
        self._out = np.zeros(2)
        self._active_high = wiring.safety_tripped.active == "high", wiring.end_switch.active == "high"
        self._outputs: AnalogMultiChannelWriter | None = None
        self._enable: DigitalSingleChannelWriter | None = None
        self._watchdog: WatchdogTask | None = None
        self.is_timed_by_card = False
        self.is_watchdog_started = False
        self.drives_on = False
        self.has_expired = False

    @property
    def timing(self) -> str:
        """How the card is timed, as a phrase."""
        if self.is_timed_by_card:
            return messages.timed_by_card()
        if self._wiring.card.timing == "hardware":
            return messages.timed_by_machine()
        return messages.timed_on_demand()

    def open(self) -> None:
        """Reserve the card: zero volts, drives off, watchdog configured but not started."""
        w, device = self._wiring, self._wiring.card.device
        try:
            out = self._task("outputs")
            for motor in (w.motor_A, w.motor_B):
                out.ao_channels.add_ao_voltage_chan(f"{device}/{motor.channel}", min_val=-RANGE_V, max_val=RANGE_V)
            self._outputs = _disable_checks(AnalogMultiChannelWriter(out.out_stream, auto_start=True))
            self.write(0.0, 0.0)
            enable = self._task("drive_enable")
            enable.do_channels.add_do_chan(f"{device}/{w.drive_enable.line}")
            self._enable = _disable_checks(DigitalSingleChannelWriter(enable.out_stream, auto_start=True))
            self._enabled = DigitalSingleChannelReader(enable.in_stream)
            self.enable(on=False)
            cells = self._task("load_cells")
            for cell in (w.load_cell_A, w.load_cell_B):
                cells.ai_channels.add_ai_voltage_chan(
                    f"{device}/{cell.channel}",
                    terminal_config=TerminalConfiguration.DIFF,
                    min_val=-RANGE_V,
                    max_val=RANGE_V,
                )
            self.is_timed_by_card = w.card.timing == "hardware" and self._has_hardware_clock()
            if self.is_timed_by_card:
                mode = AcquisitionType.HW_TIMED_SINGLE_POINT
                cells.timing.cfg_samp_clk_timing(_RATE_Hz, sample_mode=mode, samps_per_chan=1)
            self._cells = _disable_checks(AnalogMultiChannelReader(cells.in_stream))
            self._counters = [
                self._counter(name, encoder)
                for name, encoder in (("q", w.encoder_q), ("A", w.encoder_A), ("B", w.encoder_B))
            ]
            lines = self._task("lines")
            both = ",".join(f"{device}/{wired.line}" for wired in (w.safety_tripped, w.end_switch))
            lines.di_channels.add_di_chan(both, line_grouping=LineGrouping.CHAN_PER_LINE)
            self._lines = _disable_checks(DigitalMultiChannelReader(lines.in_stream))
            for task in (cells, lines):
                task.start()
            self._watchdog = self._tasks.enter_context(
                WatchdogTask(device, "watchdog", w.card.watchdog_s, grpc_options=self._session())
            )
            off = Level.LOW if w.drive_enable.active == "high" else Level.HIGH
            self.is_watchdog_started = False
            self._watchdog.cfg_watchdog_do_expir_states([DOExpirationState(f"{device}/{w.drive_enable.line}", off)])
        except PlantError:
            self.close()
            raise
        except _FAILED as error:
            self.close()
            _raise_plant_error(error)

    def _has_hardware_clock(self) -> bool:
        device = Device(self._wiring.card.device, grpc_options=self._session())
        return AcquisitionType.HW_TIMED_SINGLE_POINT in device.ai_samp_modes

    def read(self) -> Raw:
        """Read all inputs once."""
        if self._outputs is None:
            raise PlantError(messages.card_not_open())
        try:
            self._cells.read_one_sample(self._volts, _TIMEOUT_S)
            n_q = self._counters[0].read_one_sample_double(_TIMEOUT_S)
            n_A = self._counters[1].read_one_sample_double(_TIMEOUT_S)
            n_B = self._counters[2].read_one_sample_double(_TIMEOUT_S)
            self._lines.read_one_sample_one_line(self._levels, _TIMEOUT_S)
        except _FAILED as error:
            _raise_plant_error(error)
        V_A, V_B = self._volts.tolist()
        tripped, at_end = self._levels.tolist()
        trips_high, ends_high = self._active_high
        return Raw(
            V_A=V_A, V_B=V_B, n_q=n_q, n_A=n_A, n_B=n_B, tripped=tripped == trips_high, at_end=at_end == ends_high
        )

    def write(self, V_A: float, V_B: float) -> None:
        """Set the voltages of the analog outputs [V]."""
        if self._outputs is None:
            raise PlantError(messages.card_not_open())
        self._out[0], self._out[1] = V_A, V_B
        try:
            self._outputs.write_one_sample(self._out, _TIMEOUT_S)
        except _FAILED as error:
            _raise_plant_error(error)

    def feed_watchdog(self) -> None:
        """Reset the watchdog's timer. Raises WatchdogExpiredError if it has expired."""
        if self._watchdog is None:
            raise PlantError(messages.card_not_open())
        try:
            self._watchdog.reset_timer()
        except DaqError as error:
            if error.error_type in _EXPIRED:
                self.has_expired, self.drives_on = True, False
                watchdog_s = self._wiring.card.watchdog_s
                raise WatchdogExpiredError(messages.watchdog_expired(watchdog_s=watchdog_s)) from error
            _raise_plant_error(error)
        except _FAILED as error:
            _raise_plant_error(error)

    def enable(self, *, on: bool) -> None:
        """Set the drive-enable line."""
        if self._enable is None:
            raise PlantError(messages.card_not_open())
        try:
            self._enable.write_one_sample_one_line(on == (self._wiring.drive_enable.active == "high"), _TIMEOUT_S)
            self.drives_on = on
        except _FAILED as error:
            _raise_plant_error(error)

    @property
    def is_enabled(self) -> bool:
        """State of the drive-enable line as the card reads it back."""
        try:
            level = bool(self._enabled.read_one_sample_one_line(_TIMEOUT_S))
            return level == (self._wiring.drive_enable.active == "high")
        except _FAILED as error:
            _raise_plant_error(error)

    def start_watchdog(self) -> None:
        """Start the watchdog, cleared if expired; the drives stay off until enabled."""
        if self._watchdog is None:
            raise PlantError(messages.card_not_open())
        try:
            if self.is_watchdog_started:  # NI-DAQmx cannot start a running task, nor query one that does not run
                self.clear_expiration()
                self._watchdog.stop()
            self._watchdog.start()
            self.is_watchdog_started = True
        except _FAILED as error:
            _raise_plant_error(error)

    def clear_expiration(self) -> None:
        """Clear the watchdog's expiration; the drives stay off until enabled."""
        if self._watchdog is None:
            raise PlantError(messages.card_not_open())
        try:
            if self.is_expired:
                self._watchdog.clear_expiration()
                self.drives_on = False
            self.has_expired = False
        except _FAILED as error:
            _raise_plant_error(error)

    @property
    def is_expired(self) -> bool:
        """Whether the watchdog has expired and disabled the drives."""
        try:
            return self.is_watchdog_started and self._watchdog is not None and bool(self._watchdog.expired)
        except _FAILED as error:
            _raise_plant_error(error)

    def close(self) -> None:
        """Set zero volts and drives off, then release the card, ignoring errors.

        Safe to call twice.
        """
        with suppress(PlantError):
            self.write(0.0, 0.0)
        with suppress(PlantError):
            if self.is_expired:  # the line is off and locked
                self.has_expired, self.drives_on = True, False
            else:
                self.enable(on=False)
        with suppress(*_FAILED):
            self._tasks.close()
            self.is_watchdog_started = False
        self._outputs = self._enable = self._watchdog = None

    def _task(self, name: str) -> Task:
        return self._tasks.enter_context(Task(name, grpc_options=self._session()))

    def _counter(self, name: str, encoder: EncoderWiring) -> CounterReader:
        task = self._task(f"encoder_{name}")
        task.ci_channels.add_ci_ang_encoder_chan(
            f"{self._wiring.card.device}/{encoder.counter}",
            decoding_type=EncoderType.X_4,
            units=AngleUnits.TICKS,
            pulses_per_rev=round(encoder.counts_per_rev / 4.0),
        )
        task.start()
        return _disable_checks(CounterReader(task.in_stream))

    def _session(self) -> Any:
        return None if self._options is None else self._options()


def _disable_checks(stream: _Stream) -> _Stream:
    """Disable the driver's shape checks, which cost a call per tick.

    The arrays are this module's own and keep their shape.
    """
    stream.verify_array_shape = False
    return stream


def _raise_plant_error(error: Exception) -> NoReturn:
    if isinstance(error, (DaqNotFoundError, DaqNotSupportedError)):
        raise PlantError(messages.driver_not_installed()) from error
    raise PlantError(messages.card_failed(reason=" ".join(str(error).split()))) from error
