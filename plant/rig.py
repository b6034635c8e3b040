"""Rig behind a DAQ card as a Plant: converts between volts, counts and SI units."""

import math
import statistics
import time
from contextlib import suppress
from typing import Final

from plant import messages
from plant.daq import Daq, Raw
from plant.interface import (
    NO_RAW,
    ZERO_VOLTS,
    InjectedFault,
    Measurement,
    MotorCommand,
    PlantError,
    RawReading,
    ShaftLoad,
    require_numbers,
)
from plant.load_cell import LoadCell
from plant.safety_card import Card, CardState, Stillness
from plant.wiring import Wiring

UNATTENDED = 0.8
"""Fraction of the watchdog's time that the loop may be late before it stops."""

CYCLE_MAX_S = 0.7e-3
"""Longest time of one read and write [s]: the rest of the period is for the control law."""

TRIED_CYCLES = 50
"""Number of cycles in the timing test when the card is opened."""

_PROOF_S = 0.3
"""Time that the proof test of the watchdog may take beyond the watchdog's time [s]."""

_BEGINNINGS = 3
"""Attempts to start the watchdog on a machine whose pauses are longer than the watchdog's time."""

_SETTLING_S = 0.01
"""Response time of the safety module to the drive-enable line [s]."""

# Built once, because the control loop compares them at each tick.
_CELLS_NOT_MEASURED: Final = messages.load_cells_not_measured()
_DIRECTIONS_NOT_PROVEN: Final = messages.directions_not_proven()
_ZERO_NOT_SET: Final = messages.zero_not_set()


class Rig:
    """Two motors, two load cells and three encoders at one card.

    Outputs are at zero volts until the first write. ``server`` is the address of its device server, if any.
    ``registers`` show the state of the card to other processes. An encoder counts from its position at the start;
    ``zero`` sets that position. With ``drives_off`` people may be working at the rig when it is opened.
    """

    stepped = False
    pushes = False
    loads_shafts = False

    def __init__(
        self,
        wiring: Wiring,
        daq: Daq,
        registers: Card | None = None,
        *,
        directions_proven: bool = False,
        load_cells_measured: bool = False,
        server: str = "",
        drives_off: bool = False,
        wired: str = "",
    ) -> None:
        self.wiring = wiring
        self.wired = wired
        self.raw: RawReading = NO_RAW
        self.description = ""
        self.paces_loop = False
        self.unattended_max_s = UNATTENDED * wiring.card.watchdog_s
        self._daq = daq
        self._registers = registers
        self._server = server
        self._scales = tuple(e.radians_per_count for e in (wiring.encoder_q, wiring.encoder_A, wiring.encoder_B))
        self._zeros = (0.0, 0.0, 0.0)
        self._cells = LoadCell(wiring.load_cell_A), LoadCell(wiring.load_cell_B)
        self._gains = wiring.motor_A.gain, wiring.motor_B.gain
        self._last_reading: Raw | None = None
        self._tripped = False
        self.zeroed = False
        self._directions_proven = directions_proven
        self._cells_measured = load_cells_measured
        self._last_command = ZERO_VOLTS
        self._drives_requested = not drives_off
        self._watchdog_proven = False

    @property
    def unproven(self) -> str:
        """Why its motors may not be driven, even slowly to an end switch.

        Empty if they may.
        """
        if not self._cells_measured:  # first, because a new calibration restarts the loop, which loses the zero
            return _CELLS_NOT_MEASURED
        if not self._directions_proven:
            return _DIRECTIONS_NOT_PROVEN
        return ""

    @property
    def unready(self) -> str:
        """Why the loop may not be closed yet; empty if it may."""
        if self._cells_measured and not self.zeroed:
            return _ZERO_NOT_SET
        return self.unproven

    @property
    def at_end(self) -> bool:
        """Whether the joint held its end switch in the newest reading."""
        return self._last_reading is not None and self._last_reading.at_end

    def prove_directions(self, *, proven: bool) -> None:
        """Set whether the motors are known to turn as stated in the wiring file."""
        self._directions_proven = proven

    def switch_drives(self, *, on: bool) -> None:
        """Set the drive-enable line and check it by reading it back.

        Switched off, the line stays off across a reset too, and the watchdog is still fed. If the watchdog has not been
        tested since the card was opened, it is tested at zero volts before the drives are switched on, which takes the
        watchdog's time. A watchdog that has expired has disabled the line already. Raises PlantError.
        """
        self._drives_requested = False  # also if the card does not obey: nothing may switch the drives on automatically
        try:
            if on and not self._watchdog_proven:
                self._prove_watchdog()
                self._start_outputs(drives=False)
            if on or not self._daq.is_expired:
                self._daq.enable(on=on)
            self._require_drive_enable(on=on)
        except PlantError:
            with suppress(PlantError):  # a line in an unknown state must not be left on
                self._daq.enable(on=False)
            if not self._watchdog_proven:
                with suppress(PlantError):  # the watchdog needs feeding
                    self._start_outputs(drives=False)
            raise
        self._drives_requested = on

    def _require_drive_enable(self, *, on: bool) -> None:
        if self._daq.is_enabled is not on:
            raise PlantError(messages.drive_enable_not_switched(on=on))

    def open(self) -> None:
        """Reserve the card, test its watchdog and enable the drives. Raises PlantError.

        If the drives are to stay off, the line is checked instead, and the watchdog is tested when they are switched
        on.
        """
        try:
            self._daq.open()
            self.paces_loop = self._daq.is_timed_by_card
            self.description = self._describe()
            self._watchdog_proven = False
            if self._drives_requested:
                self._prove_watchdog()
            self._start_outputs(drives=self._drives_requested)
            if not self._drives_requested:
                self._require_drive_enable(on=False)
            if not self.paces_loop:  # a card's clock ends the cycle itself
                self._measure_cycle()
        except BaseException:
            self.close()
            raise

    def _describe(self) -> str:
        return messages.wired_card(
            wiring=self.wiring.title, device=self.wiring.card.device, address=self._server, timing=self._daq.timing
        )

    def _prove_watchdog(self) -> None:
        """Test that the watchdog disables the drive-enable line, not only reports it."""
        self._start_outputs(drives=True)
        line = self.wiring.drive_enable.line
        if not (self._daq.is_enabled or self._daq.is_expired):
            raise PlantError(messages.drive_enable_reads_off(line=line))
        within_s = self.wiring.card.watchdog_s + _PROOF_S
        waiting = Stillness(_SETTLING_S)
        while self._daq.is_enabled or not self._daq.is_expired:
            if waiting.update(None) > within_s:
                raise PlantError(
                    messages.watchdog_left_drives_on(line=line, within_s=within_s)
                    if self._daq.is_expired
                    else messages.watchdog_did_not_expire(within_s=within_s)
                )
            time.sleep(_SETTLING_S)
        self._watchdog_proven = True

    def _measure_cycle(self) -> None:
        cycles_s = []
        for _ in range(TRIED_CYCLES):
            begun_s = time.perf_counter()
            self.read()
            self.write(ZERO_VOLTS)
            cycles_s.append(time.perf_counter() - begun_s)
        cycle_s, longest_s = statistics.median(cycles_s), max(cycles_s)
        if cycle_s > CYCLE_MAX_S:
            raise PlantError(
                messages.server_too_slow(
                    address=self._server,
                    cycle_s=cycle_s,
                    longest_s=longest_s,
                    cycles=TRIED_CYCLES,
                    maximum_s=CYCLE_MAX_S,
                )
                if self._server
                else messages.card_too_slow(
                    cycle_s=cycle_s, longest_s=longest_s, cycles=TRIED_CYCLES, maximum_s=CYCLE_MAX_S
                )
            )
        self.description = messages.card_with_cycle(card=self.description, cycle_s=cycle_s)

    def _start_outputs(self, *, drives: bool) -> None:
        """Write zero volts, start the watchdog, then set the drive-enable line.

        The order matters: an expired watchdog locks the line.
        """
        self._write_outputs(ZERO_VOLTS)
        for attempts_left in reversed(range(_BEGINNINGS)):
            self._daq.start_watchdog()
            try:
                self._daq.enable(on=drives)
                break
            except PlantError:
                # only a pause of this machine justifies another attempt
                if not (attempts_left and self._daq.is_expired):
                    raise
        self._update_registers()

    def read(self) -> Measurement:
        """Return the current measurement; a saturated load cell reads NaN.

        Raises PlantError.
        """
        V_A, V_B, n_q, n_A, n_B, self._tripped, _ = self._last_reading = self._daq.read()
        self.raw = RawReading(V_A, V_B, n_q, n_A, n_B)
        (to_q, to_A, to_B), (q, theta_A, theta_B) = self._scales, self._zeros
        return Measurement(
            q=q + to_q * n_q,
            theta_A=theta_A + to_A * n_A,
            theta_B=theta_B + to_B * n_B,
            F_A=self._cells[0].force(V_A),
            F_B=self._cells[1].force(V_B),
            S_true=math.nan,
            F_push=0.0,
            safety_trip=1.0 if self._tripped else 0.0,
            F_wall=math.nan,
        )

    def zero(self, q: float, theta_A: float, theta_B: float, *, at_switch: bool = False) -> None:
        """Set the current positions of joint and motors [rad], from the next reading on.

        Raises PlantError before the first reading, and with ``at_switch`` if the end switch is not held.
        """
        if self._last_reading is None:
            raise PlantError(messages.no_reading_yet())
        if at_switch and not self._last_reading.at_end:
            raise PlantError(messages.end_switch_not_held())
        counts = self._last_reading.n_q, self._last_reading.n_A, self._last_reading.n_B
        angles = q, theta_A, theta_B
        q_0, A_0, B_0 = (
            angle - scale * count for angle, scale, count in zip(angles, self._scales, counts, strict=True)
        )
        self._zeros = q_0, A_0, B_0
        self.zeroed = True

    def write(self, command: MotorCommand) -> None:
        """Write the voltages and feed the watchdog.

        Raises PlantError, or WatchdogExpiredError once the watchdog has disabled the drives.
        """
        require_numbers(command)
        try:
            self._write_outputs(command)
            self._daq.feed_watchdog()
        finally:
            self._update_registers()

    def _write_outputs(self, command: MotorCommand) -> None:
        self._daq.write(self._gains[0] * command.u_A, self._gains[1] * command.u_B)
        self._last_command = command  # if a write fails, the card keeps the previous voltages

    def push(self, F_push: float) -> None:
        """Raise PlantError: a rig is pushed by hand."""
        raise PlantError(messages.rig_cannot_be_pushed())

    def load(self, load: ShaftLoad) -> None:
        """Raise PlantError: the rig cannot load its shafts."""
        raise PlantError(messages.rig_cannot_load_shafts())

    def inject(self, injected_fault: InjectedFault | None) -> None:
        """Raise PlantError: faults are not injected into a rig."""
        raise PlantError(messages.rig_without_fault_injection())

    def acknowledge(self) -> None:
        """Restart the watchdog; enable the drives unless they are switched off.

        Raises PlantError while the safety module is tripped.
        """
        self._daq.clear_expiration()
        self._daq.enable(on=False)
        time.sleep(_SETTLING_S)
        if self._daq.is_enabled:
            raise PlantError(messages.drive_enable_stays_on(line=self.wiring.drive_enable.line))
        if self._daq.read().tripped:
            raise PlantError(messages.safety_module_tripped())
        self._start_outputs(drives=self._drives_requested)

    def close(self) -> None:
        """Write zero volts, disable the drives and release the card. Safe to call twice."""
        with suppress(PlantError):
            self._write_outputs(ZERO_VOLTS)
        self._daq.close()
        self._update_registers()

    def _update_registers(self) -> None:
        if self._registers is not None:
            daq, tripped = self._daq, self._tripped
            flags = daq.is_watchdog_started, daq.drives_on, daq.has_expired, tripped, False, True
            self._registers.mirror(CardState(0, 0, *flags, self.wiring.card.watchdog_s, *self._last_command))
