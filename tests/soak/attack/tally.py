"""Measurements and violations of an attack."""

import os
from collections import defaultdict
from collections.abc import Iterable

import numpy as np
from rich.console import Console

from backend.faults import Fault
from tests.docs.faults_page import documented_ms

STOP_S = 0.3
"""From the request for STOP to its answer, under every attack that leaves service and loop alive."""

ZERO_S = documented_ms(Fault.WATCHDOG) * 1e-3
"""From the death of the loop to zero volts and drives off, by the card's watchdog."""

UNWATCHED_S = documented_ms(Fault.WATCHDOG_DEAD) * 1e-3
"""From the death of the card's watchdog to zero volts and drives off, by the loop."""

REPORTED_S = 1.0
"""From the death of the loop until the service says so; docs/reference/faults.md, ``watchdog``."""


class Tally:
    """Measurements and violations of one part; each violation is printed immediately."""

    def __init__(self, name: str, console: Console) -> None:
        self.name = name
        self.losses = 0
        self._console = console
        self._figures: defaultdict[str, list[float]] = defaultdict(list)

    def lost(self, is_lost: bool, what: str) -> None:
        """Count a violation."""
        if is_lost:
            self.losses += 1
            self._console.print(f"LOST: {self.name}: {what}")

    def take(self, figure: str, value: float, at_most: float | None = None) -> None:
        """Store a measurement; more than ``at_most`` is a violation."""
        self._figures[figure].append(value)
        self.lost(at_most is not None and not value <= at_most, f"{figure}: {value:.3f}, promised {at_most}")

    def median(self, figure: str) -> float:
        """Return the median of a measurement, NaN without values."""
        return float(np.median(self._figures[figure])) if self._figures[figure] else float("nan")

    def note(self, text: str) -> None:
        """Print additional information."""
        self._console.print(f"{self.name}: {text}")

    def close(self) -> bool:
        """Print median and maximum of each measurement; return whether there was no violation."""
        figures = (f"{name}: {_summary(values)}" for name, values in self._figures.items())
        load = os.getloadavg()[0]
        said = "; ".join([*figures, f"{self.losses} losses; load of the machine {load:.1f}"])
        self._console.print(f"{self.name}: {said}")
        return self.losses == 0


def _summary(values: Iterable[float]) -> str:
    """Return median and maximum, if there are several values."""
    taken = np.array(list(values))
    if len(taken) == 1:
        return f"{taken[0]:.3g}"
    return f"median {np.median(taken):.3g}, at most {taken.max():.3g} of {len(taken)}"
