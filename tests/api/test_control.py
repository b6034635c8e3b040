"""The control lease: taking, take-over and loss; commands of stale pages and other people have no effect."""

import asyncio
import json
import math
from collections.abc import Callable
from http.client import HTTPConnection

import httpx
import pytest

from backend.auth.authentication import BEARER, User
from backend.auth.control_lease import (
    HOLD_S,
    LOST_S,
    POLL_S,
    SCRIPT_S,
    CommandToken,
    ControlLease,
    ControlReleased,
    LeaseHolder,
    parse_command_token,
)
from backend.errors import RequestRejectedError
from backend.event_bus import EventBus
from backend.faults import Fault
from backend.schemas.session import Role
from plant.errors import ErrorCode, InvariantError
from tests.api.conftest import ended, problem, wait_for, wait_until_present
from tests.api.pages import Page, pages
from tests.docs.faults_page import documented_ms
from tests.e2e.service import Service
from tests.refusals import refused

ANA, VERA = User("Ana", Role.OPERATOR, "a"), User("Vera", Role.OPERATOR, "v")
SCRIPT = User("operator", Role.OPERATOR, BEARER)

KEY = "a" * 16
JSON = {"Content-Type": "application/json"}


class Desk:
    """A control lease with a clock of the test."""

    def __init__(self) -> None:
        self.now, self.lost, self.entries = 100.0, [], []  # type: float, list[str], list[str]
        self.events = EventBus()
        self.control = ControlLease(
            self.events, self._lose, lambda text, who: self.entries.append(f"{who}: {text}"), lambda: self.now
        )

    async def _lose(self, who: str) -> None:
        self.lost.append(who)

    def wait(self, seconds: float) -> None:
        async def look() -> None:
            for _ in range(round(seconds / POLL_S)):
                self.now += POLL_S
                await self.control.check()

        asyncio.run(look())

    def take(self, person: User, take_over: bool = False) -> LeaseHolder:
        return self.control.take(person, is_page=True, take_over=take_over)

    def command(self, person: User, stamp: CommandToken | None) -> None:
        async def command() -> None:
            async with self.control.turn(person, stamp):
                pass

        asyncio.run(command())

    def refusal(self, person: User, stamp: CommandToken | None) -> str:
        with pytest.raises(RequestRejectedError) as error:
            self.command(person, stamp)
        assert error.value.category is ErrorCode.NOT_NOW
        return error.value.code


def test_commands_of_the_lease_holder_are_accepted_once_and_in_order() -> None:
    desk = Desk()
    page = desk.take(ANA).page_key
    desk.command(ANA, CommandToken(page, 1))
    desk.command(ANA, CommandToken(page, 3))  # the second was lost
    assert desk.refusal(ANA, CommandToken(page, 3)) == "stale_command"
    assert desk.refusal(ANA, CommandToken(page, 2)) == "stale_command"
    assert desk.refusal(VERA, CommandToken(page, 4)) == "control_lost"
    assert desk.refusal(VERA, None) == "control_needed"


def test_taking_a_held_lease_requires_an_explicit_take_over() -> None:
    desk = Desk()
    first = desk.take(ANA).build_lease()
    with refused(RequestRejectedError, "control_held", holder="Ana"):
        desk.take(VERA)
    second = desk.take(VERA, take_over=True).build_lease()
    assert second.epoch > first.epoch
    assert desk.refusal(ANA, CommandToken(first.page, 9)) == "control_lost"
    desk.command(VERA, CommandToken(second.page, 1))
    assert desk.entries == ["Ana: control taken", "Vera: control taken over from Ana"]


def forget_an_epoch(control: ControlLease) -> None:
    control._epoch += 1


def lose_count_of_silence(control: ControlLease) -> None:
    assert control.holder is not None
    control.holder.silent_s = math.nan


def swap_the_session(control: ControlLease) -> None:
    assert control.holder is not None
    control.holder.user = VERA


@pytest.mark.parametrize("spoil", [forget_an_epoch, lose_count_of_silence, swap_the_session])
def test_an_inconsistent_lease_is_released(spoil: Callable[[ControlLease], None]) -> None:
    desk = Desk()
    page = desk.take(ANA).page_key
    released: list[int] = []
    desk.events.subscribe(ControlReleased, lambda _: released.append(1))
    spoil(desk.control)
    for person in (ANA, VERA):
        with pytest.raises(InvariantError):
            desk.command(person, CommandToken(page, 1))
    with pytest.raises(InvariantError):  # the monitor of the lease dies: the supervisor stops the joint softly
        desk.wait(POLL_S)
    assert (desk.control.holder, released) == (None, [1])
    desk.wait(1.0)
    desk.take(VERA)


def test_a_clock_that_goes_back_releases_the_lease() -> None:
    desk = Desk()
    desk.take(ANA)
    desk.now -= 1.0
    with pytest.raises(InvariantError):
        desk.wait(POLL_S)
    assert desk.control.holder is None
    desk.wait(1.0)


def test_two_pages_of_one_person_do_not_share_the_lease() -> None:
    desk = Desk()
    first = desk.take(ANA).page_key
    with refused(RequestRejectedError, "control_held", holder="another of your pages"):
        desk.take(ANA)
    desk.take(ANA, take_over=True)
    assert desk.refusal(ANA, CommandToken(first, 1)) == "control_lost"


def test_a_reloaded_page_resumes_the_lease_and_its_old_key_is_rejected() -> None:
    desk = Desk()
    first = desk.take(ANA).build_lease()
    desk.command(ANA, CommandToken(first.page, 1))
    with pytest.raises(RequestRejectedError):
        desk.control.resume(VERA, first.page)
    second = desk.control.resume(ANA, first.page).build_lease()
    assert (second.page == first.page, second.epoch > first.epoch) == (False, True)
    desk.command(ANA, CommandToken(second.page, 1))
    assert desk.refusal(ANA, CommandToken(first.page, 2)) == "control_lost"
    with pytest.raises(RequestRejectedError):
        desk.control.resume(ANA, first.page)
    desk.take(VERA, take_over=True)
    with pytest.raises(RequestRejectedError):
        desk.control.resume(ANA, second.page)
    assert desk.entries == ["Ana: control taken", "Vera: control taken over from Ana"]


def test_every_loss_of_control_releases_the_push() -> None:
    desk, released = Desk(), []  # type: Desk, list[float]
    desk.events.subscribe(ControlReleased, lambda _: released.append(desk.now))
    page = desk.take(ANA).page_key
    desk.control.record_ping(ANA, page)
    released.clear()
    desk.wait(LOST_S - POLL_S)
    assert released == []
    desk.wait(3 * POLL_S)
    assert len(released) == 1  # as soon as the page is silent, and once
    desk.control.resume(ANA, page)
    assert len(released) == 2
    holder = desk.take(VERA, take_over=True)
    assert len(released) == 3
    asyncio.run(desk.control.give_up(VERA, CommandToken(holder.page_key, 1)))
    assert len(released) == 4
    desk.command(SCRIPT, None)
    released.clear()
    desk.wait(SCRIPT_S + 2 * POLL_S)
    assert desk.control.holder is None
    assert len(released) == 1


def test_a_silent_page_loses_the_lease_and_its_old_commands_are_rejected() -> None:
    desk = Desk()
    page = desk.take(ANA).page_key
    for _ in range(20):
        desk.wait(1.0)
        desk.control.record_ping(ANA, page)
    assert not desk.lost
    desk.wait(LOST_S + 0.2)
    view = desk.control.view()
    assert view is not None
    assert view.lost
    desk.wait(HOLD_S - 0.5)
    assert not desk.lost
    desk.wait(0.4)
    assert desk.lost == ["Ana"]
    assert documented_ms(Fault.OPERATOR_LOST) >= 1000 * (LOST_S + HOLD_S + 2 * POLL_S)
    assert desk.refusal(ANA, CommandToken(page, 1)) == "control_lost"


def test_a_page_that_reconnects_in_time_keeps_the_lease() -> None:
    desk = Desk()
    page = desk.take(ANA).page_key
    desk.wait(LOST_S + HOLD_S - 0.3)
    desk.control.record_ping(VERA, page)
    desk.control.record_ping(ANA, "x" * 16)
    desk.control.record_ping(ANA, None)
    assert desk.control.holder is not None
    assert desk.control.holder.is_lost
    desk.control.record_ping(ANA, page)
    desk.wait(1.0)
    desk.command(ANA, CommandToken(page, 1))
    assert not desk.lost


def test_a_pause_of_the_service_does_not_time_out_pages() -> None:
    desk = Desk()
    desk.take(ANA)
    for _ in range(5):
        desk.now += 30.0
        asyncio.run(desk.control.check())
    assert not desk.lost


def test_scripts_need_no_command_token_while_the_lease_is_free() -> None:
    desk = Desk()
    desk.command(SCRIPT, None)
    with refused(RequestRejectedError, "control_held", holder="operator"):
        desk.take(ANA)
    desk.wait(SCRIPT_S + 0.2)
    desk.take(ANA)
    assert desk.refusal(SCRIPT, None) == "control_held"
    assert not desk.lost


@pytest.mark.parametrize(
    "text", ["", "1.1", KEY, KEY + ".", ".1", KEY + ".-1", KEY + ".1.1", KEY + ".1\n", KEY + ".١", KEY + "." + "9" * 30]
)
def test_an_invalid_command_token_is_rejected(text: str) -> None:
    with pytest.raises(RequestRejectedError) as error:
        parse_command_token(text)
    assert error.value.category is ErrorCode.MALFORMED


def test_a_page_that_lost_control_may_only_send_stop(service: Service, off: httpx.Client) -> None:
    with pages(service, "Ana", "Vera") as (ana, vera):
        assert ana.take(take_over=True).is_success
        assert vera.take().status_code == 409
        assert ana.command("POST", "/api/mode", {"mode": "pretension"}).is_success
        assert problem(vera.browser.post("/api/mode", json={"mode": "off"}))["code"] == "control_needed"
        assert off.get("/api/state").json()["holder"]["name"] == "Ana"
        assert vera.take(take_over=True).is_success
        refused = problem(ana.command("POST", "/api/mode", {"mode": "off"}))
        assert (refused["code"], refused["message_code"]) == ("control_lost", "control_taken_over")
        assert "Vera" in str(refused["message"])
        assert off.get("/api/state").json()["mode"] == "pretension"
        assert problem(off.post("/api/mode", json={"mode": "off"}))["code"] == "control_held"
        assert ana.browser.post("/api/stop").is_success
        assert off.post("/api/stop").is_success
        assert vera.command("POST", "/api/reset").is_success


def test_loss_of_the_controlling_page_causes_a_soft_stop(service: Service, off: httpx.Client) -> None:
    with pages(service, "Ana") as (ana,):
        ana.take(take_over=True)
        assert ana.ping() == {"type": "pong", "id": 1}
        with ana.staying():
            ana.command("POST", "/api/mode", {"mode": "pretension"}).raise_for_status()
            state = off.get("/api/state").json()
            while not state["pretension_done"]:
                state = off.get("/api/state").json()
                assert state["fault"] is None, state["chain"]
            ana.command("POST", "/api/mode", {"mode": "run"}).raise_for_status()
            ana.command("PUT", "/api/references", {"q_ref": 0.2, "S_ref": 10.0}).raise_for_status()
        seen_lost = False
        while (state := off.get("/api/state").json())["mode"] == "run":
            page = state["chain"][0]
            assert state["references"]["q_ref"] == 0.2
            seen_lost |= not page["good"]
            # control ends shortly before the loop stops: then no silent holder can be shown
            assert page["silent_s"] is None or page["silent_s"] < LOST_S + HOLD_S + 1.0
        wait_for(off, "mode", "tripped")
        state = wait_until_present(off, "stop_proof")  # an event, which arrives shortly after the sample
        assert seen_lost
        assert state["fault"]["code"] == "operator_lost"
        assert state["holder"] is None
        run = off.get("/api/runs", params={"limit": 1}).json()["runs"][0]
        assert ended(off, run["id"])["end_state"] == "link_lost"


def test_a_viewer_cannot_take_the_control_lease(service: Service) -> None:
    watcher = Page(service, "Vic", role="viewer-token")
    assert watcher.take().status_code == 403
    assert watcher.take(take_over=True).status_code == 403
    watcher.browser.close()


def test_commands_on_two_connections_are_executed_in_their_order(service: Service) -> None:
    """The second command leaves before the first is answered, on another connection, as browsers do."""
    with pages(service, "Ana") as (ana,):
        assert ana.take(take_over=True).is_success
        cookie = "; ".join(f"{name}={value}" for name, value in ana.browser.cookies.items())
        doors = [HTTPConnection(service.url.removeprefix("http://")) for _ in range(2)]
        refused = 0
        for _ in range(200):
            for door in doors:
                door.request("POST", "/api/push", '{"F_push": 999}', {"Cookie": cookie, **ana.stamp()} | JSON)
            answers = [json.loads(door.getresponse().read())["error"]["code"] for door in doors]
            refused += answers != ["out_of_range"] * 2  # in order, but with an invalid value: nothing moves
        assert refused == 0


def test_a_reload_keeps_control_and_a_copied_page_has_none(service: Service, off: httpx.Client) -> None:
    with pages(service, "Ana") as (ana,):
        assert ana.take(take_over=True).is_success
        before = ana.key
        resumed = ana.browser.post("/api/control", json={"resume": before}).raise_for_status().json()
        assert off.get("/api/state").json()["holder"]["epoch"] == resumed["epoch"]
        assert problem(ana.browser.post("/api/control", json={"resume": before}))["code"] == "control_lost"
        assert problem(ana.command("POST", "/api/reset"))["code"] == "control_lost"
        assert problem(ana.take())["message_code"] == "control_held"
        assert ana.take(take_over=True).is_success
        assert ana.key not in off.get("/api/state").text
