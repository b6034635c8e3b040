"""Eight panels over the live stream: frames per second, script per frame, and the heap of the page."""

import tempfile
import time
from pathlib import Path
from typing import Any

from playwright.sync_api import CDPSession
from rich.console import Console

from tests.api.conftest import client_with
from tests.e2e.browser import DESKTOP, chromium
from tests.e2e.operator import Operator
from tests.e2e.service import running_service
from tests.soak.page_heap import heap_MB

MOST_SCRIPT_MS = 6.0
MOST_GROWTH_MB = 10.0
WINDOW_S = 20.0
FILLED_S = WINDOW_S + 5.0
"""Before the first look: what follows is no filling of stores."""

SIGNALS = (
    ("q_ref", "q"),
    ("q - q_ref",),
    ("S_ref", "S"),
    ("S - S_ref",),
    ("F_A", "F_B"),
    ("u_A", "u_B"),
    ("q_dot",),
    ("lateness_s",),
)
_COUNT_FRAMES = """() => {
    window.framesSeen = 0;
    const count = () => { window.framesSeen += 1; requestAnimationFrame(count); };
    requestAnimationFrame(count);
}"""


def eight_panels(minutes: float, console: Console) -> bool:
    """Watch eight panels for ``minutes``; whether script and heap keep their bounds.

    How many frames a second there are is told, not judged: a browser without a graphics processor paints on the cores
    that everything else runs on.
    """
    panels = [
        {"title": f"panel {number}", "signals": list(names), "over": None, "share": 1.0}
        for number, names in enumerate(SIGNALS, 1)
    ]
    with tempfile.TemporaryDirectory() as data, running_service(Path(data)) as service, chromium() as browser:
        with client_with(service, "token") as script:
            liked = script.get("/api/preferences").raise_for_status().json()
            own = {"version": 1, "name": "Eight", "panels": panels}
            wanted = liked | {"layout": "Eight", "layouts": [own], "window_s": WINDOW_S}
            script.put("/api/preferences", json=wanted).raise_for_status()
        page = browser.new_context(viewport=DESKTOP).new_page()
        operator = Operator(page, service)
        operator.sign_in()
        page.get_by_role("figure", name="panel 8", exact=True).wait_for()
        devtools = page.context.new_cdp_session(page)
        devtools.send("Performance.enable")
        page.evaluate(_COUNT_FRAMES)
        page.wait_for_timeout(1000.0 * FILLED_S)
        heap, before, begun = heap_MB(devtools), _counters(devtools), time.monotonic()
        frames = int(page.evaluate("window.framesSeen"))
        page.wait_for_timeout(60_000.0 * minutes)
        frames = int(page.evaluate("window.framesSeen")) - frames
        seconds, after = time.monotonic() - begun, _counters(devtools)
        growth = heap_MB(devtools) - heap
    script_ms = 1000.0 * (after["ScriptDuration"] - before["ScriptDuration"]) / max(frames, 1)
    task_ms = 1000.0 * (after["TaskDuration"] - before["TaskDuration"]) / max(frames, 1)
    met = script_ms <= MOST_SCRIPT_MS and growth <= MOST_GROWTH_MB
    console.print(
        f"eight panels for {minutes:g} min: {frames / seconds:.1f} frames/s, script {script_ms:.2f} ms per frame "
        f"(all work of the page {task_ms:.2f} ms), heap {growth:+.1f} MB: "
        f"{'within' if met else 'MORE THAN'} {MOST_SCRIPT_MS:g} ms and {MOST_GROWTH_MB:g} MB"
    )
    return met


def _counters(devtools: CDPSession) -> dict[str, float]:
    told: dict[str, Any] = devtools.send("Performance.getMetrics")
    return {one["name"]: float(one["value"]) for one in told["metrics"]}
