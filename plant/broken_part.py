"""One breakage at work: what a sensor pretends to read, how late a write comes."""

import math
import time

from plant.breakage import ON_SENSORS, Breakage, Broken, Sensor
from plant.interface import Measurement, PlantError, T_s

JUMPS = {Sensor.Q: 0.3, Sensor.THETA_A: 1.0, Sensor.THETA_B: 1.0, Sensor.F_A: 15.0, Sensor.F_B: 15.0}
"""How far a reading jumps [rad, N]: further than the plant can move in a tick, and not beyond a bound by itself."""

DRIFTS = {
    Sensor.Q: (20.0, 3.0),
    Sensor.THETA_A: (10.0, 2.0),
    Sensor.THETA_B: (10.0, 2.0),
    Sensor.F_A: (400.0, 100.0),
    Sensor.F_B: (400.0, 100.0),
}
"""How fast a reading drifts, and how far at most [rad/s, rad; N/s, N]; at a motor encoder, a tendon slips."""

LATE_S = 0.41
"""How long LATE keeps the loop from its next tick [s]: more than the simulator may be left alone. By no more than it
takes: on a busy machine too the loop is to be back before the card's watchdog expires."""

HANG_S = 0.65
"""How long HANG does [s]: more than the card's watchdog waits, less than the service does before it kills the loop."""


class BrokenPart:
    """One breakage at work, from construction on."""

    def __init__(self, broken: Broken) -> None:
        self._broken = broken
        self._ticks = 0
        self._frozen: float | None = None

    @property
    def description(self) -> str:
        """What is broken, in words."""
        return self._broken.words

    @property
    def keeps_from_working(self) -> bool:
        """Whether the plant cannot be read or written while this lasts."""
        return self._broken.kind in (Breakage.READ_ERROR, Breakage.WRITE_ERROR)

    def seen(self, m: Measurement) -> Measurement:
        """Return what the loop is shown of a measurement. Raises PlantError."""
        kind, sensor = self._broken.kind, self._broken.sensor
        if kind is Breakage.READ_ERROR:
            raise PlantError("the readings do not arrive (injected)")
        if kind not in ON_SENSORS:
            return m
        self._ticks += 1
        return m._replace(**{sensor.value: self._reading(getattr(m, sensor.value))})

    def _reading(self, true: float) -> float:
        sensor = self._broken.sensor
        rate, most = DRIFTS[sensor]
        drift = min(rate * T_s * self._ticks, most)
        match self._broken.kind:
            case Breakage.NO_NUMBER:
                return math.nan
            case Breakage.STUCK:
                self._frozen = true if self._frozen is None else self._frozen
                return self._frozen
            case Breakage.JUMP:
                return true + JUMPS[sensor]
            case Breakage.DRIFT_UP:
                return true + drift
            case Breakage.DRIFT_DOWN:
                # A load cell does not read less than nothing.
                return max(true - drift, 0.0) if sensor in (Sensor.F_A, Sensor.F_B) else true - drift
            case _:
                return true

    def delay_write(self) -> None:
        """Hold up the write. Raises PlantError."""
        if self._broken.kind is Breakage.WRITE_ERROR:
            raise PlantError("the outputs cannot be written (injected)")
        pause_s = {Breakage.LATE: LATE_S, Breakage.HANG: HANG_S}.get(self._broken.kind, 0.0)
        if pause_s and not self._ticks:
            self._ticks += 1
            time.sleep(pause_s)
