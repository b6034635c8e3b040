"""The signature of a page: which key signed exactly these bytes, in an element beside the page's account.

What is signed are the bytes of the page without that element, behind a heading with all else that the element says.
"""

import json
from dataclasses import dataclass, replace
from enum import StrEnum
from typing import TYPE_CHECKING, Any

from backend.reports.differences import MOST, Difference, Verified
from backend.reports.signing_key import PublicKey, parse_public_key, public_half

if TYPE_CHECKING:
    from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey

_BEGIN, _END = b'<template id="signature">', b"</template>"
_ACCOUNT = b'<template id="evidence">'
_HEADING = "Sinew report signature 1"
"""Of nothing else that a key may ever sign: no signature of another document is one of a report."""
ALGORITHM = "Ed25519"
NAME_MAX = 80
_ELEMENT_MAX = 4096


class UnsignableError(ValueError):
    """A page that cannot be signed."""


class Whose(StrEnum):
    """Whose key signed a page."""

    GIVEN = "given"
    OWN = "own"
    UNKNOWN = "unknown"


@dataclass(frozen=True)
class Signature:
    """Who signed a page: the public half of the key, and the name that its installation gives itself."""

    key: PublicKey
    name: str


@dataclass(frozen=True)
class SignedPage:
    """A page without the element of its signature; ``problem`` says why the signature is broken, "" where it is valid.

    ``signature`` is None where there is none, or none that can be read.
    """

    page: bytes
    signature: Signature | None = None
    problem: str = ""

    @property
    def is_valid(self) -> bool:
        """Whether the key that it names signed exactly this page."""
        return self.signature is not None and not self.problem

    def whose(self, given: PublicKey | None, own: PublicKey | None) -> Whose | None:
        """Return whose key signed it; None without a valid signature."""
        if self.signature is None or self.problem:
            return None
        if self.signature.key == given:
            return Whose.GIVEN
        return Whose.OWN if self.signature.key == own else Whose.UNKNOWN


def sign_page(page: bytes, key: "Ed25519PrivateKey", name: str) -> bytes:
    """Return a page with a signature, which takes the place of one that it has. Raises UnsignableError."""
    begin, end = _span(page)
    unsigned = page[:begin] + page[end:]
    place = _place(unsigned)
    if place is None:
        raise UnsignableError("it carries no account of its numbers: only reports of runs and of series are signed")
    if _BEGIN in unsigned:
        raise UnsignableError("it has two signatures: make the report again")
    said = _said(Signature(public_half(key), name))
    return unsigned[:place] + _element(said, key.sign(_message(said, unsigned))) + unsigned[place:]


def read_signature(page: bytes) -> SignedPage:
    """Return a page without its signature, and what was found of that; nothing but the page is needed for it."""
    begin, end = _span(page)
    if begin == end:
        return SignedPage(page)
    unsigned = page[:begin] + page[end:]
    try:
        signature, value = _parse(page[begin:end])
    except (ValueError, KeyError, TypeError, RecursionError):
        return SignedPage(unsigned, problem="an element that is no signature of a report")
    if begin != _place(unsigned) or _BEGIN in unsigned:
        return SignedPage(unsigned, signature, "a signature elsewhere than beside the account")
    if not _is_signed(signature.key, value, _message(_said(signature), unsigned)):
        return SignedPage(unsigned, signature, "a page that this key has not signed")
    return SignedPage(unsigned, signature)


def with_signature(found: Verified, signed: SignedPage, wanted: PublicKey | None = None) -> Verified:
    """Return what was found of a page, with a broken signature, or one by another key than is wanted, as difference."""
    return replace(found, differences=(*signature_differences(signed, wanted), *found.differences)[:MOST])


def signature_differences(signed: SignedPage, wanted: PublicKey | None = None) -> tuple[Difference, ...]:
    """Return what differs: a signature that is broken, or none by the key that is wanted."""
    by = "none" if signed.signature is None else f"one by {signed.signature.key.fingerprint}"
    if signed.problem:
        return (Difference("signature", by, signed.problem),)
    if wanted is not None and (signed.signature is None or signed.signature.key != wanted):
        return (Difference("signature", by, f"none by the key that was given, {wanted.fingerprint}"),)
    return ()


def _span(page: bytes) -> tuple[int, int]:
    """Return where the element of the signature begins and ends; two equal places where there is none."""
    begin = page.find(_BEGIN)
    if begin < 0:
        return 0, 0
    end = page.find(_END, begin)
    return begin, begin + len(_BEGIN) if end < 0 else end + len(_END)


def _place(unsigned: bytes) -> int | None:
    """Return where the signature of a page stands: behind its account."""
    begin = unsigned.find(_ACCOUNT)
    end = unsigned.find(_END, begin)
    return None if begin < 0 or end < 0 else end + len(_END)


def _said(signature: Signature) -> dict[str, str]:
    return {"algorithm": ALGORITHM, "public_key": signature.key.text, "name": signature.name}


def _element(said: dict[str, str], value: bytes) -> bytes:
    return _BEGIN + _json({**said, "signature": value.hex()}).encode("ascii") + _END


def _json(document: dict[str, Any]) -> str:
    """Return the one way in which a document is written; nothing in it can end the element."""
    text = json.dumps(document, separators=(",", ":"))
    for letter in "<>&":
        text = text.replace(letter, f"\\u{ord(letter):04x}")
    return text


def _message(said: dict[str, str], unsigned: bytes) -> bytes:
    return f"{_HEADING}\n{_json(said)}\n".encode("ascii") + unsigned


def _parse(element: bytes) -> tuple[Signature, bytes]:
    """Return what an element says, and the value of its signature; it has to be written as this module writes it.

    Raises ValueError, KeyError, TypeError.
    """
    if len(element) > _ELEMENT_MAX:
        raise ValueError(f"more than {_ELEMENT_MAX} bytes")
    document = json.loads(element[len(_BEGIN) : -len(_END)].decode("ascii"))
    name, key = document["name"], document["public_key"]
    if not isinstance(key, str) or not isinstance(name, str) or not name.isprintable() or len(name) > NAME_MAX:
        raise ValueError("no name or no key")
    signature = Signature(parse_public_key(key), name)
    value = bytes.fromhex(document["signature"])
    if _element(_said(signature), value) != element:
        raise ValueError("written otherwise")
    return signature, value


def _is_signed(key: PublicKey, value: bytes, message: bytes) -> bool:
    from cryptography.exceptions import InvalidSignature
    from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PublicKey

    try:
        Ed25519PublicKey.from_public_bytes(key.raw).verify(value, message)
    except (InvalidSignature, ValueError):
        return False
    return True
