"""Sessions of people: sign-in, roles, names, restarts and preferences, through the interface."""

import asyncio
import json
import stat
import subprocess
import sys
from contextlib import suppress
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

import httpx
import pytest
from websockets.exceptions import ConnectionClosed

from backend.auth.authentication import ATTEMPTS, BEARER, ActiveUsers, User
from backend.auth.control_lease import CONTROL_HEADER
from backend.errors import RequestRejectedError
from backend.schemas import messages
from backend.schemas.preferences import ChartLayout, check_preferences
from backend.schemas.session import Role
from backend.server.security import COOKIE, OVER
from plant.errors import ErrorCode
from tests.api.conftest import PATIENCE_S, problem, until
from tests.api.patient import connect
from tests.e2e.service import Service, running_service
from tests.refusals import refused

# Sign-in, roles and public routes, on the running service.

CLOSED = ["/api/state", "/api/tuning", "/api/runs", "/api/banks", "/api/identifications", "/api/session", "/scene/"]


def test_the_link_sets_a_cookie_and_redirects_without_the_token(service: Service) -> None:
    with httpx.Client(base_url=service.url) as browser:
        answer = browser.get(service.link)
        assert answer.status_code == 303
        assert answer.headers["location"] == "./"
        cookie = answer.headers["set-cookie"]
        assert "HttpOnly" in cookie
        assert "SameSite=strict" in cookie
        assert urlsplit(service.link).query.partition("=")[2] not in cookie
        assert browser.get("/api/session").json() == {"name": "operator", "role": "operator", "asks_name": True}
        assert browser.get("/api/state").status_code == 200
        browser.delete("/api/session")
        assert browser.get("/api/session").status_code == 401


def test_a_name_given_at_sign_in_is_shown(service: Service) -> None:
    token = urlsplit(service.link).query.partition("=")[2]
    with httpx.Client(base_url=service.url) as browser:
        assert browser.post("/api/session", json={"token": token, "name": "Ana"}).json()["name"] == "Ana"
        assert COOKIE + service.url.rpartition(":")[2] in browser.cookies
        assert browser.get("/api/session").json() == {"name": "Ana", "role": "operator", "asks_name": False}


@pytest.mark.parametrize("path", CLOSED)
def test_requests_without_a_valid_token_are_rejected(service: Service, path: str) -> None:
    assert httpx.get(service.url + path).status_code == 401
    wrong = httpx.get(service.url + path, headers={"Authorization": "Bearer wrong"})
    assert wrong.status_code in (401, 429)
    assert httpx.get(service.url + path, cookies={COOKIE + service.url.rpartition(":")[2]: "forged"}).status_code == 401


def test_a_wrong_link_is_rejected_and_the_log_has_no_token(service: Service) -> None:
    answer = httpx.get(service.url + "/?token=wrong-and-unique-token")
    assert answer.status_code in (401, 429)
    assert "set-cookie" not in answer.headers
    log = service.log.read_text()
    assert "wrong-and-unique-token" not in log
    assert log.count(urlsplit(service.link).query) == 1


def test_health_requires_no_session_and_has_no_secret(service: Service, operator: httpx.Client) -> None:
    health = httpx.get(service.url + "/api/health").json()
    assert set(health) == {"alive", "mode", "rate_Hz", "overruns", "version"}
    assert health["alive"]


@pytest.mark.parametrize(
    ("method", "path", "body"),
    [
        ("POST", "/api/mode", {"mode": "pretension"}),
        ("POST", "/api/reset", None),
        ("PUT", "/api/references", {"q_ref": 0.0, "S_ref": 10.0}),
        ("PUT", "/api/tuning", {"lam_q": 0.5}),
        ("POST", "/api/push", {"F_push": 1.0}),
        ("PUT", "/api/wall", {"wall": None}),
        ("POST", "/api/experiments", {"name": "tracking"}),
        ("POST", "/api/identifications", {"tension_N": 20.0}),
        ("POST", "/api/banks", {"name": "b", "identifications": [1]}),
        ("PATCH", "/api/runs/1", {"note": "n"}),
    ],
)
def test_a_viewer_can_read_but_not_command(
    viewer: httpx.Client, method: str, path: str, body: dict[str, object] | None
) -> None:
    assert viewer.get("/api/state").status_code == 200
    answer = viewer.request(method, path, json=body)
    assert answer.status_code == 403
    assert problem(answer)["message_code"] == "operator_needed"


def test_a_viewer_may_stop(viewer: httpx.Client, off: httpx.Client) -> None:
    assert viewer.post("/api/stop").status_code == 200
    assert off.get("/api/state").json()["mode"] == "tripped"


# Access after a restart, a change of the clock, a sign-out or new tokens; and permissions of the data folder.

CLOCK = "import os, time\nreal, moved = time.time, float(os.environ['MOVED_S'])\ntime.time = lambda: real() + moved\n"


def signed_in(service: Service, name: str, file: str = "token") -> httpx.Client:
    browser = httpx.Client(base_url=service.url, timeout=PATIENCE_S)
    token = (service.data / file).read_text().strip()
    browser.post("/api/session", json={"token": token, "name": name}).raise_for_status()
    return browser


def cookie_of(browser: httpx.Client) -> str:
    (value,) = browser.cookies.values()
    return value


def cookie_header(cookie: str, to: Service) -> dict[str, str]:
    """Return the cookie header of a browser at another port, because a restarted service gets a new port."""
    return {"Cookie": f"{COOKIE}{to.url.rpartition(':')[2]}={cookie}"}


def modes(data: Path) -> dict[str, int]:
    found = {}
    for path in (data, *data.rglob("*")):
        with suppress(FileNotFoundError):  # a file being written has another name until it is complete
            found[path.name] = stat.S_IMODE(path.stat().st_mode)
    return found


async def watch(service: Service, headers: dict[str, str], ended: httpx.Client) -> int | None:
    """Open the live stream, sign out elsewhere, return the close code of the stream."""
    url = service.url.replace("http", "ws") + "/api/live"
    async with connect(url, additional_headers=headers, close_timeout=0.1) as socket:
        await socket.recv()
        await asyncio.to_thread(ended.delete, "/api/session")
        async with asyncio.timeout(PATIENCE_S):
            with suppress(ConnectionClosed):
                while True:
                    await socket.recv()
        return socket.close_code


@pytest.fixture
def moved_clock(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Set the clock of processes that start from now on 40 days ahead."""
    folder = tmp_path / "clock"
    folder.mkdir()
    (folder / "sitecustomize.py").write_text(CLOCK)
    monkeypatch.setenv("PYTHONPATH", f"{folder}:.")
    monkeypatch.setenv("MOVED_S", str(40 * 86400))


def test_sessions_survive_restarts_and_clock_changes_until_sign_out(
    tmp_path: Path, request: pytest.FixtureRequest
) -> None:
    data = tmp_path / "data"
    data.mkdir(mode=0o755)
    (data / "service.lock").touch(mode=0o644)
    (data / "backups").mkdir(mode=0o755)
    (data / "backups" / "old.txt").touch(mode=0o644)
    with running_service(data, params="ideal") as service:
        ana, vera = signed_in(service, "Ana"), signed_in(service, "Vera")
        kept_by_ana, kept_by_vera = cookie_of(ana), cookie_of(vera)
        ana.post("/api/system/backups").raise_for_status()
        for name, mode in modes(data).items():
            assert name == "service.log" or mode == (0o700 if name in ("data", "backups") else 0o600), name
        assert len(modes(data)) >= 9
        out = cookie_header(kept_by_vera, service)
        assert asyncio.run(watch(service, out, vera)) == OVER
        assert httpx.get(f"{service.url}/api/state", headers=out).status_code == 401

    request.getfixturevalue("moved_clock")
    with running_service(data, params="ideal") as service:
        kept, out = cookie_header(kept_by_ana, service), cookie_header(kept_by_vera, service)
        assert httpx.get(f"{service.url}/api/session", headers=kept).json()["name"] == "Ana"
        assert httpx.post(f"{service.url}/api/stop", headers=kept).status_code == 200
        assert httpx.get(f"{service.url}/api/session", headers=out).status_code == 401
        assert httpx.post(f"{service.url}/api/stop", headers=out).status_code == 401

        vic, cat = signed_in(service, "Vic", "viewer-token"), signed_in(service, "Cat")
        before = (data / "token").read_text().strip()
        rotate = [sys.executable, "-m", "backend", "token", "rotate", "--role", "operator", "--data", str(data)]
        printed = subprocess.run(rotate, check=True, capture_output=True, text=True).stdout
        assert (data / "token").read_text().strip() in printed
        until(lambda: httpx.get(f"{service.url}/api/session", headers=kept).status_code == 401)
        assert httpx.post(f"{service.url}/api/session", json={"token": before}).status_code == 401
        assert cat.post("/api/stop").status_code == 401
        assert vic.post("/api/stop").status_code == 200

        ana = signed_in(service, "Ana")
        fresh = ana.post("/api/session/tokens/rotate", json={}).raise_for_status().json()["tokens"]
        assert set(fresh) == {"operator", "viewer"}
        assert ana.post("/api/stop").status_code == 200
        assert ana.get("/api/session").json()["name"] == "Ana"
        assert vic.get("/api/state").status_code == 401
        bearer = {"Authorization": f"Bearer {fresh['operator']}"}
        assert httpx.post(f"{service.url}/api/reset", headers=bearer).status_code == 200
        log = service.log.read_text()
        assert fresh["operator"] not in log
        assert fresh["viewer"] not in log


def test_wrong_tokens_lock_out_no_signed_in_person(service: Service) -> None:
    foreign = {"Sec-Fetch-Site": "cross-site", "Sec-Fetch-Dest": "image"}
    for headers in (foreign, {}):
        for _ in range(ATTEMPTS + 2):
            httpx.get(f"{service.url}/?token=wrong", headers=headers)
    assert httpx.get(f"{service.url}/?token=wrong").status_code == 429
    assert signed_in(service, "Ana").get("/api/session").json()["name"] == "Ana"
    assert httpx.get(service.link).status_code == 303


def test_a_viewer_of_the_same_name_has_separate_preferences(service: Service) -> None:
    ana, other = signed_in(service, "Ana"), signed_in(service, "Ana", "viewer-token")
    liked = ana.get("/api/preferences").json() | {"scheme": "light", "window_s": 33.0}
    ana.put("/api/preferences", json=liked).raise_for_status()
    other.put("/api/preferences", json=liked | {"scheme": "dark"}).raise_for_status()
    assert ana.get("/api/preferences").json()["scheme"] == "light"
    assert other.get("/api/preferences").json()["scheme"] == "dark"
    assert other.get("/api/session").json() == {"name": "Ana (viewer)", "role": "viewer", "asks_name": False}


def test_a_viewer_cannot_rotate_tokens(viewer: httpx.Client) -> None:
    assert viewer.post("/api/session/tokens/rotate", json={}).status_code == 403


def test_connected_people_of_one_name_are_distinguished(service: Service, operator: httpx.Client) -> None:
    async def together() -> list[str]:
        url = service.url.replace("http", "ws") + "/api/live"
        first = signed_in(service, "Eva")
        async with connect(
            url, additional_headers=cookie_header(cookie_of(first), service), close_timeout=0.1
        ) as socket:
            await socket.recv()
            second = await asyncio.to_thread(signed_in, service, "Eva")
            async with connect(
                url, additional_headers=cookie_header(cookie_of(second), service), close_timeout=0.1
            ) as second_socket:
                await second_socket.recv()
                state = await asyncio.to_thread(operator.get, "/api/state")
                return [one["name"] for one in json.loads(state.text)["people"] if one["name"].startswith("Eva")]

    assert asyncio.run(together()) == ["Eva", "Eva (2)"]


# A person gives a name once; a name in use gets a suffix, in whatever spelling.


def newcomer(session: str, role: Role = Role.OPERATOR) -> User:
    return User(str(role), role, session, str(role))


def test_a_new_name_is_requested_once_and_keeps_session_and_control(service: Service) -> None:
    with httpx.Client(base_url=service.url, follow_redirects=True) as browser:
        browser.get(service.link)
        assert browser.get("/api/session").json() == {"name": "operator", "role": "operator", "asks_name": True}
        lease = browser.post("/api/control", json={"take_over": True}).raise_for_status().json()
        assert browser.put("/api/session/name", json={"name": "Ana\u202e Lund"}).status_code == 422
        named = browser.put("/api/session/name", json={"name": " Ana  Lund "}).raise_for_status().json()
        assert named == {"name": "Ana Lund", "role": "operator", "asks_name": False}
        assert browser.get("/api/state").json()["holder"]["name"] == "Ana Lund"
        browser.get(service.link)  # the link again, in the same browser
        assert browser.get("/api/session").json() == named
        # A sign-out without it would keep control until the timeout, and scripts of other tests could send no command.
        browser.delete("/api/control", headers={CONTROL_HEADER: f"{lease['page']}.1"}).raise_for_status()
        old_cookies = dict(browser.cookies)
        browser.delete("/api/session").raise_for_status()
        assert httpx.get(f"{service.url}/api/session", cookies=old_cookies).status_code == 401


def test_a_script_cannot_set_a_name(operator: httpx.Client) -> None:
    assert operator.put("/api/session/name", json={"name": "Ana"}).status_code == 409


@pytest.mark.parametrize("name", ["Ana", "ana", "\uff21na", " A\u200bna "], ids=["same", "small", "wide", "hidden"])
def test_a_name_in_use_gets_a_suffix(name: str) -> None:
    people = ActiveUsers()
    ana = people.rename(newcomer("1"), "Ana")
    with people.connect(ana, is_page=True):
        other = people.rename(newcomer("2"), name)
        assert other.name.casefold() == "ana (2)"
        assert people.rename(newcomer("3", Role.VIEWER), name).name.casefold() == "ana (viewer)"
    assert people.rename(newcomer("2"), "Ana").name == "Ana"


def test_suffixes_of_names_cannot_be_entered() -> None:
    for pretended in ("Ana (2)", "Ana \uff082\uff09", "Ana \u2475"):
        assert "(" not in ActiveUsers().rename(newcomer("1"), pretended).name


@pytest.mark.parametrize("name", ["operator", "Viewer", " ", "()", "\u202e"])
def test_an_invalid_name_is_rejected(name: str) -> None:
    with pytest.raises(RequestRejectedError) as error:
        ActiveUsers().rename(newcomer("1"), name)
    assert (error.value.category, error.value.message.code) == (ErrorCode.BAD_VALUE, "name_not_allowed")


def test_all_pages_of_a_person_are_counted_under_the_new_name() -> None:
    people, unnamed, vic = ActiveUsers(), newcomer("1"), newcomer("2", Role.VIEWER)
    pages = [people.connect(unnamed, is_page=is_page) for is_page in (True, True, False)]
    with pages[0], pages[1], pages[2], people.connect(vic, is_page=True):
        people.rename(unnamed, "Ana")
        seen = [(one.name, one.role, one.pages) for one in people.view()]
    assert seen == [("Ana", Role.OPERATOR, 2), ("viewer", Role.VIEWER, 1)]
    assert people.view() == []


def test_presence_begins_with_the_first_page_of_a_person() -> None:
    people, ana = ActiveUsers(), newcomer("1")
    with people.connect(ana, is_page=True):
        first = people.view()[0].since
        with people.connect(ana, is_page=True):
            assert people.view()[0].since == first
    with people.connect(ana, is_page=True):
        assert people.view()[0].since > first


def test_a_returning_person_whose_name_is_in_use_gets_a_suffix() -> None:
    people = ActiveUsers()
    ana = people.rename(newcomer("1"), "Ana")
    other = people.rename(newcomer("2"), "Ana")  # while the first was absent
    assert ana.name == other.name
    with people.connect(other, is_page=True):
        back = people.resolve_returning(ana)
        assert (back.name, back.session) == ("Ana (2)", "1")
        with people.connect(back, is_page=True):
            assert people.resolve_returning(ana) == back  # as long as the person is connected, on any page
            assert people.resolve_returning(other) == other
    script = User("operator", Role.OPERATOR, BEARER)
    assert people.resolve_returning(script) == script


def test_a_script_keeps_the_name_of_its_role() -> None:
    with pytest.raises(RequestRejectedError) as error:
        ActiveUsers().rename(User("operator", Role.OPERATOR, BEARER), "Ana")
    assert (error.value.category, error.value.message.code) == (ErrorCode.NOT_NOW, "script_cannot_be_renamed")


# Layouts of the charts: stored per person as they were sent, rejected with a message if no chart can show them.

ERRORS = {"title": "Errors", "signals": ["q - q_ref"], "over": None, "share": 1.5}
PLANE = {"title": "S over q", "signals": ["S", "S_ref"], "over": "q", "share": 2.0}


def layout(*panels: dict[str, Any], name: str = "Mine") -> dict[str, Any]:
    return {"version": 1, "name": name, "panels": list(panels)}


@pytest.mark.parametrize(
    ("layouts", "code", "values"),
    [
        (
            [layout(ERRORS, {**ERRORS, "title": "Both", "signals": ["q", "S"]})],
            "several_units",
            {"panel": "Both", "signals": "q in rad and S in N·m/rad"},
        ),
        ([layout({**ERRORS, "signals": ["q_hat"]})], "unknown_signal", {"panel": "Errors", "signal": "q_hat"}),
        ([layout({**ERRORS, "signals": ["q - S"]})], "unknown_signal", {"panel": "Errors", "signal": "q - S"}),
        ([layout(ERRORS, {**PLANE, "over": "speed"})], "unknown_signal", {"panel": "S over q", "signal": "speed"}),
        (
            [layout({**ERRORS, "signals": ["q", "q"]})],
            "duplicate_signal",
            {"panel": "Errors", "signal": "q", "count": 2},
        ),
        ([layout(ERRORS, ERRORS)], "duplicate_panel", {"panel": "Errors", "count": 2}),
        ([layout(ERRORS), layout(PLANE, ERRORS)], "duplicate_layout", {"count": 2}),
        ([layout(PLANE)], "no_panel_over_time", {}),
    ],
)
def test_an_invalid_layout_is_rejected_with_a_message(
    layouts: list[dict[str, Any]], code: str, values: dict[str, object]
) -> None:
    with refused(RequestRejectedError, code, layout="Mine", **values):
        check_preferences([ChartLayout.model_validate(one) for one in layouts])


def test_the_horizontal_axis_may_have_another_unit_than_the_signals() -> None:
    check_preferences([ChartLayout.model_validate(layout(ERRORS, PLANE))])


def test_layouts_are_stored_per_person_and_a_rejected_one_changes_nothing(
    operator: httpx.Client, viewer: httpx.Client
) -> None:
    before = viewer.get("/api/preferences").raise_for_status().json()
    theirs = operator.get("/api/preferences").raise_for_status().json()
    wanted = {**before, "layout": "Mine", "layouts": [layout(ERRORS, PLANE)], "hidden": ["q - q_ref"], "clock": True}
    assert viewer.put("/api/preferences", json=wanted).raise_for_status().json() == wanted
    bad = {**wanted, "layouts": [layout({**ERRORS, "signals": ["F_A", "u_A"]})]}
    answer = viewer.put("/api/preferences", json=bad)
    assert answer.status_code == 422
    error = answer.json()["error"]
    assert error["code"] == "bad_layout"
    assert error["message"] == messages.several_units(layout="Mine", panel="Errors", signals="F_A in N and u_A in V")
    assert viewer.get("/api/preferences").json() == wanted
    assert operator.get("/api/preferences").json() == theirs
    many = {**wanted, "layouts": [layout(ERRORS, name=f"n{number}") for number in range(21)]}
    assert viewer.put("/api/preferences", json=many).status_code == 422
    viewer.put("/api/preferences", json=before).raise_for_status()
