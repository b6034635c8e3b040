"""Authentication: tokens, cookies, sessions, rate limits and token files."""

import asyncio
import stat
import time
from pathlib import Path

import pytest
from fastapi import Response
from starlette.requests import HTTPConnection

from backend.api.errors import STATUS_BY_CODE
from backend.auth.authentication import ATTEMPTS, ATTEMPTS_WINDOW_S, GRACE_S, SIGN_INS, Authentication, User
from backend.auth.sessions import IDLE_S, LIVE_OF_A_ROLE, Sessions, TokenError, TokenFiles, load_tokens, replace_tokens
from backend.errors import RequestRejectedError
from backend.schemas.session import Role
from backend.server.security import COOKIE, end_session, read_credentials, set_session_cookie
from backend.settings import Settings
from tests.refusals import refused


class Clock:
    def __init__(self) -> None:
        self.now = 1000.0

    def __call__(self) -> float:
        return self.now


class AuthenticationBench:
    """Authentication on a data folder with a test clock, and the requests of browsers."""

    def __init__(self, data: Path) -> None:
        self.clock = Clock()
        self.sessions = Sessions(data, self.clock)
        self.files = TokenFiles(data)
        self.authentication = Authentication(self.files, self.sessions, self.clock)

    def token(self, role: Role = Role.OPERATOR) -> str:
        return self.files.tokens.get(role)

    def cookie(self, name: str = "Ana", role: Role = Role.OPERATOR, **headers: str) -> str:
        """Sign in and return the cookie that the browser sends afterwards."""
        request = connection(headers)
        return self.grant_cookie(
            request, self.authentication.sign_in(read_credentials(request), self.token(role), name)
        )

    def grant_cookie(self, request: HTTPConnection, person: User) -> str:
        response = Response()
        set_session_cookie(self.authentication, request, response, person)
        return response.headers["set-cookie"].partition(";")[0]

    def user_of(self, cookie: str) -> User | None:
        return self.authentication.authenticate(read_credentials(connection({"cookie": cookie})))

    def stop_user_of(self, cookie: str) -> User | None:
        return self.authentication.authenticate_for_stop(read_credentials(connection({"cookie": cookie})))

    def sign_out(self, cookie: str) -> None:
        end_session(self.authentication, connection({"cookie": cookie}), Response())


@pytest.fixture
def bench(tmp_path: Path) -> AuthenticationBench:
    return AuthenticationBench(tmp_path)


def connection(headers: dict[str, str], address: str = "10.0.0.1") -> HTTPConnection:
    every = {"host": "localhost:8000", **headers}
    raw = [(name.lower().encode(), value.encode()) for name, value in every.items()]
    return HTTPConnection({"type": "http", "headers": raw, "client": (address, 1)})


def status(error: pytest.ExceptionInfo[RequestRejectedError]) -> int:
    return STATUS_BY_CODE[error.value.category]


def sign_in_status(bench: AuthenticationBench, token: str, address: str = "here", **headers: str) -> int:
    with pytest.raises(RequestRejectedError) as error:
        bench.authentication.sign_in(
            read_credentials(connection({name.replace("_", "-"): value for name, value in headers.items()}, address)),
            token,
        )
    return status(error)


def test_each_token_grants_its_role_and_other_tokens_are_rejected(bench: AuthenticationBench) -> None:
    assert bench.authentication.sign_in(read_credentials(connection({})), bench.token(), "Ana").role is Role.OPERATOR
    viewer = bench.authentication.sign_in(read_credentials(connection({})), bench.token(Role.VIEWER))
    assert (viewer.role, viewer.name) == (Role.VIEWER, "viewer")
    assert len(viewer.session) >= 16
    assert sign_in_status(bench, bench.token()[:-1]) == 401
    assert sign_in_status(bench, "\ud800") == 401


def test_a_cookie_is_valid_only_for_the_tokens_that_signed_it(bench: AuthenticationBench, tmp_path: Path) -> None:
    response = Response()
    request = connection({})
    ana = bench.authentication.sign_in(read_credentials(request), bench.token(), "Ana")
    set_session_cookie(bench.authentication, request, response, ana)
    header = response.headers["set-cookie"]
    assert "HttpOnly" in header
    assert "SameSite=strict" in header
    pair = header.partition(";")[0]
    assert bench.user_of(pair) == ana
    other = AuthenticationBench(tmp_path / "other")
    assert other.user_of(pair) is None
    assert other.stop_user_of(pair) is None


def test_forged_cookies_are_rejected(bench: AuthenticationBench) -> None:
    name, _, value = bench.cookie("Vera", Role.VIEWER).partition("=")
    content, rest = value.split(".", 1)
    forged = content[:-3] + ("AAA" if content[-3:] != "AAA" else "BBB")
    for wrong in (f"{forged}.{rest}", "", "x" * 100_000, value + "A", "."):
        assert bench.user_of(f"{name}={wrong}") is None
        assert bench.stop_user_of(f"{name}={wrong}") is None


@pytest.mark.parametrize("moved_s", [-3600.0, 40 * 86400.0])
def test_setting_the_system_clock_does_not_end_sessions(
    bench: AuthenticationBench, monkeypatch: pytest.MonkeyPatch, moved_s: float
) -> None:
    pair = bench.cookie()
    moved = time.time() + moved_s
    monkeypatch.setattr("time.time", lambda: moved)
    assert bench.user_of(pair) is not None
    assert bench.stop_user_of(pair) is not None


def test_an_idle_session_expires_but_may_still_send_stop(bench: AuthenticationBench) -> None:
    pair = bench.cookie()
    bench.clock.now += IDLE_S - 10.0
    assert bench.user_of(pair) is not None
    bench.clock.now += IDLE_S + 10.0
    assert bench.user_of(pair) is None
    stops = bench.stop_user_of(pair)
    assert stops is not None
    assert stops.name == "Ana"


def test_the_cookie_of_a_lost_session_may_still_send_stop(bench: AuthenticationBench, tmp_path: Path) -> None:
    pair = bench.cookie()
    again = AuthenticationBench(tmp_path)  # the session file was never written
    assert again.user_of(pair) is None
    assert again.stop_user_of(pair) is not None


def test_viewer_sessions_do_not_evict_operator_sessions(bench: AuthenticationBench) -> None:
    ana = bench.cookie()
    first = bench.cookie("Vic", Role.VIEWER)
    for _ in range(LIVE_OF_A_ROLE):
        bench.clock.now += ATTEMPTS_WINDOW_S / SIGN_INS + 0.1
        bench.cookie("Vic", Role.VIEWER)
    assert bench.user_of(first) is None
    assert bench.stop_user_of(first) is not None
    assert bench.user_of(ana) is not None


def test_signing_out_invalidates_only_the_own_cookie(bench: AuthenticationBench) -> None:
    pair, other = bench.cookie(), bench.cookie()
    bench.sign_out(pair)
    assert bench.user_of(pair) is None
    assert bench.stop_user_of(pair) is None
    assert bench.user_of(other) is not None


def test_two_services_on_one_host_use_different_cookie_names(tmp_path: Path) -> None:
    here, there = AuthenticationBench(tmp_path / "here"), AuthenticationBench(tmp_path / "there")
    ours = here.cookie()
    theirs = there.cookie(host="localhost:8001")
    assert ours.partition("=")[0] == f"{COOKIE}8000"
    jar = dict(pair.split("=", 1) for pair in (ours, theirs))  # a browser stores cookies by name, for all ports
    sent = "; ".join(f"{name}={value}" for name, value in jar.items())
    assert here.user_of(sent) is not None
    assert (
        there.authentication.authenticate(read_credentials(connection({"cookie": sent, "host": "localhost:8001"})))
        is not None
    )


def test_foreign_cookies_of_the_same_name_do_not_hide_the_valid_cookie(bench: AuthenticationBench) -> None:
    assert bench.user_of(f"{COOKIE}8000=planted; {bench.cookie()}; {COOKIE}8000=") is not None


@pytest.mark.parametrize("host", ["lab", "lab:99999999", "[::1]", "", "lab:\u0663"])
def test_unusual_host_headers_do_not_break_authentication(host: str) -> None:
    raw = [(b"host", host.encode())]
    without_tokens = Authentication(None)
    assert without_tokens.authenticate(read_credentials(HTTPConnection({"type": "http", "headers": raw}))) is not None


def test_new_sessions_are_rate_limited_per_role_and_address(bench: AuthenticationBench) -> None:
    """Existing sessions, other roles and other addresses are not limited."""
    ours = [
        bench.authentication.sign_in(read_credentials(connection({}, "here")), bench.token(Role.VIEWER))
        for _ in range(SIGN_INS)
    ]
    with pytest.raises(RequestRejectedError) as error:
        bench.authentication.sign_in(read_credentials(connection({}, "here")), bench.token(Role.VIEWER))
    assert status(error) == 429
    assert bench.authentication.sessions.is_live(ours[0].session)
    assert bench.authentication.sign_in(read_credentials(connection({}, "here")), bench.token()).role is Role.OPERATOR
    assert bench.authentication.sign_in(read_credentials(connection({}, "there")), bench.token(Role.VIEWER))
    bench.clock.now += ATTEMPTS_WINDOW_S + 1
    assert bench.authentication.sign_in(read_credentials(connection({}, "here")), bench.token(Role.VIEWER))


def test_sign_ins_do_not_evict_a_session_with_an_open_page(bench: AuthenticationBench) -> None:
    ana = bench.authentication.sign_in(read_credentials(connection({})), bench.token(), "Ana")
    with bench.authentication.active_users.connect(ana, is_page=True):
        for number in range(LIVE_OF_A_ROLE + 1):
            bench.clock.now += ATTEMPTS_WINDOW_S / SIGN_INS + 0.1
            last = bench.authentication.sign_in(
                read_credentials(connection({}, f"10.0.0.{number}")), bench.token(), f"{number}"
            )
        assert bench.authentication.sessions.is_live(ana.session)
        assert bench.authentication.sessions.is_live(last.session)


def test_wrong_tokens_are_rate_limited_and_valid_tokens_are_not(bench: AuthenticationBench) -> None:
    assert [sign_in_status(bench, "wrong") for _ in range(ATTEMPTS)] == [401] * ATTEMPTS
    with pytest.raises(RequestRejectedError) as error:
        bench.authentication.sign_in(read_credentials(connection({}, "here")), "wrong")
    assert status(error) == 429
    assert error.value.retry_after_s <= ATTEMPTS_WINDOW_S + 1
    assert bench.authentication.sign_in(read_credentials(connection({}, "here")), bench.token()).role is Role.OPERATOR
    assert sign_in_status(bench, "wrong", "elsewhere") == 401
    bench.clock.now += ATTEMPTS_WINDOW_S + 1
    assert sign_in_status(bench, "wrong") == 401


@pytest.mark.parametrize("site", ["cross-site", "same-site"])
def test_attempts_from_foreign_pages_do_not_count_towards_the_rate_limit(bench: AuthenticationBench, site: str) -> None:
    assert [sign_in_status(bench, "wrong", sec_fetch_site=site) for _ in range(3 * ATTEMPTS)] == [401] * 3 * ATTEMPTS
    assert sign_in_status(bench, "wrong") == 401


def test_repeated_checks_of_one_request_count_as_one_attempt(bench: AuthenticationBench) -> None:
    for _ in range(ATTEMPTS):
        request = connection({"authorization": "Bearer nonsense"})
        for _ in range(3):
            with pytest.raises(RequestRejectedError) as error:
                bench.authentication.authenticate(read_credentials(request))
            assert status(error) == 401
    with pytest.raises(RequestRejectedError) as error:
        bench.authentication.authenticate(read_credentials(connection({"authorization": "Bearer nonsense"})))
    assert status(error) == 429
    person = bench.authentication.authenticate(
        read_credentials(connection({"authorization": f"Bearer {bench.token()}"}))
    )
    assert person is not None
    assert person.role is Role.OPERATOR


def test_a_second_sign_in_continues_or_replaces_the_session_of_the_browser(bench: AuthenticationBench) -> None:
    pair = bench.cookie("Ana")
    ana = bench.user_of(pair)
    again = bench.authentication.sign_in(read_credentials(connection({"cookie": pair})), bench.token())
    assert again == ana
    vera = bench.authentication.sign_in(read_credentials(connection({"cookie": pair})), bench.token(), "Vera")
    assert vera.session != again.session
    assert bench.user_of(pair) is None


def test_connected_users_with_the_same_name_get_distinct_names(bench: AuthenticationBench) -> None:
    ana = bench.authentication.sign_in(read_credentials(connection({})), bench.token(), "Ana")
    with bench.authentication.active_users.connect(ana, is_page=True):
        second = bench.authentication.sign_in(read_credentials(connection({})), bench.token(), "Ana")
        viewer = bench.authentication.sign_in(read_credentials(connection({})), bench.token(Role.VIEWER), "Ana")
        there = bench.authentication.active_users
        with there.connect(second, is_page=True), there.connect(viewer, is_page=True):
            assert [one.name for one in bench.authentication.active_users.view()] == ["Ana", "Ana (2)", "Ana (viewer)"]
        pretender = bench.authentication.sign_in(
            read_credentials(connection({})), bench.token(Role.VIEWER), " Ana (2)\n\u202e"
        )
        assert pretender.name == "Ana 2 (viewer)"
    assert bench.authentication.active_users.view() == []
    assert bench.authentication.sign_in(read_credentials(connection({})), bench.token(), "Ana").name == "Ana"


def test_rotating_a_token_ends_the_other_sessions_of_its_role(bench: AuthenticationBench) -> None:
    ana, vera, vic = bench.cookie("Ana"), bench.cookie("Vera"), bench.cookie("Vic", Role.VIEWER)
    request = connection({"cookie": ana})
    rotating = bench.authentication.authenticate(read_credentials(request))
    assert rotating is not None
    before = bench.token()
    tokens = asyncio.run(bench.authentication.rotate([Role.OPERATOR], rotating))
    assert sign_in_status(bench, before) == 401
    assert bench.authentication.sign_in(read_credentials(connection({})), tokens.operator).role is Role.OPERATOR
    assert bench.user_of(vera) is None
    assert bench.stop_user_of(vera) is None
    assert bench.user_of(vic) is not None
    assert bench.user_of(bench.grant_cookie(request, rotating)) == rotating
    assert bench.stop_user_of(ana) is not None  # until the browser has the new cookie
    bench.clock.now += GRACE_S + 1
    assert bench.stop_user_of(ana) is None


def test_a_changed_token_file_is_reloaded_and_a_missing_one_is_ignored(
    bench: AuthenticationBench, tmp_path: Path
) -> None:
    async def notice(over: asyncio.Event) -> None:
        task = asyncio.create_task(bench.authentication.run())
        await asyncio.wait_for(over.wait(), 60.0)
        task.cancel()

    ana, before = bench.cookie(), bench.token()
    person = bench.user_of(ana)
    assert person is not None
    (tmp_path / "viewer-token").unlink()
    with bench.authentication.active_users.connect(person, is_page=True) as over:
        replace_tokens(tmp_path, [Role.OPERATOR])
        asyncio.run(notice(over))
    assert bench.token() != before
    assert bench.user_of(ana) is None
    assert bench.authentication.sign_in(read_credentials(connection({})), bench.token(Role.VIEWER)).role is Role.VIEWER


@pytest.mark.parametrize("content", ["", "{", "[]", '{"ran_s": 1, "live": {"a": 3}, "ended": []}', "\x00"])
def test_a_damaged_session_file_ends_sessions_but_permits_stop(
    bench: AuthenticationBench, tmp_path: Path, content: str
) -> None:
    pair = bench.cookie()
    asyncio.run(bench.sessions.save())
    assert AuthenticationBench(tmp_path).user_of(pair) is not None
    (tmp_path / "sessions.json").write_text(content)
    again = AuthenticationBench(tmp_path)
    assert again.user_of(pair) is None
    assert again.stop_user_of(pair) is not None


def test_an_unwritable_session_file_is_reported(bench: AuthenticationBench, tmp_path: Path) -> None:
    (tmp_path / "sessions.json.new").mkdir()
    asyncio.run(bench.sessions.save())
    assert bench.sessions.problem is not None
    (tmp_path / "sessions.json.new").rmdir()
    asyncio.run(bench.sessions.save())
    assert bench.sessions.problem is None


# Token files, and addresses that require a token.


def test_tokens_are_generated_once_and_readable_only_by_their_owner(tmp_path: Path) -> None:
    made = load_tokens(tmp_path / "data")
    assert load_tokens(tmp_path / "data") == made
    for name in ("token", "viewer-token"):
        assert stat.S_IMODE((tmp_path / "data" / name).stat().st_mode) == 0o600
    (tmp_path / "data" / "token").chmod(0o644)
    load_tokens(tmp_path / "data")
    assert stat.S_IMODE((tmp_path / "data" / "token").stat().st_mode) == 0o600
    assert made.operator not in repr(made)


def test_an_empty_token_file_is_rejected(tmp_path: Path) -> None:
    load_tokens(tmp_path)
    (tmp_path / "token").write_text("")
    with refused(TokenError, "no_usable_token", file=str(tmp_path / "token")):
        load_tokens(tmp_path)


@pytest.mark.parametrize("host", ["0.0.0.0", "192.168.1.4", "::", "lab.example"])
def test_other_addresses_require_a_token(host: str) -> None:
    with pytest.raises(ValueError, match="needs the token"):
        Settings(host=host, require_token=False)
    assert Settings(host=host).host == host


@pytest.mark.parametrize("host", ["127.0.0.1", "::1", "localhost"])
def test_loopback_addresses_do_not_require_a_token(host: str) -> None:
    assert not Settings(host=host, require_token=False).require_token
