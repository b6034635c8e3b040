"""Faults to order that only a card has: as NI-DAQmx tells them, and wires that are not where the wiring file says.

A fault that a card notices is an error with NI's code. What it cannot notice is a rig that differs from its wiring
file: ``miswired`` says what the terminals are really connected to, and the file goes on saying what it says.
"""

from dataclasses import replace
from typing import Any

from nidaqmx.error_codes import DAQmxErrors

from plant.breakage import Breakage, Broken
from plant.in_process import CardError
from plant.wiring import Wiring

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
    def gone(self) -> bool:
        """Whether the card does not answer any more; its outputs stay as they were, until its watchdog cuts them."""
        return self.kind is Breakage.DEVICE_GONE

    def refuse(self, method: str) -> None:
        """Raise CardError where a call of NI's service, by its name, does not work."""
        if self.kind not in _ERRORS or not (self.gone or method == "ReadAnalogF64"):
            return
        code, text = _ERRORS[self.kind]
        if self.kind is Breakage.LOST_SAMPLE:
            self.kind = None
        raise CardError(code, text)


def miswired(wiring: Wiring, broken: Broken | None) -> Wiring:
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
