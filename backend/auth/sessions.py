"""Tokens and live sessions, stored in files of the data folder."""

import asyncio
import json
import logging
import os
import secrets
import time
from collections.abc import Callable, Container, Iterable
from dataclasses import dataclass
from pathlib import Path

from backend.auth import messages
from backend.data_folder import write_private
from backend.schemas import Role
from plant import ErrorCode, SinewError

# Sessions ------------------------------------------------------------------------------------------
# The live sessions, stored in a file so that a restart of the service neither ends nor revives one.
#
# A session ends when its user signs out, when its token is replaced, when too many newer sessions
# exist, or after IDLE_S without a request. Time is the running time of the service, because the
# system clock may jump.


SESSIONS_FILE = "sessions.json"
IDLE_S = 30 * 24 * 3600.0
"""Running time of the service [s] after which an unused session expires."""

LIVE_OF_A_ROLE = 200
"""Live sessions of one role. A further one replaces the session that is unused for longest and has no open page."""

ENDED = 5000
"""Signed-out sessions that are remembered: unlike expired ones, they may not send STOP."""

_log = logging.getLogger(__name__)


@dataclass
class _LiveSession:
    role: Role
    used_s: float


class Sessions:
    """The sessions of one data folder; without a ``folder`` they exist in memory only."""

    def __init__(self, folder: Path | None = None, clock: Callable[[], float] = time.monotonic) -> None:
        self._file = None if folder is None else folder / SESSIONS_FILE
        self._clock = clock
        self._live: dict[str, _LiveSession] = {}
        self._ended: dict[str, None] = {}
        self._previous_run_s = 0.0
        self._write_lock = asyncio.Lock()
        self.problem: str | None = None
        self._load()
        self._started = clock()

    def add(self, session: str, role: Role, in_use: Container[str] = ()) -> None:
        """Add a session.

        At the limit it replaces the longest unused one that is not ``in_use`` at an open page.
        """
        of_role = [known for known, live in self._live.items() if live.role is role]
        replaceable = [known for known in of_role if known not in in_use]
        if len(of_role) >= LIVE_OF_A_ROLE and replaceable:
            del self._live[min(replaceable, key=lambda known: self._live[known].used_s)]
        self._live[session] = _LiveSession(role, self._now_s)

    def refresh(self, session: str) -> bool:
        """Return whether a session is live, and store that it is used now."""
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
        """Return whether a session was ended by signing out or by a new token.

        It may not even send STOP.
        """
        return session in self._ended

    def end(self, session: str) -> None:
        """End a session for good."""
        self._live.pop(session, None)
        self._ended[session] = None
        while len(self._ended) > ENDED:
            del self._ended[next(iter(self._ended))]

    def end_all(self, role: Role, except_session: str | None = None) -> None:
        """End all sessions of a role except one."""
        for session in [known for known, live in self._live.items() if live.role is role and known != except_session]:
            self.end(session)

    async def save(self) -> None:
        """Write the file; ``problem`` has the reason if it cannot be written."""
        if self._file is None:
            return
        async with self._write_lock:
            document = {
                "ran_s": round(self._now_s),
                "live": {known: [live.role, round(live.used_s)] for known, live in self._live.items()},
                "ended": list(self._ended),
            }
            try:
                await asyncio.to_thread(write_private, self._file, json.dumps(document))
            except OSError as error:
                self.problem = messages.sessions_not_written(reason=str(error.strerror or error))
                _log.exception("The service cannot write the sessions to its file.")
            else:
                self.problem = None

    @property
    def _now_s(self) -> float:
        """Total running time of all services on this folder [s]."""
        return self._previous_run_s + self._clock() - self._started

    def _load(self) -> None:
        if self._file is None or not self._file.exists():
            return
        try:
            document = json.loads(self._file.read_text(encoding="utf-8"))
            self._previous_run_s = float(document["ran_s"])
            self._live = {
                str(known): _LiveSession(Role(role), float(used_s))
                for known, (role, used_s) in document["live"].items()
            }
            self._ended = dict.fromkeys(str(session) for session in document["ended"])
        except (OSError, ValueError, KeyError, TypeError, AttributeError) as error:
            _log.warning("The service cannot read %s (%s): all users must sign in again.", self._file, error)
            self._live, self._ended, self._previous_run_s = {}, {}, 0.0


# Tokens --------------------------------------------------------------------------------------------
# The two tokens of a data folder: one for operators, one for viewers. Only the owner of the files
# can read them.


TOKEN_FILES = {Role.OPERATOR: "token", Role.VIEWER: "viewer-token"}
MIN_TOKEN_LENGTH = 20


class TokenError(SinewError):
    """A token file holds no valid token."""

    category = ErrorCode.UNAVAILABLE


@dataclass(frozen=True, repr=False)
class Tokens:
    """The tokens by role. There is no repr, so that they are not logged by accident."""

    operator: str
    viewer: str

    def find_role(self, token: str) -> Role | None:
        """Return the role of ``token``, None for a wrong one; takes constant time."""
        offered = token.encode(errors="surrogatepass")
        is_operator = secrets.compare_digest(offered, self.operator.encode())
        is_viewer = secrets.compare_digest(offered, self.viewer.encode())
        if is_operator:
            return Role.OPERATOR
        return Role.VIEWER if is_viewer else None

    def get(self, role: Role) -> str:
        """Return the token of a role."""
        return self.operator if role is Role.OPERATOR else self.viewer


class TokenFiles:
    """The tokens of a running service, which follow changes of their files."""

    def __init__(self, data: Path) -> None:
        self._data = data
        self.tokens = load_tokens(data)
        self._versions = self._read_versions()

    def reload(self) -> set[Role]:
        """Read changed files and return the roles whose token has changed.

        A file that is missing or holds no valid token changes nothing, so that it locks out no user.
        """
        versions = self._read_versions()
        if versions == self._versions:
            return set()
        before, self._versions = self.tokens, versions
        self.tokens = Tokens(*(self._read(role) or before.get(role) for role in TOKEN_FILES))
        return {role for role in TOKEN_FILES if self.tokens.get(role) != before.get(role)}

    def rotate(self, roles: Iterable[Role]) -> None:
        """Write new tokens for ``roles``, which ``reload`` then activates. Raises OSError."""
        replace_tokens(self._data, roles)

    def _read(self, role: Role) -> str | None:
        try:
            return _read_token(self._data / TOKEN_FILES[role])
        except OSError:
            return None

    def _read_versions(self) -> list[tuple[int, int, int] | None]:
        return [_read_version(self._data / name) for name in TOKEN_FILES.values()]


def load_tokens(data: Path) -> Tokens:
    """Read the tokens of the folder ``data``.

    Creates folder and files (mode 0600) at the first start. Raises TokenError.
    """
    data.mkdir(parents=True, exist_ok=True)
    return Tokens(*(_read_or_create(data / TOKEN_FILES[role]) for role in (Role.OPERATOR, Role.VIEWER)))


def replace_tokens(data: Path, roles: Iterable[Role]) -> None:
    """Write new tokens for ``roles``.

    A service on this folder uses them within a second. Raises OSError.
    """
    for role in roles:
        write_private(data / TOKEN_FILES[role], secrets.token_urlsafe(32) + "\n")


def _read_or_create(path: Path) -> str:
    try:
        descriptor = os.open(path, os.O_CREAT | os.O_EXCL | os.O_WRONLY, 0o600)
    except FileExistsError:
        path.chmod(0o600)
        token = _read_token(path)
        if token is None:
            raise TokenError(messages.no_usable_token(file=str(path))) from None
        return token
    token = secrets.token_urlsafe(32)
    with os.fdopen(descriptor, "w") as file:
        file.write(token + "\n")
    return token


def _read_token(path: Path) -> str | None:
    """Return the token in a file; None if there is no file or no valid token in it."""
    try:
        token = path.read_text(encoding="ascii").strip()
    except (FileNotFoundError, UnicodeDecodeError):
        return None
    return token if len(token) >= MIN_TOKEN_LENGTH else None


def _read_version(path: Path) -> tuple[int, int, int] | None:
    """Return numbers that change with the content of a file; None if there is no file."""
    try:
        status = path.stat()
    except OSError:
        return None
    return status.st_mtime_ns, status.st_ino, status.st_size
