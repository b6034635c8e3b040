"""The activity of the rig during an attack, and its state afterwards."""

import json
from collections.abc import Callable, Mapping
from typing import Any

from tests.soak.attack.processes import WATCHDOG, named
from tests.soak.attack.stop_button import rest, wind_up
from tests.soak.attack.tally import Tally
from tests.soak.live_service import Bench, Loop, wait_until

MOVING = 0.5
"""Joint speed at which to attack [rad/s]."""

RECORDED_TICKS = 2600
"""A run of so many ticks has had something stored."""

ENDED_S = 20.0


def sequence(*durations_s: float) -> dict[str, object]:
    """Return an experiment that moves the joint back and forth, with holds of this duration [s]."""
    segments = [
        {"duration_s": held_s, "q_ref": 0.4 if position % 2 else -0.4, "S_ref": 10}
        for position, held_s in enumerate(durations_s)
    ]
    return {"name": "sequence", "settings": {"segments": json.dumps(segments)}}


def be_off(bench: Bench, _loop: Loop) -> int:
    """Be in mode Off without a run."""
    rest(bench)
    return 0


def be_wound_up(bench: Bench, loop: Loop) -> int:
    """Hold voltages on both motors without a run."""
    wind_up(bench, loop)
    return 0


def be_moving(bench: Bench, loop: Loop, side: float = 1.0) -> int:
    """Move the joint in a manual session; return the run."""
    be_off(bench, loop)
    run, begun = bench.run(), loop.ring.count
    wait_until(lambda: loop.ring.count > begun + RECORDED_TICKS, "recording")
    bench.step(1.2 * side)
    wait_until(lambda: abs(loop.newest("q_dot")) > MOVING, "motion")
    return run


def be_in_experiment(bench: Bench, loop: Loop) -> int:
    """Execute a sequence; return the run."""
    be_off(bench, loop)
    answer = bench.client.post("/api/experiments", json=sequence(3, 30, 30)).raise_for_status()
    wait_until(lambda: abs(loop.newest("q_dot")) > 0.2, "motion")
    return int(answer.json()["id"])


OCCUPATIONS: Mapping[str, Callable[[Bench, Loop], int]] = {
    "off": be_off,
    "wound up": be_wound_up,
    "moving": be_moving,
    "experiment": be_in_experiment,
}


class Accounts:
    """Stored data of each run, which must not disappear or change."""

    def __init__(self) -> None:
        self._samples: dict[int, int] = {}
        self._ended: dict[int, str] = {}

    def look(self, bench: Bench, tally: Tally) -> None:
        """Compare the newest runs with their earlier data."""
        for run in bench.client.get("/api/runs", params={"limit": 20}).raise_for_status().json()["runs"]:
            number, stored, ended = run["id"], run["samples"], run["end_state"]
            before = self._samples.get(number, 0)
            tally.lost(stored < before, f"run {number}: {before} samples were stored, {stored} are left")
            tally.lost((run["missing_samples"] or 0) > 0, f"run {number}: {run['missing_samples']} samples missing")
            known = self._ended.get(number, ended)
            tally.lost(known != ended, f"run {number} had ended as {known}, now it is {ended}")
            self._samples[number] = stored
            if ended != "running":
                self._ended[number] = ended

    def must_end_as(self, bench: Bench, tally: Tally, run: int, wanted: str) -> None:
        """Wait for the end of a run and check its state."""
        if not run:
            return

        def state() -> str:
            return str(bench.client.get(f"/api/runs/{run}").raise_for_status().json()["end_state"])

        try:
            wait_until(lambda: state() != "running", f"end of run {run}", ENDED_S)
        except TimeoutError as error:
            tally.lost(True, str(error))
        else:
            tally.lost(state() != wanted, f"run {run} ended as {state()}, not {wanted}")


class Flights:
    """Flight records of one kind: one per trip."""

    def __init__(self, bench: Bench, fault: str) -> None:
        self._bench = bench
        self._fault = fault
        self._seen = self._newest(0)

    def must_grow_by_one(self, tally: Tally, what: str) -> None:
        """Wait for the record of the latest trip; a second record of it is an error."""
        before = self._seen
        try:
            wait_until(lambda: bool(self._after(before)), "flight record", ENDED_S)
        except TimeoutError:
            tally.lost(True, f"{what}: no flight record within {ENDED_S:g} s")
            return
        tally.lost(len(self._after(before)) > 1, f"{what}: {len(self._after(before))} flight records")
        self._seen = self._newest(before)

    def _after(self, number: int) -> list[int]:
        flights = self._bench.client.get("/api/flights").raise_for_status().json()["flights"]
        return [flight["id"] for flight in flights if flight["id"] > number and flight["fault"] == self._fault]

    def _newest(self, number: int) -> int:
        return max(self._after(number), default=number)


def must_be_well(bench: Bench, tally: Tally, after: str, within_s: float = ENDED_S) -> None:
    """Check that the safety chain is good, a watchdog runs, and no problem is shown."""
    watchdogs = named(bench.service.pid, WATCHDOG)
    tally.lost(len(watchdogs) != 1, f"{len(watchdogs)} watchdogs after {after}")
    try:
        wait_until(lambda: not _bad(bench.state()), "all well", within_s)
    except TimeoutError:
        tally.lost(True, f"after {after}: {'; '.join(_bad(bench.state()))}")


def _bad(state: dict[str, Any]) -> list[str]:
    links = [f"{link['name']} {link['says']}" for link in state["chain"] if not link["good"]]
    return links + list(state["problems"])
