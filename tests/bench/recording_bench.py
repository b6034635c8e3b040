"""A recording of one hour in a real service and browser: waiting time for its curves.

The times are from the click on the run to the first curve, and from the wheel to visible single samples. They are
medians over several repetitions.
"""

import math
import statistics
import tempfile
from pathlib import Path

from playwright.sync_api import Browser, Page, expect
from rich.console import Console

from tests.bench.hour_recording import HOUR_S, record_an_hour
from tests.bench.table import Ratio, print_ratios
from tests.e2e.browser import DESKTOP, chromium
from tests.e2e.service import Service, running_service

OPEN_S, ZOOM_S = 1.5, 0.3
REPETITIONS = 7
_SPAN_S = 1.0
_PATIENCE_MS = 30_000
_WHEEL_PX = math.log(_SPAN_S / HOUR_S) / 0.0016
"""Turn of the wheel that leaves one second in sight: the page scales time by exp(0.0016 px)."""

_WATCH = """({ event, done }) => {
  window.took = new Promise((resolve) => {
    window.addEventListener(event, (begun) => {
      const look = () => {
        if (done()) requestAnimationFrame(() => resolve((performance.now() - begun.timeStamp) / 1000))
        else requestAnimationFrame(look)
      }
      look()
    }, { once: true, capture: true })
  })
}"""
"""Takes the time from the next ``event`` until the picture after the first in which ``done`` holds."""

_FIRST_CURVE = """() => {
  const canvas = document.querySelector('figure[aria-label="Joint position"] canvas')
  if (!canvas?.width) return false
  const { data } = canvas.getContext("2d").getImageData(0, 0, canvas.width, canvas.height)
  let blue = 0
  for (let i = 0; i < data.length; i += 4) if (data[i + 2] - data[i] > 100 && data[i + 3] > 100) blue += 1
  return blue > 200
}"""
"""Whether the curve of q stands on its canvas: a few hundred points of its blue."""

_RAW = """() => document.querySelector('[aria-label="Resolution"]')?.textContent.includes("all samples") === true"""


def bench(console: Console) -> bool:
    """Print both times; return whether both are within their bounds."""
    with tempfile.TemporaryDirectory() as folder:
        data = Path(folder)
        run = record_an_hour(data)
        with running_service(data) as service, chromium() as browser:
            opened = [_opening(browser, service, run) for _ in range(REPETITIONS)]
            zoomed = _zooming(browser, service, run)
    return print_ratios(
        console,
        f"A recording of one hour, {HOUR_S * 1000:,} samples, in the browser: seconds, medians",
        [
            Ratio.at_most(
                "click on the run to its first curve [s]", statistics.median(opened), OPEN_S, _spread(opened)
            ),
            Ratio.at_most("wheel to one second of raw samples [s]", statistics.median(zoomed), ZOOM_S, _spread(zoomed)),
        ],
    )


def _opening(browser: Browser, service: Service, run: int) -> float:
    """Use a new browser each time, so that no data of the run are cached."""
    with browser.new_context(viewport=DESKTOP) as context:
        page = _signed_in(context.new_page(), service)
        page.goto(f"{service.url}/#/runs")
        link = page.get_by_role("link", name=f"Run {run}", exact=True)
        expect(link).to_be_visible(timeout=_PATIENCE_MS)
        _watch(page, "click", _FIRST_CURVE)
        link.click()
        return float(page.evaluate("window.took"))


def _zooming(browser: Browser, service: Service, run: int) -> list[float]:
    """Zoom into another second of the hour each time."""
    with browser.new_context(viewport=DESKTOP) as context:
        page = _signed_in(context.new_page(), service)
        page.goto(f"{service.url}/#/runs/{run}")
        page.wait_for_function(_FIRST_CURVE, timeout=_PATIENCE_MS)
        box = page.get_by_role("figure", name="Joint position", exact=True).locator("canvas").first.bounding_box()
        assert box is not None
        took = []
        for repetition in range(REPETITIONS):
            at = 0.1 + 0.8 * repetition / REPETITIONS
            page.mouse.move(box["x"] + at * box["width"], box["y"] + 0.5 * box["height"])
            _watch(page, "wheel", _RAW)
            page.keyboard.down("Control")
            page.mouse.wheel(0, _WHEEL_PX)
            page.keyboard.up("Control")
            took.append(float(page.evaluate("window.took")))
            page.mouse.dblclick(box["x"] + at * box["width"], box["y"] + 0.5 * box["height"])
            page.wait_for_function(f"!({_RAW})()", timeout=_PATIENCE_MS)
        return took


def _signed_in(page: Page, service: Service) -> Page:
    page.set_default_timeout(_PATIENCE_MS)
    page.goto(service.link)
    expect(page.get_by_role("banner")).to_be_visible(timeout=_PATIENCE_MS)
    return page


def _watch(page: Page, event: str, done: str) -> None:
    page.evaluate(f"({_WATCH})({{ event: '{event}', done: {done} }})")


def _spread(seconds: list[float]) -> str:
    return f"from {min(seconds):.2f} to {max(seconds):.2f} s, {len(seconds)} times"
