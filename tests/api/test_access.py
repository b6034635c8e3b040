"""Who gets in after a restart, a clock that was set, a sign-out, new tokens; and who may read the data folder."""

import asyncio
import json
import stat
import subprocess
import sys
from contextlib import suppress
from pathlib import Path

import httpx
import pytest
from websockets.exceptions import ConnectionClosed

from backend.auth.authentication import ATTEMPTS
from backend.server.security import COOKIE, OVER
from tests.api.conftest import PATIENCE_S, until
from tests.api.patient import connect
from tests.e2e.service import Service, running_service

CLOCK = "import os, time\nreal, moved = time.time, float(os.environ['MOVED_S'])\ntime.time = lambda: real() + moved\n"


def signed_in(service: Service, name: str, file: str = "token") -> httpx.Client:
    browser = httpx.Client(base_url=service.url, timeout=PATIENCE_S)
    token = (service.data / file).read_text().strip()
    browser.post("/api/session", json={"token": token, "name": name}).raise_for_status()
    return browser


def cookie_of(browser: httpx.Client) -> str:
    (value,) = browser.cookies.values()
    return value


def carried(cookie: str, to: Service) -> dict[str, str]:
    """The header by which a browser shows its cookie at another port: a restarted service of a test gets a new one."""
    return {"Cookie": f"{COOKIE}{to.url.rpartition(':')[2]}={cookie}"}


def modes(data: Path) -> dict[str, int]:
    found = {}
    for path in (data, *data.rglob("*")):
        with suppress(FileNotFoundError):  # one that is written anew has another name until it is whole
            found[path.name] = stat.S_IMODE(path.stat().st_mode)
    return found


async def watch(service: Service, headers: dict[str, str], ended: httpx.Client) -> int | None:
    """Open the live stream, sign out elsewhere, return the code with which the stream is closed."""
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
    """Let processes that are started from now on live 40 days ahead."""
    folder = tmp_path / "clock"
    folder.mkdir()
    (folder / "sitecustomize.py").write_text(CLOCK)
    monkeypatch.setenv("PYTHONPATH", f"{folder}:.")
    monkeypatch.setenv("MOVED_S", str(40 * 86400))


def test_sessions_outlive_restart_and_clock_and_end_when_they_are_told_to(
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
        out = carried(kept_by_vera, service)
        assert asyncio.run(watch(service, out, vera)) == OVER
        assert httpx.get(f"{service.url}/api/state", headers=out).status_code == 401

    request.getfixturevalue("moved_clock")
    with running_service(data, params="ideal") as service:
        kept, out = carried(kept_by_ana, service), carried(kept_by_vera, service)
        assert httpx.get(f"{service.url}/api/session", headers=kept).json()["name"] == "Ana"
        assert httpx.post(f"{service.url}/api/stop", headers=kept).status_code == 200
        assert httpx.get(f"{service.url}/api/session", headers=out).status_code == 401
        assert httpx.post(f"{service.url}/api/stop", headers=out).status_code == 401

        vic, cat = signed_in(service, "Vic", "viewer-token"), signed_in(service, "Cat")
        before = (data / "token").read_text().strip()
        rotate = [sys.executable, "-m", "backend", "token", "rotate", "--role", "operator", "--data", str(data)]
        said = subprocess.run(rotate, check=True, capture_output=True, text=True).stdout
        assert (data / "token").read_text().strip() in said
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


def test_pictures_on_a_foreign_page_and_wrong_tokens_lock_nobody_out(service: Service) -> None:
    foreign = {"Sec-Fetch-Site": "cross-site", "Sec-Fetch-Dest": "image"}
    for headers in (foreign, {}):
        for _ in range(ATTEMPTS + 2):
            httpx.get(f"{service.url}/?token=wrong", headers=headers)
    assert httpx.get(f"{service.url}/?token=wrong").status_code == 429
    assert signed_in(service, "Ana").get("/api/session").json()["name"] == "Ana"
    assert httpx.get(service.link).status_code == 303


def test_a_viewer_of_the_same_name_has_a_page_of_their_own(service: Service) -> None:
    ana, other = signed_in(service, "Ana"), signed_in(service, "Ana", "viewer-token")
    liked = ana.get("/api/preferences").json() | {"scheme": "light", "window_s": 33.0}
    ana.put("/api/preferences", json=liked).raise_for_status()
    other.put("/api/preferences", json=liked | {"scheme": "dark"}).raise_for_status()
    assert ana.get("/api/preferences").json()["scheme"] == "light"
    assert other.get("/api/preferences").json()["scheme"] == "dark"
    assert other.get("/api/session").json() == {"name": "Ana (viewer)", "role": "viewer", "asks_name": False}


def test_a_viewer_rotates_no_token(viewer: httpx.Client) -> None:
    assert viewer.post("/api/session/tokens/rotate", json={}).status_code == 403


def test_who_is_connected_is_told_apart(service: Service, operator: httpx.Client) -> None:
    async def together() -> list[str]:
        url = service.url.replace("http", "ws") + "/api/live"
        first = signed_in(service, "Eva")
        async with connect(url, additional_headers=carried(cookie_of(first), service), close_timeout=0.1) as socket:
            await socket.recv()
            second = await asyncio.to_thread(signed_in, service, "Eva")
            async with connect(
                url, additional_headers=carried(cookie_of(second), service), close_timeout=0.1
            ) as beside:
                await beside.recv()
                state = await asyncio.to_thread(operator.get, "/api/state")
                return [one["name"] for one in json.loads(state.text)["people"] if one["name"].startswith("Eva")]

    assert asyncio.run(together()) == ["Eva", "Eva (2)"]
