"""A signature covers the bytes of a page and the name of the signer; keys have the OpenSSH format."""

import json
import stat
import subprocess
import sys
from pathlib import Path

import pytest
from cryptography.exceptions import InvalidSignature
from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey, Ed25519PublicKey
from cryptography.hazmat.primitives.serialization import load_ssh_public_key

from backend.data_folder import make_private
from backend.reports.signing import (
    KeyOwner,
    SigningKeyError,
    UnsignableError,
    derive_public_key,
    find_public_key,
    load_or_make_signing_key,
    load_own_public_key,
    parse_public_key,
    read_signature,
    sign_page,
)
from tests.refusals import refused

PAGE = '<h1>λ</h1>\n<template id="evidence">{}</template>\n</body>\n'.encode()
KEY, OTHER = (Ed25519PrivateKey.from_private_bytes(bytes([number]) * 32) for number in (1, 2))
PUBLISHED = "ssh-ed25519 AAAAC3NzaC1lZDI1NTE5AAAAIOMqqnkVzrm0SdG6UOoqKLsabgH5C9okWi0dh2l9GKJl"
"""GitHub's key of its SSH service, and the fingerprint that it publishes with it."""
FINGERPRINT = "SHA256:+DiY3wvvV6TuJJhbpZisF/zLDA0zPMSvHdkr4UvCOqU"


def test_the_signature_is_verified_with_only_the_page_and_the_documented_message() -> None:
    """Verified without code of Sinew: heading, other content of the element, and page without the element."""
    signed = sign_page(PAGE, KEY, "<rig> & λ")
    begin = signed.index(b'<template id="signature">')
    end = signed.index(b"</template>", begin)
    text = signed[begin + len(b'<template id="signature">') : end]
    signed_fields = json.loads(text)
    value = bytes.fromhex(signed_fields["signature"])
    assert signed_fields == {"algorithm": "Ed25519", "public_key": derive_public_key(KEY).text, "name": "<rig> & λ"} | {
        "signature": value.hex()
    }
    assert signed[:begin] + signed[end + len(b"</template>") :] == PAGE
    assert signed[:begin].endswith(b"</template>")
    key = load_ssh_public_key(signed_fields["public_key"].encode())
    assert isinstance(key, Ed25519PublicKey)
    head = text[: text.index(b',"signature"')] + b"}"
    key.verify(value, b"Sinew report signature 1\n" + head + b"\n" + PAGE)
    with pytest.raises(InvalidSignature):
        key.verify(value, PAGE)


def test_signing_again_replaces_the_signature_and_reading_returns_the_original_page() -> None:
    signed = sign_page(PAGE, KEY, "rig-1")
    again = sign_page(signed, OTHER, "rig-2")
    assert again == sign_page(PAGE, OTHER, "rig-2")
    assert sign_page(signed, KEY, "rig-1") == signed
    found = read_signature(again)
    assert (found.page, found.is_valid, found.problem) == (PAGE, True, "")
    assert found.signature is not None
    assert (found.signature.name, found.signature.key) == ("rig-2", derive_public_key(OTHER))
    assert read_signature(PAGE).signature is None


def test_the_owner_of_a_signing_key_is_determined() -> None:
    found, one, other = read_signature(sign_page(PAGE, KEY, "")), derive_public_key(KEY), derive_public_key(OTHER)
    assert found.whose(one, one) == KeyOwner.GIVEN
    assert found.whose(other, one) == found.whose(None, one) == KeyOwner.OWN
    assert found.whose(other, None) == found.whose(None, other) == found.whose(None, None) == KeyOwner.UNKNOWN
    broken = read_signature(sign_page(PAGE, KEY, "").replace(b"<h1>", b"<h2>"))
    assert broken.problem
    assert broken.whose(one, one) is None
    assert read_signature(PAGE).whose(one, one) is None


@pytest.mark.parametrize("page", [b"", b"<html></html>", PAGE + b'<template id="signature">' * 2])
def test_a_page_that_is_not_a_report_is_not_signed(page: bytes) -> None:
    with pytest.raises(UnsignableError):
        sign_page(page, KEY, "")


def test_the_fingerprint_of_a_key_matches_openssh() -> None:
    key = parse_public_key(f"{PUBLISHED} github.com")
    assert (key.fingerprint, key.text) == (FINGERPRINT, PUBLISHED)


@pytest.mark.parametrize(
    "text",
    ["", "ssh-ed25519", PUBLISHED[:-4], PUBLISHED + "AAAA", PUBLISHED.replace("ed25519", "rsa"), "ssh-ed25519 λ"],
)
def test_an_invalid_public_key_is_rejected(tmp_path: Path, text: str) -> None:
    with pytest.raises(SigningKeyError):
        parse_public_key(text)
    file = tmp_path / "key.pub"
    file.write_text(text)
    with pytest.raises(SigningKeyError):
        find_public_key(str(file))


def test_a_public_key_is_read_from_a_text_or_a_file(tmp_path: Path) -> None:
    file = tmp_path / "key.pub"
    file.write_text(f"# of rig 2\n{PUBLISHED} rig-2\n\n")
    assert find_public_key(str(file)) == find_public_key(f" {PUBLISHED} rig-2 ") == parse_public_key(PUBLISHED)
    file.write_text(f"{PUBLISHED}\n{derive_public_key(KEY).text}\n")
    for other in (str(file), str(tmp_path), str(tmp_path / "none"), "\0"):
        with pytest.raises(SigningKeyError):
            find_public_key(other)


def test_the_signing_key_is_created_once_with_private_permissions(tmp_path: Path) -> None:
    data = tmp_path / "data"
    assert load_own_public_key(data) is None
    assert not data.exists()
    made = derive_public_key(load_or_make_signing_key(data))
    assert derive_public_key(load_or_make_signing_key(data)) == load_own_public_key(data) == made
    file = data / "signing-key"
    assert [path.name for path in data.iterdir()] == ["signing-key"]
    assert stat.S_IMODE(file.stat().st_mode) == 0o600
    assert stat.S_IMODE(data.stat().st_mode) == 0o700
    file.chmod(0o644)
    assert make_private(data) == []
    assert stat.S_IMODE(file.stat().st_mode) == 0o600
    file.chmod(0o644)
    load_or_make_signing_key(data)
    assert stat.S_IMODE(file.stat().st_mode) == 0o600
    assert derive_public_key(load_or_make_signing_key(tmp_path / "other")) != made


@pytest.mark.parametrize("content", [b"", b"junk", b"-----BEGIN "])
def test_a_damaged_signing_key_is_rejected_and_unchanged(tmp_path: Path, content: bytes) -> None:
    (tmp_path / "signing-key").write_bytes(content)
    with refused(SigningKeyError, "signing_key_unusable", file=tmp_path / "signing-key"):
        load_or_make_signing_key(tmp_path)
    assert load_own_public_key(tmp_path) is None
    assert (tmp_path / "signing-key").read_bytes() == content


def test_the_cryptography_library_is_loaded_only_for_signatures() -> None:
    code = (
        "import sys, backend.main, backend.app, backend.cli.report, backend.reports.signing\n"
        "backend.reports.signing.read_signature(b'<html></html>')\n"
        "print('cryptography' in sys.modules)"
    )
    ended = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert ended.stdout.strip() == "False"
