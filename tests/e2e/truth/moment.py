"""The service at the time of a reading of the page: its state before and after, and the samples between."""

import time
from collections import deque
from typing import Any

import numpy as np
from numpy.typing import NDArray
from playwright.sync_api import Error, Page, Response

from backend.sample import COMBINED_SIGNAL_BY_NAME, INDEX
from tests.api.conftest import client_with
from tests.e2e.service import Service
from tests.e2e.truth.figures import Range
from tests.e2e.truth.shown import Shown, read
from tests.soak.live_service import Loop

LATE_S = 1.5
"""What the page shows may be so old [s]: the state is told twice a second, a legend written ten times."""

_TIMING_S = 2.5
PREFERENCES = "/api/preferences"
DRY_RUN = "/api/experiments/dry-run"

State = dict[str, Any]
MINE = "may command"
"""Key of a state: whether the person at the page commands, which the service does not tell as such."""


class Moment:
    """A reading of the page and the service at that time; ``state`` is one of the two readings of the state."""

    def __init__(self, shown: Shown, state: State, around: "Around", rows: NDArray[np.float64], took_s: float) -> None:
        self.shown, self.state, self._around, self._rows, self._took_s = shown, state, around, rows, took_s
        self._asked: dict[str, Any] = around.asked
        self.dry_run = around.dry_run

    @property
    def holds(self) -> bool:
        """Whether the person at the page holds control."""
        return self._around.holds(self.state)

    def get(self, path: str) -> Any:
        """Return the response to a GET, requested once per reading of the page."""
        if path not in self._asked:
            answer = self._around.script.get(path)
            answer.raise_for_status()
            self._asked[path] = answer.json()
        return self._asked[path]

    def preferences(self) -> Any:
        """Return the preferences of the person at the page, who is not the person of the script."""
        if PREFERENCES not in self._asked:
            answer = self._around.page.request.get(f"{self._around.service.url}{PREFERENCES}")
            assert answer.ok, answer.text()
            self._asked[PREFERENCES] = answer.json()
        return self._asked[PREFERENCES]

    def of(self, signal: str, factor: float = 1.0) -> tuple[Range | None, bool]:
        """Return the range of a signal [SI times ``factor``], None without values, and whether it was absent."""
        column = self._column(signal) * factor
        finite = column[np.isfinite(column)]
        return (float(finite.min()), float(finite.max())) if finite.size else None, finite.size < column.size

    def _column(self, signal: str) -> NDArray[np.float64]:
        if signal in INDEX:
            return self._rows[:, INDEX[signal]]
        plant = self.state["plant"]
        lengths = {"": 1.0, "r_m": plant["r_m"], "r_j": plant["r_j"]}
        one, other = COMBINED_SIGNAL_BY_NAME[signal].terms
        summed: NDArray[np.float64] = (
            one.sign * lengths[one.length] * self._rows[:, INDEX[one.column]]
            + other.sign * lengths[other.length] * self._rows[:, INDEX[other.column]]
        )
        return summed

    def counting(self, told_s: float, *, down: bool = False) -> Range:
        """Return the range of a displayed elapsed or remaining time, now reported as ``told_s``."""
        late = LATE_S + self._took_s
        return (max(0.0, told_s - self._took_s), told_s + late) if down else (max(0.0, told_s - late), told_s + late)

    def timing(self, name: str, factor: float = 1.0) -> Range:
        """Return the recent range of a timing statistic of the loop."""
        values = [factor * told[name] for _, told in self._around.timings]
        return min(values), max(values)


class Around:
    """One page and one service, read together; ``name`` is the person at the page, if there are several."""

    def __init__(self, page: Page, service: Service, name: str | None = None) -> None:
        self.page, self.service, self.name = page, service, name
        self.script = client_with(service, "token")
        self.timings: deque[tuple[float, dict[str, Any]]] = deque()
        self.asked: dict[str, Any] = {}
        self.dry_run: State | None = None
        self._loop = Loop(service.pid)
        self._starts = 0
        self._played: Response | None = None
        page.on("response", self._hear)

    def close(self) -> None:
        self._loop.close()
        self.script.close()

    @property
    def place(self) -> str:
        """Return the address of the page."""
        return self.page.url.partition("#/")[2]

    def state(self) -> State:
        """Return the current state of the service."""
        told: State = self.script.get("/api/state").raise_for_status().json()
        now = time.monotonic()
        self.timings.append((now, told["timing"]))
        while (
            len(self.timings) > 1 and now - self.timings[1][0] > _TIMING_S
        ):  # the last sample before the window is valid in it
            self.timings.popleft()
        if told["link"]["starts"] != self._starts and self._starts:  # a new control loop has another ring buffer
            self._loop.close()
            self._loop = Loop(self.service.pid)
        self._starts = told["link"]["starts"]
        told[MINE] = told["holder"] is None or told["holder"]["lost"] or self.holds(told)
        return told

    def holds(self, told: State) -> bool:
        """Whether the person at the page is who holds control."""
        holder = told["holder"]
        return holder is not None and bool(holder["page"]) and self.name in (None, holder["name"])

    def _hear(self, response: Response) -> None:
        if response.ok and response.url.endswith(DRY_RUN):
            self._played = response

    def _read_dry_run(self) -> None:
        """Read the newest response to a dry run; a reloaded page has none and shows none."""
        if self._played is not None:
            try:
                self.dry_run = self._played.json()
            except Error:
                self.dry_run = None
            self._played = None

    def look(self) -> tuple[Moment, Moment]:
        """Read the page between two readings of the state; return the moments before and after."""
        self.asked = {}
        self._read_dry_run()
        begun = time.monotonic()
        before, ring = self.state(), self._loop.ring
        since = ring.count
        shown = read(self.page)
        _, rows, _ = ring.read(max(0, since - round(1000 * LATE_S)), ring.count)
        after = self.state()
        took_s = time.monotonic() - begun
        return Moment(shown, before, self, rows, took_s), Moment(shown, after, self, rows, took_s)
