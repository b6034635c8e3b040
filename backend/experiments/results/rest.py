"""Whether there is anything to measure of a reference step: did it begin at rest, did it come to rest? Pure.

A figure of a step is one only where the motion before was over when it began. Else it is a figure of both motions.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

SETTLING_BAND = 0.02
"""A step has settled where the signal stays this near its reference, as a share of the step."""

BEGIN_BAND = 0.05
"""A step begins at rest where the signal was this near to where it steps from, as a share of the step."""

REST_S = 0.1
"""So long before a step [s] the signals must have rested: one that only passes by is not at rest."""

AT_REST = {"q": 0.01, "S": 0.05}
"""A signal that is to stay is at rest this near to its reference: q [rad], six counts of the paper's encoder; S
[N·m/rad], half of the least deviation that a criterion refuses."""

NO_NUMBER = "a sample of it holds no number"
NOT_SETTLED = "it was not within ±2 % of its reference when its time was over"
MOVED_AS_ITS_END_CAME = "it still moved when its time was over"
BOTH_STEP = "both references step at once"

_UNITS = {"q": "rad", "S": "N·m/rad"}


def motion_before(rising: Array) -> str:
    """Return why a step did not begin at rest, "" where it did.

    ``rising`` is the signal over the REST_S before the step and at its first sample, shape (N,), as a share of its way.
    """
    off = float(rising[np.argmax(np.abs(rising))])
    if abs(off) <= BEGIN_BAND:
        return ""
    if abs(rising[-1]) > BEGIN_BAND:
        return f"it began at {_percent(float(rising[-1]))} of its way: the motion before was not over"
    return f"it moved as it began, from {_percent(off)} of its way: the motion before was not over"


def way_left(rising: Array) -> str:
    """Return how far a step came that did not come to 90 % of its way."""
    return f"it came to {_percent(float(rising.max()))} of its way in its time"


def other_moving(signal: str, deviation: Array) -> str:
    """Return why a signal that should stay was not at rest, "" where it was; ``deviation`` is from its reference."""
    off = float(np.abs(deviation).max())
    if off <= AT_REST[signal]:
        return ""
    return (
        f"{signal} was {off:.2f} {_UNITS[signal]} from its reference as this step began: the motion before was not over"
    )


@dataclass(frozen=True)
class Missing:
    """A step of which a figure could not be measured: when it began [s], and why."""

    start_s: float
    reason: str


def in_words(missing: Sequence[Missing], of: int) -> str:
    """Return which of so many steps lack a figure and why the first one does; "" where none lacks it."""
    if not missing:
        return ""
    verb = "was" if len(missing) == 1 else "were"
    first = missing[0]
    return f"{len(missing)} of {of} steps {verb} not measured; the one at {first.start_s:g} s: {first.reason}"


def _percent(share: float) -> str:
    return f"{100.0 * share:.0f} %".replace("-", "−")
