"""Authentication: tokens, cookies, limits of attempts, and names of users."""

import asyncio
import secrets
import time
import unicodedata
from collections import deque
from collections.abc import Callable, Collection, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from datetime import UTC, datetime

from itsdangerous import BadData, URLSafeSerializer

from backend.auth import messages
from backend.auth.sessions import Sessions, TokenFiles, Tokens
from backend.errors import RequestRejectedError
from backend.event_bus import EventBus
from backend.schemas import PersonView, Role
from backend.supervision import Part
from plant import ErrorCode, Message

# Attempts ------------------------------------------------------------------------------------------
# Limits wrong tokens and new sessions per address. Requests with a right token are always answered,
# and sessions are counted per role, so that the holder of a viewer's token cannot delay an operator.


ATTEMPTS = 10
"""Wrong tokens that one address may send within ATTEMPTS_WINDOW_S."""

SIGN_INS = 60
"""Sessions that one address may begin in a minute with the token of one role: a class of students at one machine."""

ATTEMPTS_WINDOW_S = 60.0
ADDRESSES = 1000
"""Addresses whose attempts are counted; the oldest is dropped for a new one."""


class AttemptLimiter:
    """Limits attempts per address within ATTEMPTS_WINDOW_S."""

    def __init__(self, clock: Callable[[], float], limit: int, build_message: Callable[[int], Message]) -> None:
        """Allow ``limit`` attempts per address.

        ``build_message`` returns the refusal of a further one, from the time to wait [s].
        """
        self._clock, self._limit, self._build_message = clock, limit, build_message
        self._attempts: dict[str, deque[float]] = {}

    def count(self, address: str) -> None:
        """Count one attempt. Raises RequestRejectedError at the limit."""
        recent = self._list_recent(address)
        if len(recent) >= self._limit:
            wait_s = int(recent[0] + ATTEMPTS_WINDOW_S - self._clock()) + 1
            raise RequestRejectedError(ErrorCode.TOO_MANY, self._build_message(wait_s), retry_after_s=wait_s)
        recent.append(self._clock())

    def _list_recent(self, address: str) -> deque[float]:
        oldest = self._clock() - ATTEMPTS_WINDOW_S
        for expired in [key for key, times in self._attempts.items() if not times or times[-1] < oldest]:
            del self._attempts[expired]
        while len(self._attempts) >= ADDRESSES:
            del self._attempts[next(iter(self._attempts))]
        recent = self._attempts.setdefault(address, deque(maxlen=self._limit))
        while recent and recent[0] < oldest:
            recent.popleft()
        return recent


# Users ---------------------------------------------------------------------------------------------
# Names of users, and which users have a page open. Display names are unique among connected users.


BEARER, OPEN = "bearer", "open"
"""``User.session`` of clients that send a token with each request, and of all clients if no token is needed."""

MAX_NAME_LENGTH = 40


@dataclass(frozen=True)
class User:
    """A signed-in person or script."""

    name: str
    """Display name, which other users see."""

    role: Role
    session: str
    """Identifier that distinguishes two browsers of the same name."""

    given_name: str = ""
    """Name as the person typed it."""

    @property
    def has_no_name(self) -> bool:
        """Whether the person at this browser has not given a name.

        Scripts use the name of their role.
        """
        return self.session not in (BEARER, OPEN) and self.given_name in ("", self.role)


@dataclass
class _Connection:
    user: User
    is_page: bool
    since: datetime = field(default_factory=lambda: datetime.now(UTC))


class ActiveUsers:
    """Users with an open websocket: of a page, or of a 3D view in it."""

    def __init__(self) -> None:
        self._connections: dict[asyncio.Event, _Connection] = {}

    @contextmanager
    def connect(self, user: User, *, is_page: bool) -> Iterator[asyncio.Event]:
        """Register a websocket for the block.

        Yields an event that is set when its session ends.
        """
        session_ended = asyncio.Event()
        self._connections[session_ended] = _Connection(user, is_page)
        try:
            yield session_ended
        finally:
            del self._connections[session_ended]

    def list_connections(self) -> Iterator[tuple[asyncio.Event, User]]:
        """Yield the end event and the user of each open websocket."""
        yield from [(ended, connection.user) for ended, connection in self._connections.items()]

    def view(self) -> list[PersonView]:
        """Return users by name, with the number of pages and the time of the first."""
        opened: dict[tuple[str, Role], list[datetime]] = {}
        for connection in self._connections.values():
            if connection.is_page:
                opened.setdefault((connection.user.name, connection.user.role), []).append(connection.since)
        return [
            PersonView(name=name, role=role, pages=len(times), since=min(times))
            for (name, role), times in sorted(opened.items())
        ]

    def has_page(self, session: str) -> bool:
        """Return whether a session has a page open."""
        return any(one.is_page and one.user.session == session for one in self._connections.values())

    def find_by_name(self, name: str) -> User | None:
        """Return the user with an open page and this display name."""
        users = (connection.user for connection in self._connections.values() if connection.is_page)
        return next((user for user in users if user.name == name), None)

    def resolve_returning(self, user: User) -> User:
        """Return a user that reconnects, with a unique display name.

        The name may differ from the earlier one, which another user may have taken meanwhile.
        """
        if user.session in (BEARER, OPEN):
            return user
        connected = [connection.user for connection in self._connections.values()]
        known = next((other for other in connected if other.session == user.session), None)
        if known is not None:
            return known
        if all(other.name.casefold() != user.name.casefold() for other in connected):
            return user
        return replace(user, name=self.make_display_name(user.given_name, user.role, user.session))

    def make_display_name(self, given_name: str, role: Role, session: str) -> str:
        """Return a unique display name, with a number if another user has the name."""
        name = given_name or str(role)
        if role is Role.VIEWER and given_name not in ("", role):
            name = f"{given_name} ({role})"
        others = (user for _, user in self.list_connections() if user.session != session)
        taken, number, display_name = {user.name.casefold() for user in others}, 1, name
        while display_name.casefold() in taken:
            number += 1
            display_name = f"{name} ({number})"
        return display_name

    def rename(self, user: User, name: str) -> User:
        """Return ``user`` with another name, and use it at all pages of the session.

        The session is unchanged, so that the user keeps control. Raises RequestRejectedError for a script and for an
        invalid name.
        """
        if user.session in (BEARER, OPEN):
            raise RequestRejectedError(ErrorCode.NOT_NOW, messages.script_cannot_be_renamed())
        given_name = clean_name(name)
        if given_name == "" or given_name.casefold() in set(Role):
            raise RequestRejectedError(ErrorCode.BAD_VALUE, messages.name_not_allowed())
        renamed = replace(user, name=self.make_display_name(given_name, user.role, user.session), given_name=given_name)
        for connection in self._connections.values():
            if connection.user.session == user.session:
                connection.user = renamed
        return renamed


def clean_name(name: str) -> str:
    """Return a name on one line and without parentheses.

    Display names have role and number in parentheses.
    """
    normalized = " ".join(unicodedata.normalize("NFKC", name).split())
    return "".join(char for char in normalized if char.isprintable() and char not in "()").strip()[:MAX_NAME_LENGTH]


# Authentication ------------------------------------------------------------------------------------
# Identifies the sender of a request by its token, or by the cookie that sign-in has issued.


AUTHENTICATION_PART = Part(
    "The monitor of the token files", "Tokens that are replaced on the command line take effect at the next start."
)

MAX_TOKEN_LENGTH = 200

POLL_S = 0.5
"""Period [s] at which changes of the token files are noticed."""

SAVE_S = 3600.0
"""Period [s] at which the sessions are saved."""

GRACE_S = 10.0
"""Time [s] after a rotation during which the previous cookie of the browser that rotated is accepted for STOP."""


@dataclass
class Credentials:
    """Credentials of one request or websocket."""

    address: str
    token: str | None = None
    cookies: Sequence[str] = ()
    """Values of all cookies that may have been issued by this service."""

    is_foreign: bool = False
    """Whether a page of another site made the browser send the request."""

    is_counted: bool = False
    """Whether the wrong token of this request has been counted: it counts once."""


@dataclass(frozen=True)
class _PreviousTokens:
    """Tokens before the last rotation.

    Accepted for STOP of one ``session`` until ``until`` [s].
    """

    tokens: Tokens
    session: str
    until: float


@dataclass(frozen=True)
class AccessChanged:
    """Event: user ``who`` signed in, signed out or rotated the tokens.

    ``text`` is for the event log.
    """

    text: str
    who: str


class Authentication:
    """Identifies users by token or cookie.

    Cookies are signed with the token of their role, so that a new token invalidates them. ``sessions`` decides which
    cookies are live. An authentic cookie of a session that has expired, but was not signed out, is accepted for STOP
    only. Without ``files`` the service asks for no token, and every client is an operator.
    """

    def __init__(
        self,
        files: TokenFiles | None,
        sessions: Sessions | None = None,
        clock: Callable[[], float] = time.monotonic,
        events: EventBus | None = None,
    ) -> None:
        self._events = events or EventBus()
        self._files = files
        self._clock = clock
        self._attempts = AttemptLimiter(clock, ATTEMPTS, lambda wait_s: messages.too_many_wrong_tokens(wait_s=wait_s))
        self._sign_ins = AttemptLimiter(clock, SIGN_INS, lambda wait_s: messages.too_many_sign_ins(wait_s=wait_s))
        self._previous: _PreviousTokens | None = None
        self._rotation_lock = asyncio.Lock()
        self.sessions = sessions or Sessions()
        self.active_users = ActiveUsers()

    def sign_in(self, credentials: Credentials, token: str, name: str = "") -> User:
        """Begin a session for the owner of ``token`` and return the user.

        A browser that is already signed in keeps its session if role and name are the same; otherwise that session
        ends. Raises RequestRejectedError for a wrong token and after too many attempts.
        """
        if self._files is None:
            return User(clean_name(name) or Role.OPERATOR, Role.OPERATOR, OPEN)
        role = self._files.tokens.find_role(token[:MAX_TOKEN_LENGTH])
        if role is None:
            self._count_wrong_token(credentials)
            raise RequestRejectedError(ErrorCode.NOT_SIGNED_IN, messages.wrong_token_at_sign_in())
        given_name, before = clean_name(name), self._find_cookie_user(credentials)
        if before is not None and before.role is role and given_name in ("", before.given_name):
            return before
        self._sign_ins.count(f"{role} {credentials.address}")
        if before is not None:
            self.sessions.end(before.session)
            self._close_ended_connections()
        session = secrets.token_urlsafe(12)
        self.sessions.add(session, role, in_use={user.session for _, user in self.active_users.list_connections()})
        display_name = self.active_users.make_display_name(given_name, role, session)
        user = User(display_name, role, session, given_name or role)
        self._events.publish(AccessChanged(f"signed in as {role}", user.name))
        return user

    def make_cookie(self, user: User) -> str | None:
        """Return the signed cookie that identifies ``user``.

        None for a client that needs no cookie.
        """
        if self._files is None or user.session in (BEARER, OPEN):
            return None
        content = {"name": user.name, "called": user.given_name, "role": user.role, "session": user.session}
        signed: str = _make_signer(self._files.tokens, user.role).dumps(content)
        return signed

    def sign_out(self, credentials: Credentials) -> None:
        """End the session of the cookie, for all copies of the cookie."""
        user = self._read_cookie_user(credentials)
        if user is not None:
            self.sessions.end(user.session)
            self._events.publish(AccessChanged("signed out", user.name))
            self._close_ended_connections()

    def authenticate(self, credentials: Credentials) -> User | None:
        """Return the user that sends a request or opens a websocket.

        None if not signed in. May be called several times for one request: a wrong token counts once. Raises
        RequestRejectedError for a wrong token.
        """
        if self._files is None:
            return User(Role.OPERATOR, Role.OPERATOR, OPEN)
        if credentials.token is not None:
            return self._find_bearer_user(credentials, credentials.token)
        return self._find_cookie_user(credentials)

    def authenticate_for_stop(self, credentials: Credentials) -> User | None:
        """Return the user that sends STOP.

        Also for a session that has expired, not for one that was signed out.
        """
        user = self.authenticate(credentials)
        if user is None:
            user = self._read_cookie_user(credentials)
        return user

    async def rotate(self, roles: list[Role], user: User) -> Tokens:
        """Replace the tokens of ``roles`` and end all other sessions of these roles.

        Returns the new tokens. Raises RequestRejectedError if the service uses no tokens, or if they cannot be written:
        the old tokens remain valid.
        """
        if self._files is None:
            raise RequestRejectedError(ErrorCode.NOT_NOW, messages.service_without_tokens())
        async with self._rotation_lock:
            self._previous = _PreviousTokens(self._files.tokens, user.session, self._clock() + GRACE_S)
            try:
                await asyncio.to_thread(self._files.rotate, roles)
            except OSError as error:
                message = messages.tokens_not_written(reason=str(error.strerror or error))
                raise RequestRejectedError(ErrorCode.UNAVAILABLE, message) from error
            await self._reload_tokens(except_session=user.session)
        self._events.publish(AccessChanged(f"replaced the tokens for {' and '.join(roles)}", user.name))
        await self.sessions.save()
        return self._files.tokens

    async def run(self) -> None:
        """Reload changed token files and save the sessions regularly, until cancelled."""
        saved = self._clock()
        while True:
            await asyncio.sleep(POLL_S)
            async with self._rotation_lock:
                changed = await self._reload_tokens()
            if changed or self._clock() - saved > SAVE_S:
                saved = self._clock()
                for _, user in self.active_users.list_connections():
                    self.sessions.refresh(user.session)
                await self.sessions.save()

    async def _reload_tokens(self, except_session: str | None = None) -> bool:
        """Reload the token files and end the sessions of changed tokens.

        Return whether a token has changed.
        """
        if self._files is None:
            return False
        changed = await asyncio.to_thread(self._files.reload)
        for role in changed:
            self.sessions.end_all(role, except_session)
        self._close_ended_connections(changed)
        return bool(changed)

    def _close_ended_connections(self, bearers: Collection[Role] = ()) -> None:
        """Close the websockets of ended sessions.

        Also closes those of scripts whose role is in ``bearers``, because its token was replaced.
        """
        for session_ended, user in self.active_users.list_connections():
            if user.session == BEARER:
                has_ended = user.role in bearers
            else:
                has_ended = user.session != OPEN and not self.sessions.is_live(user.session)
            if has_ended:
                session_ended.set()

    def _find_bearer_user(self, credentials: Credentials, token: str) -> User:
        # A right token is accepted after any number of wrong ones: a script that sends STOP must not be locked out.
        role = self._files.tokens.find_role(token[:MAX_TOKEN_LENGTH]) if self._files else Role.OPERATOR
        if role is None:
            self._count_wrong_token(credentials)
            raise RequestRejectedError(ErrorCode.NOT_SIGNED_IN, messages.wrong_token())
        return User(role, role, BEARER)

    def _find_cookie_user(self, credentials: Credentials) -> User | None:
        user = self._read_cookie_user(credentials, include_previous=False)
        if user is None or not self.sessions.refresh(user.session):
            return None
        return self.active_users.resolve_returning(user)

    def _read_cookie_user(self, credentials: Credentials, include_previous: bool = True) -> User | None:
        """Return the user of an authentic cookie of any age.

        None if the session was signed out.
        """
        if self._files is None:
            return None
        for value in credentials.cookies:
            for tokens, only_session in self._list_accepted_tokens(include_previous):
                user = _read_cookie(value, tokens)
                if user is None or only_session not in (None, user.session):
                    continue
                if not self.sessions.was_ended(user.session):
                    return user
        return None

    def _list_accepted_tokens(self, include_previous: bool) -> Iterator[tuple[Tokens, str | None]]:
        """Yield accepted tokens with the only session that may use them, None for all."""
        if self._files is not None:
            yield self._files.tokens, None
        if include_previous and self._previous is not None and self._clock() < self._previous.until:
            yield self._previous.tokens, self._previous.session

    def _count_wrong_token(self, credentials: Credentials) -> None:
        # A request that a foreign page makes a browser send must not lock out the person at that browser.
        if not credentials.is_foreign and not credentials.is_counted:
            credentials.is_counted = True
            self._attempts.count(credentials.address)


def _read_cookie(value: str, tokens: Tokens) -> User | None:
    for role in Role:
        try:
            content = _make_signer(tokens, role).loads(value)
        except BadData:
            continue
        return replace(User(content["name"], role, content["session"]), given_name=content["called"])
    return None


def _make_signer(tokens: Tokens, role: Role) -> URLSafeSerializer:
    return URLSafeSerializer(tokens.get(role), salt=f"session of {role}")
