"""The two tokens of a data folder: one for operators, one for viewers, readable by their owner only."""

import os
import secrets
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

from backend.data_folder import write_private
from backend.messages.session import Role

FILES = {Role.OPERATOR: "token", Role.VIEWER: "viewer-token"}
SHORTEST = 20


class TokenError(Exception):
    """A token file holds nothing that could be a token; the message says what to do."""


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
        rotate(self._data, roles)

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


def rotate(data: Path, roles: Iterable[Role]) -> None:
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
