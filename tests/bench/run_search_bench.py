"""Search among 20 000 runs, and their list in a real browser: waiting times.

The times are medians for each search, and for the list the time from the click to the picture with its first row.
"""

import statistics
import tempfile
import time
from contextlib import closing
from pathlib import Path

from playwright.sync_api import Browser, expect
from rich.console import Console

from backend.services.runs import RunQuery, StoredRuns
from backend.storage.database import open_database
from tests.bench.many_runs import make_runs
from tests.bench.table import Ratio, print_ratios
from tests.e2e.browser import DESKTOP, chromium
from tests.e2e.service import Service, running_service

COUNT = 20_000
SEARCH_S, LIST_S = 0.2, 1.0
REPETITIONS = 5
SEARCHES = (
    "",
    "worn",
    "nothing-of-this-kind",
    "kind = tracking",
    "overshoot_q_percent < 5",
    "not overshoot_q_percent < 5",
    "geometry.r_j > 0.0725",
    "tag = paper verdict = failed",
    "lam_q >= 0.5 and (who ~ öz or end = tripped) date >= 2026-02",
    "figure_7 = none or figure_8 = 3",
)

_WATCH = """() => {
  window.took = new Promise((resolve) => {
    window.addEventListener("click", (begun) => {
      const look = () => {
        if (document.querySelector('table[aria-label="Runs"] tbody tr') !== null)
          requestAnimationFrame(() => resolve((performance.now() - begun.timeStamp) / 1000))
        else requestAnimationFrame(look)
      }
      look()
    }, { once: true, capture: true })
  })
}"""
"""Takes the time from the next click until the picture after the first in which the list has a row."""


def bench(console: Console) -> bool:
    """Print the times; return whether all are within their bounds."""
    with tempfile.TemporaryDirectory() as folder:
        data = Path(folder)
        with closing(open_database(data)) as database:
            make_runs(database, COUNT)
            stored = StoredRuns(database, lambda: None, lambda _run: False)
            ratios = [_searched(stored, where) for where in SEARCHES]
        with running_service(data) as service, chromium() as browser:
            waits = [_opening(browser, service) for _ in range(REPETITIONS)]
        shown = Ratio.at_most("Runs page, from the click to the first row [s]", statistics.median(waits), LIST_S)
        return print_ratios(console, f"{COUNT} runs", [*ratios, shown])


def _searched(stored: StoredRuns, where: str) -> Ratio:
    took = []
    for _ in range(REPETITIONS):
        begun = time.perf_counter()
        found = stored.find_runs(RunQuery(where=(where,), limit=50))
        took.append(time.perf_counter() - begun)
    return Ratio.at_most(f"search {where or 'for all'} [s]", statistics.median(took), SEARCH_S, f"{found.total} runs")


def _opening(browser: Browser, service: Service) -> float:
    """Use a new browser each time, so that no data of the list are cached."""
    with browser.new_context(viewport=DESKTOP) as context:
        page = context.new_page()
        page.goto(service.link)
        link = page.get_by_role("navigation").get_by_role("link", name="Runs")
        expect(link).to_be_visible()
        page.evaluate(_WATCH)
        link.click()
        return float(page.evaluate("window.took"))
