"""Random commands of four people during motion: every trial ends as specified, and no voltage jumps.

The people are two operators who take control from each other, a script, and a viewer who presses STOP. All samples
of the loop are checked, and after each command the state.
"""

import tempfile
import time
from contextlib import closing
from pathlib import Path
from typing import Any

import httpx
import numpy as np
from numpy.typing import NDArray
from rich.console import Console

from backend.realtime.modes import MODE_CODE, Mode
from backend.sample import INDEX
from tests.api.conftest import client_with
from tests.api.pages import Page
from tests.realtime.test_mode_manager import stated_V
from tests.soak.live_service import Loop, bench_on, wait_until

COMMANDS = 1500
_BACK = 0.8
"""Share of the commands that find the actuator at rest before which it is brought to run again."""

_STILL = tuple(float(MODE_CODE[mode]) for mode in (Mode.OFF, Mode.TRIPPED))
_WEIGHTS = {
    "references": 30,
    "mode": 20,
    "tuning": 10,
    "motion": 6,
    "trial": 10,
    "push": 6,
    "stop": 4,
    "viewer stops": 2,
    "soft stop": 3,
    "reset": 4,
    "take over": 4,
    "give up": 2,
    "experiment": 3,
    "script": 3,
}


class _Seen:
    """All samples since the last check, and the largest voltage step outside of intended zeroing."""

    def __init__(self, loop: Loop) -> None:
        self._loop, self._since = loop, loop.ring.count
        self._last: NDArray[np.float64] | None = None
        self.largest_V, self.lost, self.samples = 0.0, 0, 0
        self.where: tuple[Mode, Mode] | None = None

    def look(self) -> None:
        while True:
            first, rows, _ = self._loop.ring.read(self._since, 20_000)
            if not len(rows):
                return
            self.lost += max(0, first - self._since)
            joined = first == self._since and self._last is not None
            rows_here = np.vstack([self._last, rows]) if joined and self._last is not None else rows
            self._since, self._last = first + len(rows), rows[-1:].copy()
            self.samples += len(rows)
            u, modes = rows_here[:, [INDEX["u_A"], INDEX["u_B"]]], rows_here[:, INDEX["mode"]]
            steps = np.max(np.abs(np.diff(u, axis=0)), axis=1)
            steps[np.isin(modes[1:], _STILL)] = 0.0  # STOP, a trip and mode Off set zero volts immediately
            if steps.size and (worst := int(np.argmax(steps))) is not None and steps[worst] > self.largest_V:
                self.largest_V = float(steps[worst])
                names = list(Mode)
                self.where = names[int(modes[worst])], names[int(modes[worst + 1])]


class _People:
    def __init__(self, service: Any, random: np.random.Generator) -> None:
        self.random = random
        self.pages = [Page(service, "Ana"), Page(service, "Bea")]
        self.viewer = Page(service, "Vic", "viewer-token")
        self.script = client_with(service, "token")
        self.holder = self.pages[0]
        self.holder.take(take_over=True).raise_for_status()

    def state(self) -> dict[str, Any]:
        return dict(self.script.get("/api/state").raise_for_status().json())

    def close(self) -> None:
        for page in (*self.pages, self.viewer):
            page.browser.close()
        self.script.close()

    def bring_to_run(self) -> None:
        """Reset and change to mode Run, so that most commands apply to a moving joint."""

        def is_held() -> bool:
            self.holder.ping()
            state = self.state()
            if state["holder"] is None:
                self.holder.take(take_over=True)
            elif state["mode"] == "tripped":
                self.holder.command("POST", "/api/reset")
            elif state["mode"] == "off":
                self.holder.command("POST", "/api/mode", {"mode": "pretension"})
            return bool(state["pretension_done"])

        try:
            wait_until(is_held, "pretension")
        except TimeoutError as error:
            raise TimeoutError(f"{error}; the state is {self.state()}") from None
        self.holder.command("POST", "/api/mode", {"mode": "run"})

    def send_command(self, kind: str) -> httpx.Response:
        """Send one command; a refusal is no failure."""
        draw, order = self.random.uniform, self.holder.command
        match kind:
            case "references":
                return order("PUT", "/api/references", {"q_ref": draw(-1.3, 1.3), "S_ref": draw(8.2, 14.8)})
            case "mode":
                mode = str(self.random.choice(["pretension", "run", "run", "compliance", "compliance", "off"]))
                return order("POST", "/api/mode", {"mode": mode})
            case "soft stop":
                return order("POST", "/api/mode", {"mode": "stopping"})
            case "tuning":
                return order("PUT", "/api/tuning", {"lam_q": draw(0.4, 2.9), "lam_S": draw(0.4, 2.9)})
            case "motion":
                return order("PUT", "/api/tuning", {"motion": str(self.random.choice(["lambda", "time-optimal"]))})
            case "trial":
                return order("POST", "/api/tuning/trial", {"lam_q": draw(0.4, 2.9), "duration_s": 60.0})
            case "push":
                return order("POST", "/api/push", {"F_push": draw(-15.0, 15.0), "duration_s": draw(0.1, 3.0)})
            case "stop":
                return self.holder.browser.post("/api/stop")
            case "viewer stops":
                return self.viewer.browser.post("/api/stop")
            case "reset":
                return order("POST", "/api/reset")
            case "take over":
                self.holder = self.pages[1 - self.pages.index(self.holder)]
                return self.holder.take(take_over=True)
            case "give up":
                answer = order("DELETE", "/api/control")
                self.holder.take(take_over=True).raise_for_status()
                return answer
            case "experiment":
                return order("POST", "/api/experiments", {"name": "tracking", "settings": {"q_duration_s": 1.0}})
            case _:
                return self.script.put("/api/references", json={"q_ref": 0.0, "S_ref": 11.0})


def random_commands(console: Console, seed: int | None, commands: int = COMMANDS) -> bool:
    """Send random commands; return whether each trial ended as specified and no voltage step exceeded the bound."""
    seed = int(np.random.default_rng().integers(10**6)) if seed is None else seed
    random, kinds, weights = np.random.default_rng(seed), list(_WEIGHTS), np.array(list(_WEIGHTS.values()), float)
    console.print(f"commands: {commands} of seed {seed}")
    kept, given, trials, ended = True, dict.fromkeys(kinds, 0), 0, 0
    with tempfile.TemporaryDirectory() as folder, bench_on(Path(folder)) as bench:
        loop = Loop(bench.service.pid)
        with closing(_People(bench.service, random)) as people:
            seen = _Seen(loop)
            for number in range(commands):
                if people.state()["mode"] in ("off", "tripped", "stopping") and random.random() < _BACK:
                    people.bring_to_run()
                before = people.state()
                kind = str(random.choice(kinds, p=weights / weights.sum()))
                answer = people.send_command(kind)
                if answer.status_code >= 500 and answer.status_code != 503:
                    console.print(f"LOST: command {number}, {kind}: {answer.status_code} {answer.text[:200]}")
                    kept = False
                if answer.is_success:
                    given[kind] += 1
                trials += kind == "trial" and answer.is_success
                people.holder.ping()
                seen.look()
                after = people.state()
                moved = after["mode"] != before["mode"]
                handed = kind in ("take over", "give up") and answer.is_success
                if before["trial"] is not None and (moved or handed):
                    end = time.monotonic() + 5.0
                    while people.state()["trial"] is not None and time.monotonic() < end:
                        time.sleep(0.02)
                    if people.state()["trial"] is not None:
                        console.print(f"LOST: command {number}, {kind}: a trial outlived it")
                        kept = False
                    else:
                        ended += 1
                time.sleep(float(random.uniform(0.0, 0.25)))
                seen.look()
        loop.close()
    bound = stated_V()
    if not seen.largest_V <= bound:
        console.print(f"LOST: a voltage stepped by {seen.largest_V:.2f} V, stated are {bound:g} V")
        kept = False
    told = ", ".join(f"{kind} {count}" for kind, count in given.items())
    console.print(f"commands: {seen.samples} samples, {seen.lost} not seen; given: {told}")
    console.print(f"commands: {trials} trials, {ended} ended by a stop, a mode or a holder")
    console.print(f"commands: largest step {seen.largest_V:.2f} V, {seen.where}, stated are {bound:g} V")
    return kept
