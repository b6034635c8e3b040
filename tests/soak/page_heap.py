"""The live page left open: its JavaScript heap after garbage collection does not grow."""

import tempfile
import time
from pathlib import Path

from playwright.sync_api import CDPSession, expect
from rich.console import Console

from tests.e2e.browser import DESKTOP, chromium
from tests.e2e.operator import Operator
from tests.e2e.service import running_service

WINDOW_S = 60
MOST_GROWTH_MB = 10.0
FILLED_S = WINDOW_S + 5
"""Before the first look: the window has filled, so that what follows is no filling of stores."""
STEP_S = 10.0
"""The joint moves to and fro, every so often."""

_MB = 1e6


def streaming_page(minutes: float, console: Console) -> bool:
    """Observe the page for ``minutes`` with a window of 60 s; return whether heap and charts are as required."""
    with tempfile.TemporaryDirectory() as data, running_service(Path(data)) as service, chromium() as browser:
        page = browser.new_context(viewport=DESKTOP).new_page()
        operator = Operator(page, service)
        operator.sign_in()
        operator.be_in_run()
        page.get_by_role("combobox", name="Window", exact=True).select_option(str(WINDOW_S))
        devtools = page.context.new_cdp_session(page)
        _move(operator, FILLED_S)
        heap = [heap_MB(devtools)]
        ending = time.monotonic() + 60.0 * minutes
        while time.monotonic() < ending:
            _move(operator, 2.0 * STEP_S)
            heap.append(heap_MB(devtools))
        expect(page.get_by_role("region", name="Charts", exact=True)).to_have_attribute("data-stale", "false")
    growth = heap[-1] - heap[0]
    met = growth < MOST_GROWTH_MB
    console.print(
        f"page open for {minutes:g} min after its {WINDOW_S} s window had filled: heap {heap[0]:.1f} MB at first, "
        f"{max(heap):.1f} MB at most, {heap[-1]:.1f} MB at last: {growth:+.1f} MB, "
        f"{'within' if met else 'MORE THAN'} {MOST_GROWTH_MB:g} MB"
    )
    return met


def _move(operator: Operator, seconds: float) -> None:
    """Step the joint back and forth; the boxes and previews of the page are used as by a person."""
    ending, side = time.monotonic() + seconds, 1.0
    while time.monotonic() < ending:
        operator.enter("q_ref value [°]", 15.0 * side)
        operator.page.wait_for_timeout(1000.0 * min(STEP_S, max(0.0, ending - time.monotonic())))
        side = -side


def heap_MB(devtools: CDPSession) -> float:
    """Return the used heap after a garbage collection, including array buffers."""
    devtools.send("HeapProfiler.collectGarbage")
    usage = devtools.send("Runtime.getHeapUsage")
    return float(usage["usedSize"] + usage.get("backingStorageSize", 0)) / _MB
