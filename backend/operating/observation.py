"""What the ring tells about the loop at present: the newest sample, the timing, whether it is alive."""

import math
import time
from collections.abc import Callable

from backend.faults import FAULTS, Fault
from backend.realtime.program import MODES, Mode
from backend.realtime.ring_buffer import Ring
from backend.realtime.supervisor import Restart
from backend.realtime.timing import timing
from backend.sample import NAMES
from backend.schemas.state import LinkView, ReferencesView, TimingView
from plant.interface import T_s

Sample = dict[str, float]

TIMING_PERIOD_S = 0.25


class Observation:
    """Reads the ring of whichever loop process runs at present."""

    def __init__(self, ring: Callable[[], Ring], clock: Callable[[], float] = time.monotonic) -> None:
        self._ring = ring
        self._clock = clock
        self._seen = (0, clock())
        self._timing: TimingView | None = None
        self._timing_due = 0.0

    def sample(self) -> Sample | None:
        """Return the newest sample, None before the first."""
        row = self._ring().newest()
        return None if row is None else dict(zip(NAMES, row.tolist(), strict=True))

    def link(self, alive: bool, starts: int, restart: Restart | None = None) -> LinkView:
        """Return the state of the connection to the loop."""
        count, now = self._ring().count, self._clock()
        if count != self._seen[0]:
            self._seen = (count, now)
        return LinkView(
            alive=alive,
            silent_s=now - self._seen[1],
            starts=starts,
            restarting="" if restart is None else restart.purpose,
            restarting_s=None if restart is None else now - restart.began_s,
        )

    def timing(self) -> TimingView:
        """Return how well the loop keeps its period, renewed four times a second."""
        if self._timing is None or self._clock() >= self._timing_due:
            self._timing_due = self._clock() + TIMING_PERIOD_S
            t = timing(self._ring())
            self._timing = TimingView(
                period_s=T_s,
                rate_Hz=_number(t.rate_Hz),
                lateness_p50_ms=_number(1e3 * t.lateness_p50_s),
                lateness_p99_ms=_number(1e3 * t.lateness_p99_s),
                overruns=t.overruns,
            )
        return self._timing


def mode_of(sample: Sample | None) -> Mode:
    """Return the mode in a sample; OFF before the first."""
    return Mode.OFF if sample is None else MODES[int(sample["mode"])]


def fault_of(sample: Sample | None) -> Fault:
    """Return the latched fault in a sample."""
    return Fault.NONE if sample is None else FAULTS[int(sample["fault"])]


def references_of(sample: Sample | None) -> ReferencesView:
    """Return the references in force; where none are, what the joint does, from where a mode would start.

    Slack tendons have no stiffness: S_ref is None then.
    """
    if sample is None:
        return ReferencesView(q_ref=0.0, S_ref=None, in_force=False)
    q_ref, S_ref = sample["q_ref"], sample["S_ref"]
    return ReferencesView(
        q_ref=_number(sample["q"]) if math.isnan(q_ref) else q_ref,
        S_ref=_known(sample["S"] if math.isnan(S_ref) else S_ref),
        in_force=not (math.isnan(q_ref) or math.isnan(S_ref)),
    )


def entry_of(sample: Sample | None) -> float:
    """Return the active entry of the bank, fractional while interpolating."""
    return 0.0 if sample is None else _number(sample["bank_entry"])


def _known(value: float) -> float | None:
    return value if math.isfinite(value) else None


def _number(value: float) -> float:
    return value if math.isfinite(value) else 0.0
