"""One holder of control: taken, taken over, lost; what stale pages and strangers send does nothing."""

import asyncio
import itertools
import json
from collections.abc import Iterator
from contextlib import contextmanager

import httpx
import pytest
from websockets.asyncio.client import connect

from backend.api.auth import BEARER, Person
from backend.api.control import HEADER, HOLD_S, LOOK_S, LOST_S, SCRIPT_S, Control, Stamp, read_stamp
from backend.api.errors import ApiError
from backend.api.schemas.session import Role
from backend.faults import Fault
from tests.api.conftest import problem, wait_for
from tests.docs.faults_page import documented_ms
from tests.e2e.service import Service

ANA, VERA = Person("Ana", Role.OPERATOR, "a"), Person("Vera", Role.OPERATOR, "v")
SCRIPT = Person("operator", Role.OPERATOR, BEARER)


class Desk:
    """Control on a clock of the test."""

    def __init__(self) -> None:
        self.now, self.lost, self.told = 100.0, [], []  # type: float, list[str], list[str]
        self.control = Control(self._lose, lambda text, who: self.told.append(f"{who}: {text}"), lambda: self.now)

    async def _lose(self, who: str) -> None:
        self.lost.append(who)

    def wait(self, seconds: float) -> None:
        async def look() -> None:
            for _ in range(round(seconds / LOOK_S)):
                self.now += LOOK_S
                await self.control.look()

        asyncio.run(look())

    def refusal(self, person: Person, stamp: Stamp | None) -> str:
        with pytest.raises(ApiError) as error:
            self.control.require(person, stamp)
        assert error.value.status == 409
        return error.value.problem.code


def test_commands_of_the_holder_pass_once_and_in_order() -> None:
    desk = Desk()
    epoch = desk.control.take(ANA, is_page=True).epoch
    desk.control.require(ANA, Stamp(epoch, 1))
    desk.control.require(ANA, Stamp(epoch, 5))
    assert desk.refusal(ANA, Stamp(epoch, 5)) == "stale_command"
    assert desk.refusal(ANA, Stamp(epoch, 2)) == "stale_command"
    assert desk.refusal(VERA, Stamp(epoch, 6)) == "control_lost"
    assert desk.refusal(VERA, None) == "control_needed"


def test_control_is_taken_over_only_when_that_is_said() -> None:
    desk = Desk()
    first = desk.control.take(ANA, is_page=True).epoch
    with pytest.raises(ApiError, match="Ana holds control"):
        desk.control.take(VERA, is_page=True)
    second = desk.control.take(VERA, is_page=True, take_over=True).epoch
    assert second > first
    assert desk.refusal(ANA, Stamp(first, 9)) == "control_lost"
    desk.control.require(VERA, Stamp(second, 1))
    assert desk.told == ["Ana: control taken", "Vera: control taken over from Ana"]


def test_another_page_of_the_same_person_is_another_page() -> None:
    desk = Desk()
    first = desk.control.take(ANA, is_page=True).epoch
    with pytest.raises(ApiError, match="another page of yours"):
        desk.control.take(ANA, is_page=True)
    desk.control.take(ANA, is_page=True, take_over=True)
    assert desk.refusal(ANA, Stamp(first, 1)) == "control_lost"


def test_a_silent_page_is_lost_after_its_time_and_a_stamp_of_before_does_nothing() -> None:
    desk = Desk()
    epoch = desk.control.take(ANA, is_page=True).epoch
    for _ in range(20):
        desk.wait(1.0)
        desk.control.heard(ANA, epoch)
    assert not desk.lost
    desk.wait(LOST_S + 0.2)
    view = desk.control.view()
    assert view is not None
    assert view.lost
    desk.wait(HOLD_S - 0.5)
    assert not desk.lost
    desk.wait(0.4)
    assert desk.lost == ["Ana"]
    assert documented_ms(Fault.OPERATOR_LOST) >= 1000 * (LOST_S + HOLD_S + 2 * LOOK_S)
    assert desk.refusal(ANA, Stamp(epoch, 1)) == "control_lost"


def test_a_page_that_comes_back_in_time_goes_on_holding_control() -> None:
    desk = Desk()
    epoch = desk.control.take(ANA, is_page=True).epoch
    desk.wait(LOST_S + HOLD_S - 0.3)
    desk.control.heard(VERA, epoch)
    desk.control.heard(ANA, epoch - 1)
    assert desk.control.holder is not None
    assert desk.control.holder.lost
    desk.control.heard(ANA, epoch)
    desk.wait(1.0)
    desk.control.require(ANA, Stamp(epoch, 1))
    assert not desk.lost


def test_a_service_that_stood_still_blames_no_page() -> None:
    desk = Desk()
    desk.control.take(ANA, is_page=True)
    for _ in range(5):
        desk.now += 30.0
        asyncio.run(desk.control.look())
    assert not desk.lost


def test_scripts_need_no_stamp_while_nobody_else_holds_control() -> None:
    desk = Desk()
    desk.control.require(SCRIPT, None)
    with pytest.raises(ApiError, match="operator holds control"):
        desk.control.take(ANA, is_page=True)
    desk.wait(SCRIPT_S + 0.2)
    desk.control.take(ANA, is_page=True)
    assert desk.refusal(SCRIPT, None) == "control_held"
    assert not desk.lost


@pytest.mark.parametrize("text", ["", "1", "1.", ".1", "a.1", "1.-1", "1.1.1", "٣.١", "9" * 30 + "." + "9" * 30])
def test_a_stamp_that_is_none_is_refused(text: str) -> None:
    with pytest.raises(ApiError) as error:
        read_stamp(text)
    assert error.value.status == 400


class Page:
    """A signed-in page of the running service, as the browser's is: cookie, epoch, sequence."""

    def __init__(self, service: Service, name: str, role: str = "token") -> None:
        self.browser = httpx.Client(base_url=service.url, timeout=60.0)
        token = (service.data / role).read_text().strip()
        self.browser.post("/api/session", json={"token": token, "name": name}).raise_for_status()
        self.socket_url = service.url.replace("http", "ws") + "/api/live"
        self._numbers = itertools.count(1)
        self.epoch = 0

    def take(self, take_over: bool = False) -> httpx.Response:
        answer = self.browser.post("/api/control", json={"take_over": take_over})
        if answer.is_success:
            self.epoch = answer.json()["epoch"]
        return answer

    def command(self, method: str, path: str, body: object = None) -> httpx.Response:
        stamp = {HEADER: f"{self.epoch}.{next(self._numbers)}"}
        return self.browser.request(method, path, json=body, headers=stamp)

    def ping(self) -> dict[str, object]:
        async def once() -> dict[str, object]:
            cookies = "; ".join(f"{name}={value}" for name, value in self.browser.cookies.items())
            async with connect(self.socket_url, additional_headers={"Cookie": cookies}, max_size=None) as socket:
                await socket.send(json.dumps({"type": "ping", "id": 1, "control": self.epoch}))
                while True:
                    message = await asyncio.wait_for(socket.recv(), 20.0)
                    if isinstance(message, str) and '"pong"' in message:
                        return dict(json.loads(message))

        return asyncio.run(once())


@contextmanager
def pages(service: Service, *names: str) -> Iterator[list[Page]]:
    opened = [Page(service, name) for name in names]
    try:
        yield opened
    finally:
        for page in opened:
            page.command("DELETE", "/api/control")
            page.browser.close()


def test_a_stale_page_is_refused_after_take_over_and_may_still_stop(service: Service, off: httpx.Client) -> None:
    with pages(service, "Ana", "Vera") as (ana, vera):
        assert ana.take(take_over=True).is_success
        assert vera.take().status_code == 409
        assert ana.command("POST", "/api/mode", {"mode": "pretension"}).is_success
        assert problem(vera.browser.post("/api/mode", json={"mode": "off"}))["code"] == "control_needed"
        assert off.get("/api/state").json()["holder"]["name"] == "Ana"
        assert vera.take(take_over=True).is_success
        refused = problem(ana.command("POST", "/api/mode", {"mode": "off"}))
        assert refused["code"] == "control_lost"
        assert "Vera" in str(refused["message"])
        assert off.get("/api/state").json()["mode"] == "pretension"
        assert problem(off.post("/api/mode", json={"mode": "off"}))["code"] == "control_held"
        assert ana.browser.post("/api/stop").is_success
        assert off.post("/api/stop").is_success
        assert vera.command("POST", "/api/reset").is_success


def test_losing_the_page_that_holds_control_ends_in_a_soft_stop(service: Service, off: httpx.Client) -> None:
    with pages(service, "Ana") as (ana,):
        ana.take(take_over=True)
        ana.command("POST", "/api/mode", {"mode": "pretension"}).raise_for_status()
        state = off.get("/api/state").json()
        while not state["pretension_done"]:
            assert ana.ping() == {"type": "pong", "id": 1}
            state = off.get("/api/state").json()
            assert state["fault"] is None, state["chain"]
        ana.command("POST", "/api/mode", {"mode": "run"}).raise_for_status()
        ana.command("PUT", "/api/references", {"q_ref": 0.2, "S_ref": 10.0}).raise_for_status()
        seen_lost = False
        while (state := off.get("/api/state").json())["mode"] == "run":
            page = state["chain"][0]
            assert state["references"]["q_ref"] == 0.2
            seen_lost |= not page["good"]
            assert page["silent_s"] < LOST_S + HOLD_S + 1.0
        state = wait_for(off, "mode", "tripped")
        assert seen_lost
        assert state["fault"]["code"] == "operator_lost"  # type: ignore[index]
        assert state["stop_proof"] is not None
        assert state["holder"] is None
        run = off.get("/api/runs", params={"limit": 1}).json()["runs"][0]
        while run["end_state"] == "running":
            run = off.get(f"/api/runs/{run['id']}").json()
        assert run["end_state"] == "link_lost"


def test_a_viewer_takes_no_control(service: Service) -> None:
    watcher = Page(service, "Vic", role="viewer-token")
    assert watcher.take().status_code == 403
    assert watcher.take(take_over=True).status_code == 403
    watcher.browser.close()
