"""No forged report holds: each change is a difference, or said not to be compared."""

import time
from collections.abc import Callable, Iterator

import pytest

from backend.reports.build import build_report
from backend.reports.evidence import EvidenceError
from backend.reports.html import to_html
from backend.reports.verification import verify
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
            if verify(page, report.source.columns).holds:
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


def test_a_page_of_nothing_but_beginnings_takes_no_longer_than_its_size(report: Made) -> None:
    """Twice the page, about twice the time: within a run, so that no machine's speed matters."""

    def seconds(megabytes: int) -> float:
        page = report.page.replace("</body>", "<svg" * (megabytes * 250_000) + "</body>")
        begun = time.process_time()
        assert verify(page, report.source.columns).holds is False
        return time.process_time() - begun

    seconds(1)
    assert seconds(8) < 8.0 * max(seconds(2), 0.1)
