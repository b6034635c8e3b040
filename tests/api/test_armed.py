"""What a stop, a change of mode and a change of control end, as the table in docs/reference/faults.md says."""

import json
import re
from collections.abc import Callable, Iterator
from contextlib import ExitStack, closing
from functools import partial
from typing import Any

import httpx
import pytest

from tests.api.conftest import until, wait_for
from tests.api.pages import Page
from tests.docs.faults_page import PAGE
from tests.e2e.service import Service

HEADING = "| armed or temporary | STOP or a trip | another mode | control changes |"
EVENTS = ("STOP or a trip", "another mode", "control changes")
LONG = json.dumps([{"duration_s": 60, "q_ref": 0.1, "S_ref": 10}])


def documented() -> dict[str, dict[str, str]]:
    """What the page says by armed thing and event, without what follows a comma."""
    table = PAGE[PAGE.index(HEADING) :].split("\n\n")[0].splitlines()[2:]
    rows = [[cell.strip() for cell in line.strip("|").split("|")] for line in table]
    return {name: dict(zip(EVENTS, (re.split(",", cell)[0] for cell in cells), strict=True)) for name, *cells in rows}


class Bench:
    """Ana at a page in control, in run at rest, and Vera at another page; a viewer's client looks on."""

    def __init__(self, service: Service, viewer: httpx.Client) -> None:
        self.ana, self.vera, self.viewer = Page(service, "Ana"), Page(service, "Vera"), viewer
        self.ana.take(take_over=True).raise_for_status()
        self._open = ExitStack()
        self._open.enter_context(self.ana.staying())

    def close(self) -> None:
        self._open.close()
        self.ana.browser.close()
        self.vera.browser.close()

    def order(self, method: str, path: str, body: object = None) -> None:
        answer = self.ana.command(method, path, body)
        assert answer.is_success, answer.text

    def begin(self) -> None:
        self.ana.browser.post("/api/stop").raise_for_status()
        self.order("POST", "/api/reset")
        self.order("POST", "/api/mode", {"mode": "pretension"})
        until(self.is_pretensioned)
        self.order("POST", "/api/mode", {"mode": "run"})

    def is_pretensioned(self) -> bool:
        return bool(self.state()["pretension_done"])

    def state(self) -> dict[str, Any]:
        return dict(self.viewer.get("/api/state").raise_for_status().json())

    def queue(self) -> dict[str, Any]:
        return dict(self.viewer.get("/api/experiments/queue").raise_for_status().json())

    def log(self) -> list[str]:
        entries = self.viewer.get("/api/log").raise_for_status().json()["entries"]
        texts = [entry["text"] for entry in entries]
        return texts[: texts.index(next(text for text in texts if text.startswith("push of")))]

    def arm(self, name: str) -> None:
        match name:
            case "tuning trial":
                self.order("POST", "/api/tuning/trial", {"lam_q": 1.0, "duration_s": 60.0})
            case "manual push":
                self.order("POST", "/api/push", {"F_push": 5.0, "duration_s": 10.0})
            case "calibration over S":
                self.order("PUT", "/api/touch", {"sweep": "begin"})
            case "obstacle":
                self.order("PUT", "/api/wall", {"wall": {"q_wall": 1.0}})
            case "run, and its temporary tuning" | "queue after the run":
                item = {"name": "sequence", "settings": {"segments": LONG}}
                self.order("POST", "/api/experiments/queue", item)
                self.order("POST", "/api/experiments/queue", item)
                self.order("POST", "/api/experiments/queue/run")
                wait_for(self.viewer, "mode", "experiment")
            case _:
                pytest.fail(f"the test does not know how to arm: {name}")

    def is_there(self, name: str) -> bool:
        """Whether what was armed is still there."""
        state = self.state()
        checks: dict[str, Callable[[], bool]] = {
            "tuning trial": lambda: state["trial"] is not None and state["tuning"]["lam_q"] == 1.0,
            "manual push": lambda: not any(text.startswith("push let go") for text in self.log()),
            "calibration over S": lambda: bool(state["touch"]["sweep"] and state["touch"]["sweep"]["under_way"]),
            "run, and its temporary tuning": lambda: state["own_tuning"] is not None and state["task"] is not None,
            "queue after the run": lambda: bool(self.queue()["running"]),
            "obstacle": lambda: state["wall"] is not None,
        }
        return checks[name]()

    def is_gone(self, name: str) -> bool:
        return not self.is_there(name)

    def cause(self, event: str) -> int:
        """Cause the event; return the status of the answer."""
        match event:
            case "STOP or a trip":
                return self.vera.browser.post("/api/stop").status_code
            case "another mode":
                return self.ana.command("POST", "/api/mode", {"mode": "compliance"}).status_code
            case _:
                return self.vera.take(take_over=True).status_code

    def clear(self) -> None:
        self.ana.take(take_over=True)
        self.ana.browser.post("/api/stop").raise_for_status()
        self.order("PUT", "/api/wall", {"wall": None})
        for item in self.queue()["items"]:
            self.order("DELETE", f"/api/experiments/queue/{item['id']}")
        self.order("POST", "/api/reset")
        self.order("DELETE", "/api/control")


@pytest.fixture
def bench(service: Service, viewer: httpx.Client) -> Iterator[Bench]:
    with closing(Bench(service, viewer)) as bench:
        yield bench


ALONE = ("calibration over S", "run, and its temporary tuning", "queue after the run")
TOGETHER = ("tuning trial", "manual push", "obstacle")


def test_the_table_names_what_is_tried() -> None:
    assert sorted(documented()) == sorted((*ALONE, *TOGETHER))


@pytest.mark.parametrize("names", [TOGETHER, ALONE[:1], ALONE[1:]], ids=["in run", "learning", "run"])
@pytest.mark.parametrize("event", EVENTS)
def test_each_event_ends_what_the_table_says(bench: Bench, names: tuple[str, ...], event: str) -> None:
    bench.begin()
    for name in names:
        if name != "queue after the run":
            bench.arm(name)
    assert all(bench.is_there(name) for name in names)
    status = bench.cause(event)
    for name in names:
        outcome = documented()[name][event]
        assert (status >= 400) == (outcome == "refused"), (name, status)
        if outcome in ("ends", "held"):
            until(partial(bench.is_gone, name))
        else:
            assert bench.is_there(name), name
    bench.clear()
