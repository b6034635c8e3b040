"""Comparison of four runs of one hour: time from opening the page to the first picture, in a real browser."""

import tempfile
import time
from pathlib import Path

from playwright.sync_api import Page
from rich.console import Console

from tests.bench.hour_recording import record_an_hour
from tests.bench.table import Ratio, print_ratios
from tests.e2e.browser import DESKTOP, chromium
from tests.e2e.operator import Operator
from tests.e2e.service import running_service

RUNS = 4
PICTURE_MS = 1500.0
"""Longest from the click to the first picture of all runs."""

_DRAWN = """
() => ["q", "q\u2032", "q\u2032\u2032", "q\u2032\u2032\u2032"].every((name) => {
  const value = document.querySelector(`[data-role="value-${name}"]`)
  return value !== null && /\\d/.test(value.textContent)
})
"""
"""Each run has curves: the legend reads a value out of them, which it does after each drawn frame only."""


def bench(console: Console) -> bool:
    """Print the time to the first picture; return whether it is within the bound."""
    with tempfile.TemporaryDirectory() as folder:
        numbers = [record_an_hour(Path(folder)) for _ in range(RUNS)]
        with running_service(Path(folder)) as service, chromium() as browser:
            page = browser.new_context(viewport=DESKTOP).new_page()
            Operator(page, service).sign_in()
            page.goto(f"{service.url}/#/runs/{numbers[0]}")
            page.get_by_role("combobox", name="Compare with").wait_for()
            page.wait_for_load_state("networkidle")
            begin_ms = picture_ms(page, numbers, "")
            step_ms = picture_ms(page, numbers, "/by=step;number=100")
    return print_ratios(
        console,
        f"First picture of {RUNS} runs of an hour",
        [
            Ratio.at_most("aligned by their begin / 1.5 s", begin_ms / PICTURE_MS, 1.0, f"{begin_ms:.0f} ms"),
            Ratio.at_most("aligned by their 100th step / 1.5 s", step_ms / PICTURE_MS, 1.0, f"{step_ms:.0f} ms"),
        ],
    )


def picture_ms(page: Page, numbers: list[int], how: str) -> float:
    """Return the time [ms] from the change of the address to the curves of all runs."""
    page.evaluate("address => { location.hash = address }", f"/runs/{numbers[0]}")
    page.wait_for_function("document.querySelector('[data-role=\"value-q\u2032\"]') === null")
    address = f"/runs/{numbers[0]}/{','.join(map(str, numbers[1:]))}{how}"
    before = time.perf_counter()
    page.evaluate("address => { location.hash = address }", address)
    page.wait_for_function(_DRAWN, polling="raf")
    return 1000.0 * (time.perf_counter() - before)
