"""Tokens and live sessions, kept in files of the data folder."""

import asyncio
import json
import logging
import os
import secrets
import time
from collections.abc import Callable, Container, Iterable
from dataclasses import dataclass
from pathlib import Path

from backend.data_folder import write_private
from backend.schemas import Role
from plant import ErrorCode, SinewError

# Sessions ------------------------------------------------------------------------------------------
#
# Which sessions are live, kept in a file of the data folder so that a restart neither ends nor
# revives one.
#
# No clock of the wall is asked: a session ends when somebody signs out, when its token is replaced,
# when too many newer ones are there, or after ``IDLE_S`` of the service's own running time without
# a sign of life.


FILE = "sessions.json"
IDLE_S = 30 * 24 * 3600.0
LIVE_OF_A_ROLE = 200
"""More sessions of one role push out the one that was silent for longest, of those without an open page."""

ENDED = 5000
"""So many sessions that were signed out are told apart from those that only fell asleep, which may still stop."""

_log = logging.getLogger(__name__)


@dataclass
class _Live:
    role: Role
    used_s: float


class Sessions:
    """The sessions of one data folder; ``folder`` None keeps them in memory only."""

    def __init__(self, folder: Path | None = None, clock: Callable[[], float] = time.monotonic) -> None:
        self._file = None if folder is None else folder / FILE
        self._clock = clock
        self._live: dict[str, _Live] = {}
        self._ended: dict[str, None] = {}
        self._ran_s = 0.0
        self._writing = asyncio.Lock()
        self.problem: str | None = None
        self._read()
        self._begun = clock()

    def begin(self, session: str, role: Role, in_use: Container[str] = ()) -> None:
        """Take in a new session; one that is ``in_use`` at an open page is never pushed out by it."""
        of_role = [known for known, live in self._live.items() if live.role is role]
        silent = [known for known in of_role if known not in in_use]
        if len(of_role) >= LIVE_OF_A_ROLE and silent:
            del self._live[min(silent, key=lambda known: self._live[known].used_s)]
        self._live[session] = _Live(role, self._now_s)

    def use(self, session: str) -> bool:
        """Return whether a session is live, and note that it was heard."""
        live = self._live.get(session)
        if live is None:
            return False
        if not self._now_s - live.used_s <= IDLE_S:
            del self._live[session]
            return False
        live.used_s = self._now_s
        return True

    def is_live(self, session: str) -> bool:
        """Return whether a session is live."""
        return session in self._live

    def was_ended(self, session: str) -> bool:
        """Return whether somebody signed out of this session, which is good for nothing then."""
        return session in self._ended

    def end(self, session: str) -> None:
        """End a session for good."""
        self._live.pop(session, None)
        self._ended[session] = None
        while len(self._ended) > ENDED:
            del self._ended[next(iter(self._ended))]

    def end_all(self, role: Role, but: str | None = None) -> None:
        """End all sessions of a role, save one."""
        for session in [known for known, live in self._live.items() if live.role is role and known != but]:
            self.end(session)

    async def save(self) -> None:
        """Write the file. What keeps it from being written is told in ``problem``."""
        if self._file is None:
            return
        async with self._writing:
            document = {
                "ran_s": round(self._now_s),
                "live": {known: [live.role, round(live.used_s)] for known, live in self._live.items()},
                "ended": list(self._ended),
            }
            try:
                await asyncio.to_thread(write_private, self._file, json.dumps(document))
            except OSError as error:
                self.problem = (
                    f"sessions cannot be written ({error.strerror or error}): "
                    "after a restart of the service those who sign out now are signed in again"
                )
                _log.exception("The service cannot write the sessions to its file.")
            else:
                self.problem = None

    @property
    def _now_s(self) -> float:
        """How long services have run on this folder, in all [s]."""
        return self._ran_s + self._clock() - self._begun

    def _read(self) -> None:
        if self._file is None or not self._file.exists():
            return
        try:
            document = json.loads(self._file.read_text(encoding="utf-8"))
            self._ran_s = float(document["ran_s"])
            self._live = {
                str(known): _Live(Role(role), float(used_s)) for known, (role, used_s) in document["live"].items()
            }
            self._ended = dict.fromkeys(str(session) for session in document["ended"])
        except (OSError, ValueError, KeyError, TypeError, AttributeError) as error:
            _log.warning("The service cannot read %s (%s): all users sign in again.", self._file, error)
            self._live, self._ended, self._ran_s = {}, {}, 0.0


# Tokens --------------------------------------------------------------------------------------------
#
# The two tokens of a data folder: one for operators, one for viewers, readable by their owner only.


FILES = {Role.OPERATOR: "token", Role.VIEWER: "viewer-token"}
SHORTEST = 20


class TokenError(SinewError):
    """A token file holds nothing that could be a token; the message says what to do."""

    category = ErrorCode.UNAVAILABLE


@dataclass(frozen=True, repr=False)
class Tokens:
    """The tokens by role; never printed or logged."""

    operator: str
    viewer: str

    def role_of(self, token: str) -> Role | None:
        """Return the role that ``token`` opens, None for a wrong one; takes the same time for each."""
        offered = token.encode(errors="surrogatepass")
        is_operator = secrets.compare_digest(offered, self.operator.encode())
        is_viewer = secrets.compare_digest(offered, self.viewer.encode())
        if is_operator:
            return Role.OPERATOR
        return Role.VIEWER if is_viewer else None

    def of(self, role: Role) -> str:
        """Return the token of a role: its holders' cookies are signed with it, so that a new one ends them."""
        return self.operator if role is Role.OPERATOR else self.viewer


class TokenFiles:
    """The tokens of a running service, and whether their files say something else by now."""

    def __init__(self, data: Path) -> None:
        self._data = data
        self.tokens = load_tokens(data)
        self._seen = self._stamps()

    def refresh(self) -> set[Role]:
        """Read files that were changed; return the roles that have another token now.

        A file that is gone or holds no usable token changes nothing: nobody is locked out by that.
        """
        stamps = self._stamps()
        if stamps == self._seen:
            return set()
        before, self._seen = self.tokens, stamps
        self.tokens = Tokens(*(self._read(role) or before.of(role) for role in FILES))
        return {role for role in FILES if self.tokens.of(role) != before.of(role)}

    def rotate(self, roles: Iterable[Role]) -> None:
        """Write new tokens for ``roles``; ``refresh`` puts them in force. Raises OSError."""
        replace_tokens(self._data, roles)

    def _read(self, role: Role) -> str | None:
        try:
            return _usable(self._data / FILES[role])
        except OSError:
            return None

    def _stamps(self) -> list[tuple[int, int, int] | None]:
        return [_stamp(self._data / name) for name in FILES.values()]


def load_tokens(data: Path) -> Tokens:
    """Read the tokens of the folder ``data``, creating folder and files (mode 0600) at the first start.

    Raises TokenError.
    """
    data.mkdir(parents=True, exist_ok=True)
    return Tokens(*(_read_or_create(data / FILES[role]) for role in (Role.OPERATOR, Role.VIEWER)))


def replace_tokens(data: Path, roles: Iterable[Role]) -> None:
    """Give the folder new tokens for ``roles``; a service that runs on it notices within a second. Raises OSError."""
    for role in roles:
        write_private(data / FILES[role], secrets.token_urlsafe(32) + "\n")


def _read_or_create(path: Path) -> str:
    try:
        descriptor = os.open(path, os.O_CREAT | os.O_EXCL | os.O_WRONLY, 0o600)
    except FileExistsError:
        path.chmod(0o600)
        token = _usable(path)
        if token is None:
            raise TokenError(f"{path} holds no usable token; delete the file and start again") from None
        return token
    token = secrets.token_urlsafe(32)
    with os.fdopen(descriptor, "w") as file:
        file.write(token + "\n")
    return token


def _usable(path: Path) -> str | None:
    try:
        token = path.read_text(encoding="ascii").strip()
    except (FileNotFoundError, UnicodeDecodeError):
        return None
    return token if len(token) >= SHORTEST else None


def _stamp(path: Path) -> tuple[int, int, int] | None:
    try:
        known = path.stat()
    except OSError:
        return None
    return known.st_mtime_ns, known.st_ino, known.st_size
