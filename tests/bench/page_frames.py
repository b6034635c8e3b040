"""Script time and frame rate of the live page: five and eight panels at 1 kHz over 60 s, without the 3D view."""

import statistics
import tempfile
from pathlib import Path

from playwright.sync_api import CDPSession, Page, expect
from rich.console import Console

from tests.bench.table import Ratio, print_ratios
from tests.e2e.browser import DESKTOP, chromium
from tests.e2e.operator import Operator
from tests.e2e.service import running_service

SCRIPT_MS = 6.0
"""Most script time of a frame in the median."""

OF_EMPTY_PAGE = 0.98
"""Least rate of frames with eight panels, as a share of that of a page that draws nothing."""

ADDED = ("q - q_ref", "S", "F_A")
"""Signals of the panels that the Standard layout of five gets in addition."""

PANELS = 8

WINDOW_S = 60
FILLED_MS = (WINDOW_S + 2) * 1000
MEASURED_MS = 10_000

# Every callback of an animation frame is measured; callbacks of one frame share a time stamp.
_STOPWATCH = """
(() => {
  const frames = new Map(), request = window.requestAnimationFrame.bind(window)
  window.frameTimes = () => [...frames.values()]
  window.forgetFrames = () => frames.clear()
  window.requestAnimationFrame = (callback) => request((now) => {
    const before = performance.now()
    callback(now)
    frames.set(now, (frames.get(now) ?? 0) + performance.now() - before)
  })
})()
"""


def bench(console: Console) -> bool:
    """Print script time and frame rate; return whether both are within their bounds."""
    with tempfile.TemporaryDirectory() as data, running_service(Path(data)) as service, chromium() as browser:
        page = browser.new_context(viewport=DESKTOP).new_page()
        page.add_init_script(_STOPWATCH)
        page.goto("about:blank")
        empty = empty_rate(page)
        operator = Operator(page, service)
        operator.sign_in()
        operator.be_in_run()
        page.get_by_role("combobox", name="Time window", exact=True).select_option(str(WINDOW_S))
        operator.enter("q_ref value [°]", 25.0)
        page.wait_for_timeout(FILLED_MS)
        frames, total = measured(page)
        add_panels(page)
        page.wait_for_timeout(FILLED_MS)
        more, _ = measured(page)
    rows = [*ratios(frames, total), *ratios_of_eight(more, empty)]
    return print_ratios(console, "Live page, software rendering", rows)


def empty_rate(page: Page) -> float:
    """Return the frames per second of a page that draws nothing."""
    page.evaluate("(() => { const again = () => requestAnimationFrame(again); again(); })()")
    page.wait_for_timeout(1000)
    page.evaluate("forgetFrames()")
    page.wait_for_timeout(MEASURED_MS)
    return rate_of(page.evaluate("frameTimes()"))


def rate_of(frames: list[float]) -> float:
    """Return the frames per second of the measured interval."""
    return len(frames) / (MEASURED_MS / 1000)


def add_panels(page: Page) -> None:
    """Extend the Standard layout to eight panels."""
    page.get_by_role("button", name="Edit layout", exact=True).click()
    editor = page.get_by_role("region", name="Layout editor", exact=True)
    for signal in ADDED:
        editor.get_by_role("button", name=f"New panel with {signal}", exact=True).click()
    page.get_by_role("button", name="Edit layout", exact=True).click()
    expect(page.locator("figure[data-panel]")).to_have_count(PANELS)


def measured(page: Page) -> tuple[list[float], float]:
    """Return the script time [ms] of the callbacks of each frame, and the total script time [ms]."""
    devtools = page.context.new_cdp_session(page)
    devtools.send("Performance.enable")
    page.evaluate("forgetFrames()")
    before = _script_ms(devtools)
    page.wait_for_timeout(MEASURED_MS)
    total = _script_ms(devtools) - before
    return [float(time) for time in page.evaluate("frameTimes()")], total


def _script_ms(devtools: CDPSession) -> float:
    metrics = devtools.send("Performance.getMetrics")["metrics"]
    return 1000.0 * float(next(metric["value"] for metric in metrics if metric["name"] == "ScriptDuration"))


def ratios(frames: list[float], total: float) -> list[Ratio]:
    """Return median and tail over the bound; other script time is distributed over the frames."""
    median = statistics.median(frames)
    p95 = sorted(frames)[int(0.95 * len(frames))]
    shared = total / len(frames)
    rate = rate_of(frames)
    unit = f"{SCRIPT_MS:g} ms"
    return [
        Ratio.at_most(
            f"median script time of a frame / {unit}", median / SCRIPT_MS, 1.0, f"{median:.2f} ms, {rate:.0f} frames/s"
        ),
        Ratio(f"95th percentile / {unit}", p95 / SCRIPT_MS, detail=f"{p95:.2f} ms"),
        Ratio(f"all script time per frame / {unit}", shared / SCRIPT_MS, detail=f"{shared:.2f} ms in the mean"),
    ]


def ratios_of_eight(frames: list[float], empty: float) -> list[Ratio]:
    """Return the rate with eight panels over that of an empty page, ``empty`` [1/s], and the script time."""
    rate = rate_of(frames)
    median = statistics.median(frames)
    return [
        Ratio.at_least(
            "frames with eight panels / frames of an empty page",
            rate / empty,
            OF_EMPTY_PAGE,
            f"{rate:.1f} and {empty:.1f} frames/s",
        ),
        Ratio(
            f"median script time with eight panels / {SCRIPT_MS:g} ms", median / SCRIPT_MS, detail=f"{median:.2f} ms"
        ),
    ]
