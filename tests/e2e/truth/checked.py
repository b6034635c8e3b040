"""Differences between one page and one service, once the page is up to date."""

import time
from collections.abc import Callable, Collection, Mapping

from tests.e2e.operator import LOOK_MS
from tests.e2e.truth import elsewhere
from tests.e2e.truth.findings import Findings
from tests.e2e.truth.frame import around_the_page
from tests.e2e.truth.moment import Around, Moment
from tests.e2e.truth.operate import operate

SETTLED_S = 45.0
"""By then a page on a busy machine shows what the service says, whatever was on its way."""

PAGES: Mapping[str, Callable[[Moment], Findings]] = {
    "operate": operate,
    "experiments": elsewhere.experiments,
    "identify": elsewhere.identify,
    "banks": elsewhere.banks,
    "runs": elsewhere.runs,
    "log": elsewhere.log,
    "system": elsewhere.system,
}
"""What is compared beside what stands around every page, by the page's address."""


def differences(moment: Moment) -> Findings:
    """Return what one reading of the page shows differently from one state of the service."""
    found = around_the_page(moment)
    found += PAGES.get(moment.shown.place, elsewhere.nothing)(moment)
    if moment.shown.is_busy:
        found.append("something that was pressed is still on its way")
    return found


def looked_over(around: Around) -> Findings:
    """Return what the page shows differently from the states before and after the reading."""
    before, after = around.look()
    found = differences(before)
    return found and differences(after)


def settled(around: Around, within_s: float = SETTLED_S, known: Collection[str] = ()) -> Findings:
    """Repeat until page and service agree completely at one moment, apart from the ``known`` differences.

    Returns the remaining differences.
    """
    deadline = time.monotonic() + within_s
    while (found := _but(looked_over(around), known)) and time.monotonic() < deadline:
        around.page.wait_for_timeout(LOOK_MS)
    return found


def lasting(around: Around, looks: int) -> Findings:
    """Return the differences that are present in ``looks`` successive readings, so that transients are excluded."""
    found = looked_over(around)
    for _ in range(looks - 1):
        around.page.wait_for_timeout(LOOK_MS)
        again = looked_over(around)
        kept = {what_of(one) for one in again}
        found = Findings(one for one in found if what_of(one) in kept)
    return found


def _but(found: Findings, known: Collection[str]) -> Findings:
    return Findings(one for one in found if what_of(one) not in known)


def what_of(sentence: str) -> str:
    return sentence.partition(":")[0]
