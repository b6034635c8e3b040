"""Who is recognized by what, and where the tokens are kept."""

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

# Who is recognized by what, on its own.


class Clock:
    def __init__(self) -> None:
        self.now = 1000.0

    def __call__(self) -> float:
        return self.now


class Door:
    """Authentication on a data folder, its clock, and what browsers do at it."""

    def __init__(self, data: Path) -> None:
        self.clock = Clock()
        self.sessions = Sessions(data, self.clock)
        self.files = TokenFiles(data)
        self.authentication = Authentication(self.files, self.sessions, self.clock)

    def token(self, role: Role = Role.OPERATOR) -> str:
        return self.files.tokens.get(role)

    def cookie(self, name: str = "Ana", role: Role = Role.OPERATOR, **headers: str) -> str:
        """Sign in; return the pair that the browser sends from then on."""
        asks = connection(headers)
        return self.granted(asks, self.authentication.sign_in(read_credentials(asks), self.token(role), name))

    def granted(self, asks: HTTPConnection, person: User) -> str:
        response = Response()
        set_session_cookie(self.authentication, asks, response, person)
        return response.headers["set-cookie"].partition(";")[0]

    def who(self, cookie: str) -> User | None:
        return self.authentication.authenticate(read_credentials(connection({"cookie": cookie})))

    def who_stops(self, cookie: str) -> User | None:
        return self.authentication.authenticate_for_stop(read_credentials(connection({"cookie": cookie})))

    def sign_out(self, cookie: str) -> None:
        end_session(self.authentication, connection({"cookie": cookie}), Response())


@pytest.fixture
def door(tmp_path: Path) -> Door:
    return Door(tmp_path)


def connection(headers: dict[str, str], address: str = "10.0.0.1") -> HTTPConnection:
    every = {"host": "localhost:8000", **headers}
    raw = [(name.lower().encode(), value.encode()) for name, value in every.items()]
    return HTTPConnection({"type": "http", "headers": raw, "client": (address, 1)})


def status(error: pytest.ExceptionInfo[RequestRejectedError]) -> int:
    return STATUS_BY_CODE[error.value.category]


def sign_in_status(door: Door, token: str, address: str = "here", **headers: str) -> int:
    with pytest.raises(RequestRejectedError) as error:
        door.authentication.sign_in(
            read_credentials(connection({name.replace("_", "-"): value for name, value in headers.items()}, address)),
            token,
        )
    return status(error)


def test_each_token_opens_its_role_and_others_none(door: Door) -> None:
    assert door.authentication.sign_in(read_credentials(connection({})), door.token(), "Ana").role is Role.OPERATOR
    viewer = door.authentication.sign_in(read_credentials(connection({})), door.token(Role.VIEWER))
    assert (viewer.role, viewer.name) == (Role.VIEWER, "viewer")
    assert len(viewer.session) >= 16
    assert sign_in_status(door, door.token()[:-1]) == 401
    assert sign_in_status(door, "\ud800") == 401


def test_the_cookie_is_recognized_with_the_same_tokens_only(door: Door, tmp_path: Path) -> None:
    response = Response()
    asks = connection({})
    ana = door.authentication.sign_in(read_credentials(asks), door.token(), "Ana")
    set_session_cookie(door.authentication, asks, response, ana)
    header = response.headers["set-cookie"]
    assert "HttpOnly" in header
    assert "SameSite=strict" in header
    pair = header.partition(";")[0]
    assert door.who(pair) == ana
    other = Door(tmp_path / "other")
    assert other.who(pair) is None
    assert other.who_stops(pair) is None


def test_a_forged_cookie_is_nobody(door: Door) -> None:
    name, _, value = door.cookie("Vera", Role.VIEWER).partition("=")
    content, rest = value.split(".", 1)
    forged = content[:-3] + ("AAA" if content[-3:] != "AAA" else "BBB")
    for wrong in (f"{forged}.{rest}", "", "x" * 100_000, value + "A", "."):
        assert door.who(f"{name}={wrong}") is None
        assert door.who_stops(f"{name}={wrong}") is None


@pytest.mark.parametrize("moved_s", [-3600.0, 40 * 86400.0])
def test_a_clock_that_was_set_signs_nobody_out(door: Door, monkeypatch: pytest.MonkeyPatch, moved_s: float) -> None:
    pair = door.cookie()
    moved = time.time() + moved_s
    monkeypatch.setattr("time.time", lambda: moved)
    assert door.who(pair) is not None
    assert door.who_stops(pair) is not None


def test_a_session_that_fell_asleep_may_still_stop(door: Door) -> None:
    pair = door.cookie()
    door.clock.now += IDLE_S - 10.0
    assert door.who(pair) is not None
    door.clock.now += IDLE_S + 10.0
    assert door.who(pair) is None
    stops = door.who_stops(pair)
    assert stops is not None
    assert stops.name == "Ana"


def test_a_cookie_whose_session_was_forgotten_may_still_stop(door: Door, tmp_path: Path) -> None:
    pair = door.cookie()
    again = Door(tmp_path)  # the file of sessions was never written
    assert again.who(pair) is None
    assert again.who_stops(pair) is not None


def test_many_viewers_push_out_no_operator(door: Door) -> None:
    ana = door.cookie()
    first = door.cookie("Vic", Role.VIEWER)
    for _ in range(LIVE_OF_A_ROLE):
        door.clock.now += ATTEMPTS_WINDOW_S / SIGN_INS + 0.1
        door.cookie("Vic", Role.VIEWER)
    assert door.who(first) is None
    assert door.who_stops(first) is not None
    assert door.who(ana) is not None


def test_signing_out_ends_the_cookie_wherever_it_is(door: Door) -> None:
    pair, other = door.cookie(), door.cookie()
    door.sign_out(pair)
    assert door.who(pair) is None
    assert door.who_stops(pair) is None
    assert door.who(other) is not None


def test_two_services_on_one_host_leave_each_other_their_cookies(tmp_path: Path) -> None:
    here, there = Door(tmp_path / "here"), Door(tmp_path / "there")
    ours = here.cookie()
    theirs = there.cookie(host="localhost:8001")
    assert ours.partition("=")[0] == f"{COOKIE}8000"
    jar = dict(pair.split("=", 1) for pair in (ours, theirs))  # as a browser keeps them: by name, for all ports
    sent = "; ".join(f"{name}={value}" for name, value in jar.items())
    assert here.who(sent) is not None
    assert (
        there.authentication.authenticate(read_credentials(connection({"cookie": sent, "host": "localhost:8001"})))
        is not None
    )


def test_a_cookie_of_the_same_name_from_elsewhere_does_not_hide_ours(door: Door) -> None:
    assert door.who(f"{COOKIE}8000=planted; {door.cookie()}; {COOKIE}8000=") is not None


@pytest.mark.parametrize("host", ["lab", "lab:99999999", "[::1]", "", "lab:\u0663"])
def test_any_host_header_has_a_cookie_name(host: str) -> None:
    raw = [(b"host", host.encode())]
    door_less = Authentication(None)
    assert door_less.authenticate(read_credentials(HTTPConnection({"type": "http", "headers": raw}))) is not None


def test_new_sessions_have_a_rate_for_each_role_and_address(door: Door) -> None:
    """Who may begin no more sessions goes on with those that there are, and slows nobody else."""
    ours = [
        door.authentication.sign_in(read_credentials(connection({}, "here")), door.token(Role.VIEWER))
        for _ in range(SIGN_INS)
    ]
    with pytest.raises(RequestRejectedError) as error:
        door.authentication.sign_in(read_credentials(connection({}, "here")), door.token(Role.VIEWER))
    assert status(error) == 429
    assert door.authentication.sessions.is_live(ours[0].session)
    assert door.authentication.sign_in(read_credentials(connection({}, "here")), door.token()).role is Role.OPERATOR
    assert door.authentication.sign_in(read_credentials(connection({}, "there")), door.token(Role.VIEWER))
    door.clock.now += ATTEMPTS_WINDOW_S + 1
    assert door.authentication.sign_in(read_credentials(connection({}, "here")), door.token(Role.VIEWER))


def test_no_sign_in_pushes_out_a_session_with_an_open_page(door: Door) -> None:
    ana = door.authentication.sign_in(read_credentials(connection({})), door.token(), "Ana")
    with door.authentication.active_users.connect(ana, is_page=True):
        for number in range(LIVE_OF_A_ROLE + 1):
            door.clock.now += ATTEMPTS_WINDOW_S / SIGN_INS + 0.1
            last = door.authentication.sign_in(
                read_credentials(connection({}, f"10.0.0.{number}")), door.token(), f"{number}"
            )
        assert door.authentication.sessions.is_live(ana.session)
        assert door.authentication.sessions.is_live(last.session)


def test_wrong_tokens_are_slowed_and_the_right_one_never(door: Door) -> None:
    assert [sign_in_status(door, "wrong") for _ in range(ATTEMPTS)] == [401] * ATTEMPTS
    with pytest.raises(RequestRejectedError) as error:
        door.authentication.sign_in(read_credentials(connection({}, "here")), "wrong")
    assert status(error) == 429
    assert error.value.retry_after_s <= ATTEMPTS_WINDOW_S + 1
    assert door.authentication.sign_in(read_credentials(connection({}, "here")), door.token()).role is Role.OPERATOR
    assert sign_in_status(door, "wrong", "elsewhere") == 401
    door.clock.now += ATTEMPTS_WINDOW_S + 1
    assert sign_in_status(door, "wrong") == 401


@pytest.mark.parametrize("site", ["cross-site", "same-site"])
def test_what_a_foreign_page_makes_a_browser_send_counts_for_nobody(door: Door, site: str) -> None:
    assert [sign_in_status(door, "wrong", sec_fetch_site=site) for _ in range(3 * ATTEMPTS)] == [401] * 3 * ATTEMPTS
    assert sign_in_status(door, "wrong") == 401


def test_asking_twice_about_one_request_counts_once(door: Door) -> None:
    for _ in range(ATTEMPTS):
        asks = connection({"authorization": "Bearer nonsense"})
        for _ in range(3):
            with pytest.raises(RequestRejectedError) as error:
                door.authentication.authenticate(read_credentials(asks))
            assert status(error) == 401
    with pytest.raises(RequestRejectedError) as error:
        door.authentication.authenticate(read_credentials(connection({"authorization": "Bearer nonsense"})))
    assert status(error) == 429
    person = door.authentication.authenticate(read_credentials(connection({"authorization": f"Bearer {door.token()}"})))
    assert person is not None
    assert person.role is Role.OPERATOR


def test_a_browser_goes_on_with_its_session_or_ends_it(door: Door) -> None:
    pair = door.cookie("Ana")
    ana = door.who(pair)
    again = door.authentication.sign_in(read_credentials(connection({"cookie": pair})), door.token())
    assert again == ana
    vera = door.authentication.sign_in(read_credentials(connection({"cookie": pair})), door.token(), "Vera")
    assert vera.session != again.session
    assert door.who(pair) is None


def test_persons_of_one_name_are_told_apart_while_they_are_there(door: Door) -> None:
    ana = door.authentication.sign_in(read_credentials(connection({})), door.token(), "Ana")
    with door.authentication.active_users.connect(ana, is_page=True):
        second = door.authentication.sign_in(read_credentials(connection({})), door.token(), "Ana")
        viewer = door.authentication.sign_in(read_credentials(connection({})), door.token(Role.VIEWER), "Ana")
        there = door.authentication.active_users
        with there.connect(second, is_page=True), there.connect(viewer, is_page=True):
            assert [one.name for one in door.authentication.active_users.view()] == ["Ana", "Ana (2)", "Ana (viewer)"]
        pretender = door.authentication.sign_in(
            read_credentials(connection({})), door.token(Role.VIEWER), " Ana (2)\n\u202e"
        )
        assert pretender.name == "Ana 2 (viewer)"
    assert door.authentication.active_users.view() == []
    assert door.authentication.sign_in(read_credentials(connection({})), door.token(), "Ana").name == "Ana"


def test_new_tokens_end_the_sessions_of_their_role(door: Door) -> None:
    ana, vera, vic = door.cookie("Ana"), door.cookie("Vera"), door.cookie("Vic", Role.VIEWER)
    asks = connection({"cookie": ana})
    rotating = door.authentication.authenticate(read_credentials(asks))
    assert rotating is not None
    before = door.token()
    tokens = asyncio.run(door.authentication.rotate([Role.OPERATOR], rotating))
    assert sign_in_status(door, before) == 401
    assert door.authentication.sign_in(read_credentials(connection({})), tokens.operator).role is Role.OPERATOR
    assert door.who(vera) is None
    assert door.who_stops(vera) is None
    assert door.who(vic) is not None
    assert door.who(door.granted(asks, rotating)) == rotating
    assert door.who_stops(ana) is not None  # until the browser has the new one
    door.clock.now += GRACE_S + 1
    assert door.who_stops(ana) is None


def test_a_token_file_that_was_changed_is_in_force_soon_and_a_broken_one_never(door: Door, tmp_path: Path) -> None:
    async def notice(over: asyncio.Event) -> None:
        task = asyncio.create_task(door.authentication.run())
        await asyncio.wait_for(over.wait(), 60.0)
        task.cancel()

    ana, before = door.cookie(), door.token()
    person = door.who(ana)
    assert person is not None
    (tmp_path / "viewer-token").unlink()
    with door.authentication.active_users.connect(person, is_page=True) as over:
        replace_tokens(tmp_path, [Role.OPERATOR])
        asyncio.run(notice(over))
    assert door.token() != before
    assert door.who(ana) is None
    assert door.authentication.sign_in(read_credentials(connection({})), door.token(Role.VIEWER)).role is Role.VIEWER


@pytest.mark.parametrize("content", ["", "{", "[]", '{"ran_s": 1, "live": {"a": 3}, "ended": []}', "\x00"])
def test_a_damaged_file_of_sessions_leaves_stop_and_nothing_else(door: Door, tmp_path: Path, content: str) -> None:
    pair = door.cookie()
    asyncio.run(door.sessions.save())
    assert Door(tmp_path).who(pair) is not None
    (tmp_path / "sessions.json").write_text(content)
    again = Door(tmp_path)
    assert again.who(pair) is None
    assert again.who_stops(pair) is not None


def test_a_session_file_that_cannot_be_written_is_told(door: Door, tmp_path: Path) -> None:
    (tmp_path / "sessions.json.new").mkdir()
    asyncio.run(door.sessions.save())
    assert door.sessions.problem is not None
    (tmp_path / "sessions.json.new").rmdir()
    asyncio.run(door.sessions.save())
    assert door.sessions.problem is None


# The token files, and where a service goes without them.


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
    with refused(TokenError, "no_usable_token", file=str(tmp_path / "token")):
        load_tokens(tmp_path)


@pytest.mark.parametrize("host", ["0.0.0.0", "192.168.1.4", "::", "lab.example"])
def test_another_address_without_a_token_is_refused(host: str) -> None:
    with pytest.raises(ValueError, match="needs the token"):
        Settings(host=host, require_token=False)
    assert Settings(host=host).host == host


@pytest.mark.parametrize("host", ["127.0.0.1", "::1", "localhost"])
def test_this_machine_may_go_without(host: str) -> None:
    assert not Settings(host=host, require_token=False).require_token
