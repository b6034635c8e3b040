"""The gate and the tokens, on their own."""

import stat
from pathlib import Path

import pytest
from fastapi import Response
from starlette.requests import HTTPConnection

from backend.api.auth import ATTEMPTS, ATTEMPTS_WINDOW_S, COOKIE, Gate, Person
from backend.api.errors import ApiError
from backend.api.schemas.session import Role
from backend.api.tokens import Tokens, load_tokens
from backend.settings import Settings

TOKENS = Tokens(operator="o" * 43, viewer="v" * 43)


class Clock:
    def __init__(self) -> None:
        self.now = 1000.0

    def __call__(self) -> float:
        return self.now


def connection(headers: dict[str, str], address: str = "10.0.0.1") -> HTTPConnection:
    raw = [(name.lower().encode(), value.encode()) for name, value in headers.items()]
    return HTTPConnection({"type": "http", "headers": raw, "client": (address, 1)})


def cookie_of(gate: Gate, person: Person) -> str:
    response = Response()
    gate.grant(response, person)
    return response.headers["set-cookie"]


def status(error: pytest.ExceptionInfo[ApiError]) -> int:
    return error.value.status


def test_each_token_opens_its_role_and_others_none() -> None:
    gate = Gate(TOKENS)
    assert gate.sign_in(TOKENS.operator, "Ana", "a").role is Role.OPERATOR
    viewer = gate.sign_in(TOKENS.viewer, "", "a")
    assert (viewer.role, viewer.name) == (Role.VIEWER, "viewer")
    assert len(viewer.session) >= 16
    with pytest.raises(ApiError) as error:
        gate.sign_in("o" * 42, "", "a")
    assert status(error) == 401


def test_the_cookie_is_recognised_by_another_gate_with_the_same_tokens_only() -> None:
    header = cookie_of(Gate(TOKENS), Person("Ana", Role.OPERATOR, "s"))
    assert "HttpOnly" in header
    assert "SameSite=strict" in header
    value = header.partition("=")[2].partition(";")[0]
    asks = connection({"cookie": f"{COOKIE}={value}"})
    assert Gate(TOKENS).recognise(asks) == Person("Ana", Role.OPERATOR, "s")
    assert Gate(Tokens("n" * 43, TOKENS.viewer)).recognise(asks) is None


def test_a_forged_cookie_is_nobody() -> None:
    gate = Gate(TOKENS)
    value = cookie_of(gate, Person("Vera", Role.VIEWER, "s")).partition("=")[2].partition(";")[0]
    content, rest = value.split(".", 1)
    forged = content[:-3] + ("AAA" if content[-3:] != "AAA" else "BBB")
    assert gate.recognise(connection({"cookie": f"{COOKIE}={forged}.{rest}"})) is None


def test_wrong_tokens_lock_sign_in_for_a_while_and_for_that_address_only() -> None:
    clock = Clock()
    gate = Gate(TOKENS, clock)
    for _ in range(ATTEMPTS):
        with pytest.raises(ApiError):
            gate.sign_in("wrong", "", "here")
    with pytest.raises(ApiError) as error:
        gate.sign_in(TOKENS.operator, "", "here")
    assert status(error) == 429
    assert int(error.value.headers["Retry-After"]) <= ATTEMPTS_WINDOW_S + 1
    assert gate.sign_in(TOKENS.operator, "", "elsewhere").role is Role.OPERATOR
    clock.now += ATTEMPTS_WINDOW_S + 1
    assert gate.sign_in(TOKENS.operator, "", "here").role is Role.OPERATOR


def test_a_script_with_the_right_token_is_never_locked_out() -> None:
    gate = Gate(TOKENS, Clock())
    wrong = connection({"authorization": "Bearer nonsense"})
    for _ in range(ATTEMPTS):
        with pytest.raises(ApiError) as error:
            gate.recognise(wrong)
        assert status(error) == 401
    with pytest.raises(ApiError) as error:
        gate.recognise(wrong)
    assert status(error) == 429
    person = gate.recognise(connection({"authorization": f"Bearer {TOKENS.operator}"}))
    assert person is not None
    assert person.role is Role.OPERATOR


def test_tokens_are_made_once_and_readable_by_their_owner_only(tmp_path: Path) -> None:
    made = load_tokens(tmp_path / "data")
    assert load_tokens(tmp_path / "data") == made
    for name in ("token", "viewer-token"):
        assert stat.S_IMODE((tmp_path / "data" / name).stat().st_mode) == 0o600
    (tmp_path / "data" / "token").chmod(0o644)
    load_tokens(tmp_path / "data")
    assert stat.S_IMODE((tmp_path / "data" / "token").stat().st_mode) == 0o600
    assert made.operator not in repr(made)


def test_an_emptied_token_file_is_refused(tmp_path: Path) -> None:
    load_tokens(tmp_path)
    (tmp_path / "token").write_text("")
    with pytest.raises(ValueError, match="no usable token"):
        load_tokens(tmp_path)


@pytest.mark.parametrize("host", ["0.0.0.0", "192.168.1.4", "::", "lab.example"])
def test_another_address_without_a_token_is_refused(host: str) -> None:
    with pytest.raises(ValueError, match="needs the token"):
        Settings(host=host, require_token=False)
    assert Settings(host=host).host == host


@pytest.mark.parametrize("host", ["127.0.0.1", "::1", "localhost"])
def test_this_machine_may_go_without(host: str) -> None:
    assert not Settings(host=host, require_token=False).require_token
