"""What the live page costs per frame: script time with all charts at 1 kHz over 60 s, without the 3D view."""

import statistics
import tempfile
from pathlib import Path

from playwright.sync_api import CDPSession, Page
from rich.console import Console

from tests.bench.table import Ratio, print_ratios
from tests.e2e.browser import DESKTOP, chromium
from tests.e2e.operator import Operator
from tests.e2e.service import running_service

SCRIPT_MS = 6.0
"""Most script time of a frame in the median."""

WINDOW_S = 60
FILLED_MS = (WINDOW_S + 2) * 1000
MEASURED_MS = 10_000

# Every callback of an animation frame is timed; those of one frame share its time stamp.
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
    """Print the script time per frame; whether its median keeps the bound."""
    with tempfile.TemporaryDirectory() as data, running_service(Path(data)) as service, chromium() as browser:
        page = browser.new_context(viewport=DESKTOP).new_page()
        page.add_init_script(_STOPWATCH)
        operator = Operator(page, service)
        operator.sign_in()
        operator.be_in_run()
        page.get_by_role("combobox", name="Window", exact=True).select_option(str(WINDOW_S))
        operator.enter("q_ref value [°]", 25.0)
        page.wait_for_timeout(FILLED_MS)
        frames, total = measured(page)
    return print_ratios(console, "Live page, software rendering", ratios(frames, total))


def measured(page: Page) -> tuple[list[float], float]:
    """Script time [ms] of each frame's callbacks, and all script time [ms] of the measured stretch."""
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
    """Median and tail over the bound; everything else that runs, messages and React, shared out to the frames."""
    median = statistics.median(frames)
    p95 = sorted(frames)[int(0.95 * len(frames))]
    shared = total / len(frames)
    rate = len(frames) / (MEASURED_MS / 1000)
    unit = f"{SCRIPT_MS:g} ms"
    return [
        Ratio.at_most(
            f"median script time of a frame / {unit}", median / SCRIPT_MS, 1.0, f"{median:.2f} ms, {rate:.0f} frames/s"
        ),
        Ratio(f"95th percentile / {unit}", p95 / SCRIPT_MS, detail=f"{p95:.2f} ms"),
        Ratio(f"all script time per frame / {unit}", shared / SCRIPT_MS, detail=f"{shared:.2f} ms in the mean"),
    ]
