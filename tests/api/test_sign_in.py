"""Sign-in, roles and what is open, on the running service."""

from urllib.parse import urlsplit

import httpx
import pytest

from backend.server.security import COOKIE
from tests.api.conftest import problem
from tests.e2e.service import Service

CLOSED = ["/api/state", "/api/tuning", "/api/runs", "/api/banks", "/api/identifications", "/api/session", "/scene/"]


def test_the_link_gives_a_cookie_and_an_address_without_the_token(service: Service) -> None:
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
def test_nobody_gets_in_without_a_token_or_with_a_wrong_one(service: Service, path: str) -> None:
    assert httpx.get(service.url + path).status_code == 401
    wrong = httpx.get(service.url + path, headers={"Authorization": "Bearer wrong"})
    assert wrong.status_code in (401, 429)
    assert httpx.get(service.url + path, cookies={COOKIE + service.url.rpartition(":")[2]: "forged"}).status_code == 401


def test_a_wrong_link_is_refused_and_the_log_keeps_no_token(service: Service) -> None:
    answer = httpx.get(service.url + "/?token=wrong-and-unique-token")
    assert answer.status_code in (401, 429)
    assert "set-cookie" not in answer.headers
    log = service.log.read_text()
    assert "wrong-and-unique-token" not in log
    assert log.count(urlsplit(service.link).query) == 1


def test_health_is_open_and_tells_no_secret(service: Service, operator: httpx.Client) -> None:
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
def test_a_viewer_watches_and_commands_nothing(
    viewer: httpx.Client, method: str, path: str, body: dict[str, object] | None
) -> None:
    assert viewer.get("/api/state").status_code == 200
    refused = viewer.request(method, path, json=body)
    assert refused.status_code == 403
    assert "operator" in str(problem(refused)["message"])


def test_a_viewer_may_stop(viewer: httpx.Client, off: httpx.Client) -> None:
    assert viewer.post("/api/stop").status_code == 200
    assert off.get("/api/state").json()["mode"] == "tripped"
