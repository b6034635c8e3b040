"""No forged report holds: each change is a difference, or said not to be compared."""

import time
from collections.abc import Callable, Iterator

import pytest
from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey

from backend.reports.build import build_report
from backend.reports.evidence import EvidenceError
from backend.reports.model import to_html
from backend.reports.signing import apply_signature_check, derive_public_key, read_signature, sign_page
from backend.reports.verification import verify_report
from tests.reports import forgeries
from tests.reports.test_verification import Made, made

Forging = Callable[[str], Iterator[tuple[str, str]]]
KINDS: dict[str, tuple[Forging, int]] = {
    "account": (forgeries.of_the_account, 60),
    "page": (forgeries.of_the_page, 400),
    "drawings": (forgeries.of_the_drawings, 10),
    "versions": (forgeries.with_versions, 2),
}
"""With every how many of its forgeries `make test` tries one."""


@pytest.fixture(scope="module")
def report(tmp_path_factory: pytest.TempPathFactory) -> Made:
    source = made(tmp_path_factory.mktemp("forged"))
    return Made(source, to_html(build_report(source)))


def held(report: Made, forged: Iterator[tuple[str, str]]) -> tuple[int, list[str]]:
    """Return how many forgeries were tried, and which of them hold."""
    tried, found = 0, []
    for name, page in forged:
        assert page != report.page, name
        tried += 1
        try:
            if verify_report(page, report.source.columns).holds:
                found.append(name)
        except EvidenceError:
            continue
    return tried, found


@pytest.mark.parametrize("kind", KINDS)
def test_no_sample_of_forgeries_holds(report: Made, kind: str) -> None:
    forge, every = KINDS[kind]
    some = (one for number, one in enumerate(forge(report.page)) if number % every == 0)
    tried, found = held(report, some)
    assert tried > 2
    assert found == []


@pytest.mark.parametrize("kind", KINDS)
def test_no_forgery_holds(report: Made, kind: str) -> None:
    tried, found = held(report, KINDS[kind][0](report.page))
    assert tried >= (9 if kind == "versions" else 80)
    assert found == []


KEY, OTHER = (Ed25519PrivateKey.from_private_bytes(bytes([number]) * 32) for number in (1, 2))


@pytest.fixture(scope="module")
def signed(report: Made) -> bytes:
    return sign_page(report.page.encode(), KEY, "rig-2")


def valid(forged: Iterator[tuple[str, bytes]], page: bytes) -> tuple[int, list[str]]:
    """Return how many forgeries were tried, and which of them the key has signed."""
    tried, found = 0, []
    for name, one in forged:
        assert one != page, name
        tried += 1
        read = read_signature(one)
        if read.is_valid and read.signature is not None and read.signature.key == derive_public_key(KEY):
            found.append(name)
    return tried, found


def test_no_changed_byte_of_a_signed_page_keeps_its_signature(signed: bytes) -> None:
    tried, found = valid(forgeries.single_bytes(signed, every=20_011), signed)
    assert tried > 300
    assert found == []


def test_no_other_signature_is_one(signed: bytes) -> None:
    tried, found = valid(forgeries.of_the_signature(signed, OTHER), signed)
    assert tried > 25
    assert found == []


@pytest.mark.parametrize("kind", KINDS)
def test_no_forgery_of_a_signed_page_keeps_its_signature(report: Made, signed: bytes, kind: str) -> None:
    forge, every = KINDS[kind]
    some = (one for number, one in enumerate(forge(signed.decode())) if number % every == 0)
    tried, found = valid(((name, page.encode()) for name, page in some), signed)
    assert tried > 2
    assert found == []


@pytest.mark.parametrize("forge", ["of_the_signature", "by another key", "taken away"])
def test_no_page_holds_as_one_of_the_key_without_its_signature(report: Made, signed: bytes, forge: str) -> None:
    """Whatever its numbers: here they all hold."""
    pages = {
        "of_the_signature": dict(forgeries.of_the_signature(signed, OTHER))["another name"],
        "by another key": sign_page(signed, OTHER, "rig-2"),
        "taken away": report.page.encode(),
    }
    read = read_signature(pages[forge])
    found = verify_report(read.page.decode(), report.source.columns)
    assert found.holds is True
    assert apply_signature_check(found, read, derive_public_key(KEY)).holds is False
    assert apply_signature_check(found, read).holds is (forge != "of_the_signature")


def test_a_page_of_nothing_but_beginnings_takes_no_longer_than_its_size(report: Made) -> None:
    """Twice the page, about twice the time: within a run, so that no machine's speed matters."""

    def seconds(megabytes: int) -> float:
        page = report.page.replace("</body>", "<svg" * (megabytes * 250_000) + "</body>")
        begun = time.process_time()
        assert verify_report(page, report.source.columns).holds is False
        return time.process_time() - begun

    seconds(1)
    assert seconds(8) < 8.0 * max(seconds(2), 0.1)
