"""The two tokens of a data folder: one for operators, one for viewers, readable by their owner only."""

import os
import secrets
from dataclasses import dataclass
from pathlib import Path

from backend.api.schemas.session import Role

FILES = {Role.OPERATOR: "token", Role.VIEWER: "viewer-token"}


@dataclass(frozen=True, repr=False)
class Tokens:
    """The tokens by role; never printed, logged or sent."""

    operator: str
    viewer: str

    def role_of(self, token: str) -> Role | None:
        """Return the role that ``token`` opens, None for a wrong one; takes the same time for each."""
        offered = token.encode()
        is_operator = secrets.compare_digest(offered, self.operator.encode())
        is_viewer = secrets.compare_digest(offered, self.viewer.encode())
        if is_operator:
            return Role.OPERATOR
        return Role.VIEWER if is_viewer else None

    @property
    def signing_key(self) -> str:
        """Key for session cookies: deleting the token files and restarting ends every session."""
        return self.operator + self.viewer


def load_tokens(data: Path) -> Tokens:
    """Read the tokens of the folder ``data``, creating folder and files (mode 0600) at the first start."""
    data.mkdir(parents=True, exist_ok=True)
    return Tokens(*(_read_or_create(data / FILES[role]) for role in (Role.OPERATOR, Role.VIEWER)))


def _read_or_create(path: Path) -> str:
    try:
        descriptor = os.open(path, os.O_CREAT | os.O_EXCL | os.O_WRONLY, 0o600)
    except FileExistsError:
        path.chmod(0o600)
        token = path.read_text().strip()
        if len(token) < 20:
            raise ValueError(f"{path} holds no usable token; delete the file and start again") from None
        return token
    token = secrets.token_urlsafe(32)
    with os.fdopen(descriptor, "w") as file:
        file.write(token + "\n")
    return token
