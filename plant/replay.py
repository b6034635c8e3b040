"""A recording played back as a Plant: what was measured comes again, whatever is written."""

from typing import NamedTuple

import numpy as np

from plant.breakage import Broken
from plant.interface import NO_RAW, Measurement, MotorCommand, PlantError, RawReading, ShaftLoad, require_numbers
from plant.recording import Recording

SAFETY_MODULE = 12.0
"""Number of the safety module's trip in the list of faults, as the column ``fault`` has it."""

_REFUSED = "a recording is what it is: nothing can {} in it; choose the simulator for that"


class Difference(NamedTuple):
    """Largest difference between what was written and what the recording has [V]; at which output, at which t [s]."""

    volts: float
    output: str
    t: float


class Replay:
    """A plant that moves on by one sample at each write and reads as it did then.

    It begins with its first sample when it is opened. At its end one reading fails and says so, with how far the
    voltages written were from those recorded; from then on it stands at its first sample until it is acknowledged,
    which plays it again. The encoders' zeros are those of the recording, which stays at hand as ``recording``.
    """

    paces_loop = False
    pushes = False
    loads_shafts = False
    stepped = True
    unattended_max_s = 0.4
    unready = ""

    def __init__(self, recording: Recording) -> None:
        self.recording, columns = recording, recording.columns
        names = ("q", "theta_A", "theta_B", "F_A", "F_B", "S_true", "F_push")
        F_wall = columns["F_wall"]
        trips = (columns["fault"] == SAFETY_MODULE).astype(np.float64)
        self._measured = np.column_stack([*(columns[name] for name in names), trips, F_wall])
        self._ended = False
        self._raw = np.column_stack([columns[name] for name in RawReading._fields])
        self._written = np.column_stack([columns["u_A"], columns["u_B"]])
        self._t = columns["t"]
        self.description = f"replay of {recording.path.name}, {recording.duration_s:.3f} s"
        self.samples = len(recording)
        self.sample = 0
        self.difference = Difference(0.0, "u_A", float(self._t[0]))
        self.raw = NO_RAW

    def open(self) -> None:
        """Begin with the first sample."""
        self._rewind()

    def _rewind(self) -> None:
        self.sample = 0
        self.difference = Difference(0.0, "u_A", float(self._t[0]))
        self._ended = False

    def read(self) -> Measurement:
        """Return what was measured. Raises PlantError once, at the end."""
        if self.sample == self.samples:
            self.sample, self._ended = 0, True
            raise PlantError(self._end())
        self.raw = RawReading(*self._raw[self.sample].tolist())
        return Measurement(*self._measured[self.sample].tolist())

    def _end(self) -> str:
        volts, output, t = self.difference
        told = f"the voltages differed by at most {volts:.3g} V, {output} at t = {t:.3f} s"
        return f"the recording has ended after {self.samples} samples; {told}"

    def write(self, command: MotorCommand) -> None:
        """Move on by one sample, comparing with what was written then. Raises PlantError for what is no number."""
        require_numbers(command)
        if self._ended or self.sample == self.samples:
            return
        recorded = self._written[self.sample].tolist()
        for output, written, then in zip(("u_A", "u_B"), command, recorded, strict=True):
            if abs(written - then) > self.difference.volts:
                self.difference = Difference(abs(written - then), output, float(self._t[self.sample]))
        self.sample += 1

    def push(self, F_push: float) -> None:
        """Refuse."""
        raise PlantError(_REFUSED.format("be pushed"))

    def load(self, load: ShaftLoad) -> None:
        """Refuse."""
        raise PlantError(_REFUSED.format("be loaded"))

    def inject(self, broken: Broken | None) -> None:
        """Refuse."""
        raise PlantError(_REFUSED.format("be broken"))

    def zero(self, q: float, theta_A: float, theta_B: float, *, at_switch: bool = False) -> None:
        """Refuse."""
        raise PlantError("a recording has its zeros: there is nothing to set in it")

    def acknowledge(self) -> None:
        """Play from the first sample again."""
        self._rewind()

    def close(self) -> None:
        """Nothing is driven, nothing to let go of."""
