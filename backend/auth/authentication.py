"""Authentication: tokens, cookies, limits of attempts, names of people."""

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

from backend.auth.sessions import Sessions, TokenFiles, Tokens
from backend.errors import RequestRejectedError
from backend.event_bus import EventBus
from backend.schemas import PersonView, Role
from backend.supervision import Part
from plant import ErrorCode

# Attempts ------------------------------------------------------------------------------------------
#
# How often one address may try a wrong token, and how often it may begin a session with a right
# one.
#
# A request with a right token is always answered, and who holds a viewer's token slows no operator
# down.


ATTEMPTS = 10
SIGN_INS = 60
"""Sessions that one address may begin in a minute with the token of one role: a class of students at one machine."""

ATTEMPTS_WINDOW_S = 60.0
ADDRESSES = 1000


class Attempts:
    """What was tried within the last minute, by address; ``of`` says of what there were too many."""

    def __init__(
        self, clock: Callable[[], float] = time.monotonic, *, most: int = ATTEMPTS, of: str = "wrong tokens"
    ) -> None:
        self._clock, self._most, self._of = clock, most, of
        self._tried: dict[str, deque[float]] = {}

    def count(self, address: str) -> None:
        """Count one more. Raises RequestRejectedError where there were too many of them."""
        tried = self._recent(address)
        if len(tried) >= self._most:
            wait_s = int(tried[0] + ATTEMPTS_WINDOW_S - self._clock()) + 1
            raise RequestRejectedError(
                ErrorCode.TOO_MANY, f"too many {self._of}; try again in {wait_s} s", retry_after_s=wait_s
            )
        tried.append(self._clock())

    def _recent(self, address: str) -> deque[float]:
        oldest = self._clock() - ATTEMPTS_WINDOW_S
        for known in [key for key, times in self._tried.items() if not times or times[-1] < oldest]:
            del self._tried[known]
        while len(self._tried) >= ADDRESSES:
            del self._tried[next(iter(self._tried))]
        tried = self._tried.setdefault(address, deque(maxlen=self._most))
        while tried and tried[0] < oldest:
            tried.popleft()
        return tried


# People --------------------------------------------------------------------------------------------
#
# Who somebody is to the others: names, and who has a page open. Names tell apart whoever is there
# at one time.


BEARER, OPEN = "bearer", "open"
"""The ``session`` of all who send a token with each request, and of all where no token is needed."""

LONGEST_NAME = 40


@dataclass(frozen=True)
class User:
    """Someone who is signed in: ``name`` as others see it, ``called`` as they gave it.

    ``session`` tells two browsers of one name apart.
    """

    name: str
    role: Role
    session: str
    called: str = ""

    @property
    def is_nameless(self) -> bool:
        """Whether this browser's person has given no name yet; scripts go by their role."""
        return self.session not in (BEARER, OPEN) and self.called in ("", self.role)


@dataclass
class _There:
    person: User
    is_page: bool
    since: datetime = field(default_factory=lambda: datetime.now(UTC))


class ActiveUsers:
    """Those who have a websocket open: pages, and the 3D views in them."""

    def __init__(self) -> None:
        self._there: dict[asyncio.Event, _There] = {}

    @contextmanager
    def attending(self, person: User, *, is_page: bool) -> Iterator[asyncio.Event]:
        """Count a websocket among the open ones; the event is set when its session ends."""
        over = asyncio.Event()
        self._there[over] = _There(person, is_page)
        try:
            yield over
        finally:
            del self._there[over]

    def connected(self) -> Iterator[tuple[asyncio.Event, User]]:
        """Yield each open websocket's end and person."""
        yield from [(over, there.person) for over, there in self._there.items()]

    def view(self) -> list[PersonView]:
        """Return who has how many pages open, and since when the first of them is, by name."""
        pages: dict[tuple[str, Role], list[datetime]] = {}
        for there in self._there.values():
            if there.is_page:
                pages.setdefault((there.person.name, there.person.role), []).append(there.since)
        return [
            PersonView(name=name, role=role, pages=len(since), since=min(since))
            for (name, role), since in sorted(pages.items())
        ]

    def has_page(self, session: str) -> bool:
        """Return whether somebody's page is open."""
        return any(there.is_page and there.person.session == session for there in self._there.values())

    def named(self, name: str) -> User | None:
        """Return whose page is open under this name."""
        there = (one.person for one in self._there.values() if one.is_page)
        return next((person for person in there if person.name == name), None)

    def as_shown(self, person: User) -> User:
        """Return somebody who comes back under the name by which the others know them.

        It may be another than before: while they were away, somebody else may have come under theirs.
        """
        if person.session in (BEARER, OPEN):
            return person
        here = [there.person for there in self._there.values()]
        known = next((other for other in here if other.session == person.session), None)
        if known is not None:
            return known
        if all(other.name.casefold() != person.name.casefold() for other in here):
            return person
        return replace(person, name=self.shown(person.called, person.role, person.session))

    def shown(self, called: str, role: Role, session: str) -> str:
        """Return how others see who calls themselves so: nobody gets the name of somebody else who is there."""
        name = called or str(role)
        if role is Role.VIEWER and called not in ("", role):
            name = f"{called} ({role})"
        others = (person for _, person in self.connected() if person.session != session)
        taken, number, shown = {person.name.casefold() for person in others}, 1, name
        while shown.casefold() in taken:
            number += 1
            shown = f"{name} ({number})"
        return shown

    def rename(self, person: User, name: str) -> User:
        """Return ``person`` under another name, at all their pages.

        Raises RequestRejectedError for a script, and for a name that is not accepted. The session stays what it is,
        so that control is kept.
        """
        if person.session in (BEARER, OPEN):
            raise RequestRejectedError(
                ErrorCode.NOT_NOW, "a script goes by its role: only a browser that signed in has a name"
            )
        called = printable(name)
        if called == "" or called.casefold() in set(Role):
            raise RequestRejectedError(
                ErrorCode.BAD_VALUE, "a name needs a letter, and is no role: type what the others here call you"
            )
        renamed = replace(person, name=self.shown(called, person.role, person.session), called=called)
        for there in self._there.values():
            if there.person.session == person.session:
                there.person = renamed
        return renamed


def printable(name: str) -> str:
    """Return a name on one line, without the marks that tell persons apart, in whatever script they are written."""
    plain = " ".join(unicodedata.normalize("NFKC", name).split())
    return "".join(sign for sign in plain if sign.isprintable() and sign not in "()").strip()[:LONGEST_NAME]


# Authentication ------------------------------------------------------------------------------------
#
# Tells who asks: by a token, then by the cookie that was given for it; knows whose session is over.


AUTHENTICATION_PART = Part(
    "The watch over the token files", "Tokens that are changed by the command line come into force at the next start."
)

LONGEST_TOKEN = 200

LOOK_S = 0.5
SAVE_S = 3600.0
GRACE_S = 10.0
"""So long [s] the cookie that a browser sent before it rotated the tokens is still good for STOP."""


@dataclass
class Shown:
    """What one request or websocket shows of who sends it: a token, or the cookies that may be ours.

    ``is_foreign`` says that another site's page made the browser send it; a wrong token counts once for each.
    """

    address: str
    token: str | None = None
    cookies: Sequence[str] = ()
    is_foreign: bool = False
    is_counted: bool = False


@dataclass(frozen=True)
class _Replaced:
    """The tokens before the last rotation, good for STOP of the one session that asked for it, ``until`` [s]."""

    tokens: Tokens
    session: str
    until: float


@dataclass(frozen=True)
class AccessChanged:
    """Somebody has signed in or out, or made new tokens: ``text`` for the log, and ``who`` did it."""

    text: str
    who: str


class Authentication:
    """Tells who asks. ``files`` None asks for nothing: everyone is an operator.

    Cookies are signed with the token of their role. Which of them are live is up to ``sessions``; one that is genuine
    and neither live nor signed out is good for STOP alone.
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
        self._attempts = Attempts(clock)
        self._sign_ins = Attempts(clock, most=SIGN_INS, of="new sessions from this address")
        self._replaced: _Replaced | None = None
        self._turn = asyncio.Lock()
        self.sessions = sessions or Sessions()
        self.people = ActiveUsers()

    def sign_in(self, shown: Shown, token: str, name: str = "") -> User:
        """Return who ``token`` belongs to.

        Raises RequestRejectedError for a wrong token, and after too many attempts for a right one too.
        A browser that is signed in already goes on with its session, or ends it where it is another person's now.
        """
        if self._files is None:
            return User(printable(name) or Role.OPERATOR, Role.OPERATOR, OPEN)
        role = self._files.tokens.role_of(token[:LONGEST_TOKEN])
        if role is None:
            self._count_wrong(shown)
            raise RequestRejectedError(
                ErrorCode.NOT_SIGNED_IN, "wrong token; use the sign-in link that the service printed at its start"
            )
        called, before = printable(name), self._person_of_cookie(shown)
        if before is not None and before.role is role and called in ("", before.called):
            return before
        self._sign_ins.count(f"{role} {shown.address}")
        if before is not None:
            self.sessions.end(before.session)
            self._dismiss()
        session = secrets.token_urlsafe(12)
        self.sessions.begin(session, role, in_use={person.session for _, person in self.people.connected()})
        person = User(self.people.shown(called, role, session), role, session, called or role)
        self._events.publish(AccessChanged(f"signed in as {role}", person.name))
        return person

    def cookie(self, person: User) -> str | None:
        """Return what a browser shows from now on to be recognised as ``person``; None where it needs no cookie."""
        if self._files is None or person.session in (BEARER, OPEN):
            return None
        content = {"name": person.name, "called": person.called, "role": person.role, "session": person.session}
        signed: str = _signer(self._files.tokens, person.role).dumps(content)
        return signed

    def sign_out(self, shown: Shown) -> None:
        """End the session of the cookie, wherever else that cookie may be by now."""
        person = self._genuine(shown)
        if person is not None:
            self.sessions.end(person.session)
            self._events.publish(AccessChanged("signed out", person.name))
            self._dismiss()

    def recognise(self, shown: Shown) -> User | None:
        """Return who sends this request or opens this websocket, None when not signed in. Raises RequestRejectedError.

        May be asked as often as one likes: a wrong token counts once for each request.
        """
        if self._files is None:
            return User(Role.OPERATOR, Role.OPERATOR, OPEN)
        if shown.token is not None:
            return self._person_of_bearer(shown, shown.token)
        return self._person_of_cookie(shown)

    def recognise_for_stop(self, shown: Shown) -> User | None:
        """Return who presses STOP: also somebody whose session fell asleep or was forgotten, not one signed out."""
        person = self.recognise(shown)
        if person is None:
            person = self._genuine(shown)
        return person

    async def rotate(self, roles: list[Role], person: User) -> Tokens:
        """Put new tokens in force at once; all sessions of ``roles`` end but that of ``person``.

        Raises RequestRejectedError where no token is asked for, and when the tokens cannot be written: the old ones
        hold.
        """
        if self._files is None:
            raise RequestRejectedError(ErrorCode.NOT_NOW, "this service asks for no token: there is nothing to rotate")
        async with self._turn:
            self._replaced = _Replaced(self._files.tokens, person.session, self._clock() + GRACE_S)
            try:
                await asyncio.to_thread(self._files.rotate, roles)
            except OSError as error:
                raise RequestRejectedError(
                    ErrorCode.UNAVAILABLE, f"the new tokens cannot be written: {error.strerror or error}"
                ) from error
            await self._refresh(but=person.session)
        self._events.publish(AccessChanged(f"new tokens for {' and '.join(roles)}", person.name))
        await self.sessions.save()
        return self._files.tokens

    async def run(self) -> None:
        """Notice token files that were changed, and keep the file of sessions fresh, until cancelled."""
        saved = self._clock()
        while True:
            await asyncio.sleep(LOOK_S)
            async with self._turn:
                changed = await self._refresh()
            if changed or self._clock() - saved > SAVE_S:
                saved = self._clock()
                for _, person in self.people.connected():
                    self.sessions.use(person.session)
                await self.sessions.save()

    async def _refresh(self, but: str | None = None) -> bool:
        if self._files is None:
            return False
        changed = await asyncio.to_thread(self._files.refresh)
        for role in changed:
            self.sessions.end_all(role, but)
        self._dismiss(changed)
        return bool(changed)

    def _dismiss(self, bearers: Collection[Role] = ()) -> None:
        """Close the websockets of sessions that are over, and of scripts whose token was replaced."""
        for over, person in self.people.connected():
            if person.session == BEARER:
                ended = person.role in bearers
            else:
                ended = person.session != OPEN and not self.sessions.is_live(person.session)
            if ended:
                over.set()

    def _person_of_bearer(self, shown: Shown, token: str) -> User:
        # The right token passes whatever others have tried: a script that stops the rig must not be locked out.
        role = self._files.tokens.role_of(token[:LONGEST_TOKEN]) if self._files else Role.OPERATOR
        if role is None:
            self._count_wrong(shown)
            raise RequestRejectedError(ErrorCode.NOT_SIGNED_IN, "wrong token; use the one in the data folder")
        return User(role, role, BEARER)

    def _person_of_cookie(self, shown: Shown) -> User | None:
        person = self._genuine(shown, replaced=False)
        if person is None or not self.sessions.use(person.session):
            return None
        return self.people.as_shown(person)

    def _genuine(self, shown: Shown, replaced: bool = True) -> User | None:
        """Return whose cookie this is, however old, unless it was signed out."""
        if self._files is None:
            return None
        for value in shown.cookies:
            for tokens, only in self._accepted(replaced):
                person = _read(value, tokens)
                if person is None or only not in (None, person.session):
                    continue
                if not self.sessions.was_ended(person.session):
                    return person
        return None

    def _accepted(self, replaced: bool) -> Iterator[tuple[Tokens, str | None]]:
        if self._files is not None:
            yield self._files.tokens, None
        if replaced and self._replaced is not None and self._clock() < self._replaced.until:
            yield self._replaced.tokens, self._replaced.session

    def _count_wrong(self, shown: Shown) -> None:
        # What a page of somebody else makes a browser send says nothing about the person at that browser.
        if not shown.is_foreign and not shown.is_counted:
            shown.is_counted = True
            self._attempts.count(shown.address)


def _read(value: str, tokens: Tokens) -> User | None:
    for role in Role:
        try:
            content = _signer(tokens, role).loads(value)
        except BadData:
            continue
        return replace(User(content["name"], role, content["session"]), called=content["called"])
    return None


def _signer(tokens: Tokens, role: Role) -> URLSafeSerializer:
    return URLSafeSerializer(tokens.of(role), salt=f"session of {role}")
