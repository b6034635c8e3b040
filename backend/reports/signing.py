"""Signatures of reports, and the keys of an installation."""

import base64
import hashlib
import json
import os
from contextlib import suppress
from dataclasses import dataclass, replace
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Any

from backend.data_folder import FILE_MODE
from backend.reports import messages
from backend.reports.verification import MOST, ReportDifference, Verified
from plant import ErrorCode, SinewError

if TYPE_CHECKING:
    from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey


# Signing key ---------------------------------------------------------------------------------------
# The private key with which an installation signs its reports, and the public keys for verification.
#
# Public keys are in OpenSSH format, so that ``ssh-keygen -lf`` gives the same fingerprint.


FILE_NAME = "signing-key"
KIND = "ssh-ed25519"
_HEAD = b"\x00\x00\x00\x0bssh-ed25519\x00\x00\x00\x20"
"""Header before the 32 bytes of a public key (RFC 8709)."""
_RAW = 32
_TEXT_MAX = 64 * 1024
_FINGERPRINT = "SHA256:"


class SigningKeyError(SinewError, ValueError):
    """A key that cannot be read or used."""

    category = ErrorCode.UNAVAILABLE


@dataclass(frozen=True)
class PublicKey:
    """A public key; ``raw`` is its 32 bytes."""

    raw: bytes

    @property
    def text(self) -> str:
        """Return the key in OpenSSH format, without a comment."""
        return f"{KIND} {base64.b64encode(_HEAD + self.raw).decode()}"

    @property
    def fingerprint(self) -> str:
        """Return its SHA-256 in OpenSSH format."""
        digest = hashlib.sha256(_HEAD + self.raw).digest()
        return _FINGERPRINT + base64.b64encode(digest).decode().rstrip("=")


def parse_public_key(text: str) -> PublicKey:
    """Parse a public key: "ssh-ed25519 AAAA..." and a comment. Raises SigningKeyError."""
    words = text.split()
    if len(words) >= 2 and words[0] == KIND:
        with suppress(ValueError):
            blob = base64.b64decode(words[1], validate=True)
            if blob.startswith(_HEAD) and len(blob) == len(_HEAD) + _RAW:
                return PublicKey(blob[len(_HEAD) :])
    raise SigningKeyError(messages.not_a_public_key(key_type=KIND, text=text.strip()))


def find_public_key(file_or_text: str) -> PublicKey:
    """Return the public key in a file, or in the text itself. Raises SigningKeyError."""
    text = file_or_text.strip()
    if not text.startswith(f"{KIND} "):
        try:
            with Path(text).open("rb") as file:
                text = file.read(_TEXT_MAX).decode("utf-8")
        except (OSError, UnicodeDecodeError, ValueError) as error:
            reason = messages.key_file_unreadable(file=file_or_text, key_type=KIND, reason=str(error))
            raise SigningKeyError(reason) from None
    lines = [line for line in text.splitlines() if line.strip() and not line.lstrip().startswith("#")]
    if len(lines) != 1:
        raise SigningKeyError(messages.wrong_number_of_keys(file=file_or_text, lines=len(lines)))
    return parse_public_key(lines[0])


def load_or_make_signing_key(data: Path) -> "Ed25519PrivateKey":
    """Return the private key of a data folder; created when it is first needed.

    Only its owner can read the file. Raises SigningKeyError, OSError.
    """
    from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey
    from cryptography.hazmat.primitives.serialization import Encoding, NoEncryption, PrivateFormat

    data.mkdir(mode=0o700, parents=True, exist_ok=True)
    path = data / FILE_NAME
    try:
        descriptor = os.open(path, os.O_CREAT | os.O_EXCL | os.O_WRONLY, FILE_MODE)
    except FileExistsError:
        path.chmod(FILE_MODE)
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


def load_own_public_key(data: Path) -> PublicKey | None:
    """Return the public key of a data folder; None if it is missing or unreadable."""
    path = data / FILE_NAME
    try:
        return derive_public_key(_load(path)) if path.is_file() else None
    except (OSError, SigningKeyError):
        return None


def derive_public_key(key: "Ed25519PrivateKey") -> PublicKey:
    """Return the public key of a private key."""
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
        raise SigningKeyError(messages.signing_key_unusable(file=path))
    return key


# Signature -----------------------------------------------------------------------------------------
# The signature of a page, in an element directly after the manifest. It states which key signed exactly these bytes.
#
# The signed message is a heading with the other fields of the element, followed by the page without the element.


_BEGIN, _END = b'<template id="signature">', b"</template>"
_ACCOUNT = b'<template id="evidence">'
_HEADING = "Sinew report signature 1"
"""Begins no other message that a key may sign, so that the signature of another document is never valid for a
report."""
ALGORITHM = "Ed25519"
NAME_MAX = 80
_ELEMENT_MAX = 4096


class UnsignableError(SinewError, ValueError):
    """A page that cannot be signed."""

    category = ErrorCode.BAD_VALUE


class KeyOwner(StrEnum):
    """The owner of the key that signed a page."""

    GIVEN = "given"
    OWN = "own"
    UNKNOWN = "unknown"


@dataclass(frozen=True)
class Signature:
    """The signer of a page: public key, and the name of the installation.

    The installation chooses its name itself.
    """

    key: PublicKey
    name: str


@dataclass(frozen=True)
class SignedPage:
    """A page without its signature element.

    ``signature`` is None if there is none or it is unreadable. ``problem`` says why the signature is invalid, "" if it
    is valid.
    """

    page: bytes
    signature: Signature | None = None
    problem: str = ""

    @property
    def is_valid(self) -> bool:
        """Return whether the named key signed exactly this page."""
        return self.signature is not None and not self.problem

    def whose(self, expected: PublicKey | None, own: PublicKey | None) -> KeyOwner | None:
        """Return whose key signed the page; None without a valid signature."""
        if self.signature is None or self.problem:
            return None
        if self.signature.key == expected:
            return KeyOwner.GIVEN
        return KeyOwner.OWN if self.signature.key == own else KeyOwner.UNKNOWN


def sign_page(page: bytes, key: "Ed25519PrivateKey", name: str) -> bytes:
    """Return a page with a new signature in place of any old one.

    Raises UnsignableError.
    """
    begin, end = _span(page)
    unsigned = page[:begin] + page[end:]
    place = _place(unsigned)
    if place is None:
        raise UnsignableError(messages.page_not_signable())
    if _BEGIN in unsigned:
        raise UnsignableError(messages.two_signatures())
    fields = _make_signature_fields(Signature(derive_public_key(key), name))
    return unsigned[:place] + _element(fields, key.sign(_message(fields, unsigned))) + unsigned[place:]


def read_signature(page: bytes) -> SignedPage:
    """Return a page without its signature, and the signature with its check."""
    begin, end = _span(page)
    if begin == end:
        return SignedPage(page)
    unsigned = page[:begin] + page[end:]
    try:
        signature, value = _parse(page[begin:end])
    except (ValueError, KeyError, TypeError, RecursionError):
        return SignedPage(unsigned, problem=messages.invalid_signature_element())
    if begin != _place(unsigned) or _BEGIN in unsigned:
        return SignedPage(unsigned, signature, messages.signature_elsewhere())
    if not _is_signed(signature.key, value, _message(_make_signature_fields(signature), unsigned)):
        return SignedPage(unsigned, signature, messages.page_not_signed_by_key())
    return SignedPage(unsigned, signature)


def apply_signature_check(found: Verified, signed: SignedPage, wanted: PublicKey | None = None) -> Verified:
    """Return the verification result with signature problems added as differences."""
    return replace(found, differences=(*signature_differences(signed, wanted), *found.differences)[:MOST])


def signature_differences(signed: SignedPage, wanted: PublicKey | None = None) -> tuple[ReportDifference, ...]:
    """Return the differences of an invalid signature, or one not made by ``wanted``."""
    key = None if signed.signature is None else signed.signature.key
    by = messages.signature_found(fingerprint=None if key is None else key.fingerprint)
    if signed.problem:
        return (ReportDifference("signature", by, signed.problem),)
    if wanted is not None and key != wanted:
        other = messages.not_signed_by_given_key(fingerprint=wanted.fingerprint)
        return (ReportDifference("signature", by, other),)
    return ()


def _span(page: bytes) -> tuple[int, int]:
    """Return start and end of the signature element; equal if there is none."""
    begin = page.find(_BEGIN)
    if begin < 0:
        return 0, 0
    end = page.find(_END, begin)
    return begin, begin + len(_BEGIN) if end < 0 else end + len(_END)


def _place(unsigned: bytes) -> int | None:
    """Return the position of the signature in a page: after its manifest."""
    begin = unsigned.find(_ACCOUNT)
    end = unsigned.find(_END, begin)
    return None if begin < 0 or end < 0 else end + len(_END)


def _make_signature_fields(signature: Signature) -> dict[str, str]:
    return {"algorithm": ALGORITHM, "public_key": signature.key.text, "name": signature.name}


def _element(fields: dict[str, str], value: bytes) -> bytes:
    return _BEGIN + _json({**fields, "signature": value.hex()}).encode("ascii") + _END


def _json(document: dict[str, Any]) -> str:
    """Return the canonical text of a document; nothing in it can close the element."""
    text = json.dumps(document, separators=(",", ":"))
    for letter in "<>&":
        text = text.replace(letter, f"\\u{ord(letter):04x}")
    return text


def _message(fields: dict[str, str], unsigned: bytes) -> bytes:
    return f"{_HEADING}\n{_json(fields)}\n".encode("ascii") + unsigned


def _parse(element: bytes) -> tuple[Signature, bytes]:
    """Return the fields of an element and its signature value.

    The element must have exactly the form that this module writes. Raises ValueError, KeyError, TypeError.
    """
    if len(element) > _ELEMENT_MAX:
        raise ValueError(f"more than {_ELEMENT_MAX} bytes")
    document = json.loads(element[len(_BEGIN) : -len(_END)].decode("ascii"))
    name, key = document["name"], document["public_key"]
    if not isinstance(key, str) or not isinstance(name, str) or not name.isprintable() or len(name) > NAME_MAX:
        raise ValueError("the name or the key is missing or invalid")
    signature = Signature(parse_public_key(key), name)
    value = bytes.fromhex(document["signature"])
    if _element(_make_signature_fields(signature), value) != element:
        raise ValueError("not in the canonical form")
    return signature, value


def _is_signed(key: PublicKey, value: bytes, message: bytes) -> bool:
    from cryptography.exceptions import InvalidSignature
    from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PublicKey

    try:
        Ed25519PublicKey.from_public_bytes(key.raw).verify(value, message)
    except (InvalidSignature, ValueError):
        return False
    return True
