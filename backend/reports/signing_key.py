"""The key by which an installation signs its reports, and the public halves by which anybody verifies them.

Public halves are written as OpenSSH writes them, so that ``ssh-keygen -lf`` gives the same fingerprint.
"""

import base64
import hashlib
import os
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from backend.data_folder import FILE

if TYPE_CHECKING:
    from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey

FILE_NAME = "signing-key"
KIND = "ssh-ed25519"
_HEAD = b"\x00\x00\x00\x0bssh-ed25519\x00\x00\x00\x20"
"""What stands before the 32 bytes of a public half (RFC 8709)."""
_RAW = 32
_TEXT_MAX = 64 * 1024
_FINGERPRINT = "SHA256:"


class SigningKeyError(ValueError):
    """A key that cannot be read or used."""


@dataclass(frozen=True)
class PublicKey:
    """A public half; ``raw`` is its 32 bytes."""

    raw: bytes

    @property
    def text(self) -> str:
        """Return it as OpenSSH writes it, without a comment."""
        return f"{KIND} {base64.b64encode(_HEAD + self.raw).decode()}"

    @property
    def fingerprint(self) -> str:
        """Return its SHA-256 as OpenSSH writes it."""
        digest = hashlib.sha256(_HEAD + self.raw).digest()
        return _FINGERPRINT + base64.b64encode(digest).decode().rstrip("=")


def parse_public_key(text: str) -> PublicKey:
    """Return the public half that a text gives: "ssh-ed25519 AAAA...", and a comment. Raises SigningKeyError."""
    words = text.split()
    if len(words) >= 2 and words[0] == KIND:
        with suppress(ValueError):
            blob = base64.b64decode(words[1], validate=True)
            if blob.startswith(_HEAD) and len(blob) == len(_HEAD) + _RAW:
                return PublicKey(blob[len(_HEAD) :])
    raise SigningKeyError(
        f"no public key: it has the form “{KIND} AAAA…”, as `sinew report key` prints it; found “{text.strip()[:60]}”"
    )


def find_public_key(file_or_text: str) -> PublicKey:
    """Return the public half in a file, or in the text itself. Raises SigningKeyError."""
    text = file_or_text.strip()
    if not text.startswith(f"{KIND} "):
        try:
            with Path(text).open("rb") as file:
                text = file.read(_TEXT_MAX).decode("utf-8")
        except (OSError, UnicodeDecodeError, ValueError) as error:
            words = f"{file_or_text[:200]}: neither a public key, “{KIND} AAAA…”, nor a file with one: {error}"
            raise SigningKeyError(words) from None
    lines = [line for line in text.splitlines() if line.strip() and not line.lstrip().startswith("#")]
    if len(lines) != 1:
        raise SigningKeyError(f"{file_or_text[:200]} has {len(lines)} lines: a file of a public key has one")
    return parse_public_key(lines[0])


def load_or_make_signing_key(data: Path) -> "Ed25519PrivateKey":
    """Return the private key of a data folder, readable by its owner only; made at its first use.

    Raises SigningKeyError, OSError.
    """
    from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey
    from cryptography.hazmat.primitives.serialization import Encoding, NoEncryption, PrivateFormat

    data.mkdir(mode=0o700, parents=True, exist_ok=True)
    path = data / FILE_NAME
    try:
        descriptor = os.open(path, os.O_CREAT | os.O_EXCL | os.O_WRONLY, FILE)
    except FileExistsError:
        path.chmod(FILE)
        return _load(path)
    key = Ed25519PrivateKey.generate()
    try:
        with os.fdopen(descriptor, "wb") as file:
            file.write(key.private_bytes(Encoding.PEM, PrivateFormat.PKCS8, NoEncryption()))
            file.flush()
            os.fsync(file.fileno())
    except OSError:
        path.unlink()
        raise
    return key


def own_public_key(data: Path) -> PublicKey | None:
    """Return the public half of a data folder's key; None where there is none that this account can read."""
    path = data / FILE_NAME
    try:
        return public_half(_load(path)) if path.is_file() else None
    except (OSError, SigningKeyError):
        return None


def public_half(key: "Ed25519PrivateKey") -> PublicKey:
    """Return the public half of a private key."""
    return PublicKey(key.public_key().public_bytes_raw())


def _load(path: Path) -> "Ed25519PrivateKey":
    from cryptography.exceptions import UnsupportedAlgorithm
    from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey
    from cryptography.hazmat.primitives.serialization import load_pem_private_key

    try:
        key = load_pem_private_key(path.read_bytes(), password=None)
    except (ValueError, TypeError, UnsupportedAlgorithm):
        key = None
    if not isinstance(key, Ed25519PrivateKey):
        raise SigningKeyError(
            f"{path} holds no usable key for signing: put a copy of it back, or delete it to have a new key made; what "
            "the old one signed is still verified by its public half"
        )
    return key
