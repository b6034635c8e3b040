"""A viewer uses every control on every page: nothing is refused, and nothing changes.

Actions that a viewer may not perform are absent or have an explanation.
"""

import json
import re
import subprocess
import sys
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path
from typing import Any

import httpx
import pytest
from playwright.sync_api import Browser, Page, Request, Response, expect

from tests.api.conftest import client_with, until_state
from tests.e2e.browser import DESKTOP
from tests.e2e.service import Service, running_service
from tests.e2e.sharing import bring_to_run, sign_in_at
from tests.e2e.test_viewer import SEEN, signed_in_as_viewer
from tests.e2e.walk import OVERLAY, Found, controls, use

PAGES = (*SEEN, "runs/1", "runs/metrics", "glossary", "docs", "docs/first-hour")
MOST = 80
"""Of one page: the lists of glossary and docs are of one kind each."""

LEFT_ALONE = re.compile(r"STOP|Sign out")
"""STOP does change the state, and is a viewer's to press; who signs out walks no further."""

OWN = re.compile(
    r"/api/(preferences|session/name|experiments/(dry-run|check)|studies/check|(runs|flights)/\d+/replay)$"
)
"""What changes nothing that others see: preferences and name are a person's own, the others only answer or show."""

BARE = ("system/developer",)
"""For a viewer there is nothing to use on these."""

AROUND = "header, nav, section[aria-label=Tour], form[aria-label='Your name']"
LEFT_OUT = "_left_out_"
CLI_S = 300.0


@pytest.fixture(scope="module")
def service(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Service]:
    """A service with a usable identification, a bank, and a manual session."""
    data = tmp_path_factory.mktemp("data")
    identified(data)
    with running_service(data) as running:
        with client_with(running, "token") as script:
            (one,) = script.get("/api/identifications").raise_for_status().json()["identifications"]
            assert one["usable"]
            for name in ("walked", "other"):
                bank = {"name": name, "identifications": [one["id"]]}
                script.post("/api/banks", json=bank).raise_for_status()
            queued = {"name": "tracking", "settings": {}}
            script.post("/api/experiments/queue", json=queued).raise_for_status()
        bring_to_run(running, 0.2)
        yield running


def identified(data: Path) -> None:
    """Identify the actuator from the command line, faster than on the page."""
    settings = ("--set", "tension_N=20", "--set", "bits=6", "--set", "settle_s=3")
    words = [sys.executable, "-m", "backend", "identify", "actuator", *settings, "--data", str(data)]
    subprocess.run(words, check=True, capture_output=True, timeout=CLI_S)


class Refused:
    """The refused requests of a page, and its requests other than GET."""

    def __init__(self, page: Page) -> None:
        self.answers: list[str] = []
        self.sent: list[str] = []
        page.on("response", self._answered)
        page.on("request", self._asked)

    def _answered(self, answer: Response) -> None:
        if answer.status in (401, 403):
            self.answers.append(f"{answer.request.method} {answer.url}")

    def _asked(self, request: Request) -> None:
        if request.method != "GET" and not OWN.search(request.url):
            self.sent.append(f"{request.method} {request.url}")


def changeable_state(script: httpx.Client) -> dict[str, Any]:
    """Return all that a person could change, from the service."""
    state = script.get("/api/state").raise_for_status().json()
    kept = (
        "mode",
        "references",
        "tuning",
        "own_tuning",
        "earlier",
        "trial",
        "wall",
        "touch",
        "fault",
        "holder",
        "task",
    )
    told = {name: state[name] for name in kept}
    for path in ("banks", "experiments/queue", "identifications", "runs", "saved-searches", "studies", "tuning/saved"):
        told[path] = script.get(f"/api/{path}").raise_for_status().json()
    for run in told["runs"]["runs"]:  # a recording grows continuously
        for growing in ("duration_s", "samples", "bytes"):
            run.pop(growing, None)
    entries = script.get("/api/log?limit=50").raise_for_status().json()["entries"]
    told["log"] = [one for one in entries if one["kind"] != "access"]
    return told


def open_place(page: Page, service: Service, place: str) -> None:
    """Open a page without overlays, and wait until it is complete."""
    page.goto(f"{service.url}/#/{place}")
    expect(page.get_by_role("heading", level=1)).to_have_count(1)
    if place in SEEN:
        expect(page.get_by_role("main")).to_contain_text(re.compile(SEEN[place]))
    if place not in BARE:  # lists load after their headings
        used = page.get_by_role("main").locator("a, button, input, select")
        expect(used.locator("visible=true").first).to_be_visible()
    for _ in range(2):
        page.keyboard.press("Escape")


@pytest.fixture(scope="module")
def viewer(browser: Browser, service: Service) -> Iterator[Page]:
    page, _ = signed_in_as_viewer(browser, service)
    yield page
    page.context.close()


@pytest.mark.timeout(900)
@pytest.mark.parametrize("place", [*PAGES, LEFT_OUT])
def test_every_control_on_the_page_of_a_viewer_works_without_refusal(
    viewer: Page, service: Service, place: str
) -> None:
    """The frame around the pages is tested once, on a page that is otherwise unused."""
    frame = place == LEFT_OUT
    place, skipped = ("studies", "main") if frame else (place, AROUND)
    refused = Refused(viewer)
    with client_with(service, "token") as script:
        before = changeable_state(script)
        used: set[str] = set()
        worked = 0
        open_place(viewer, service, place)
        while (control := next_of(viewer, skipped, used)) is not None and len(used) < MOST:
            used.add(control.key)
            if control.href is not None and "/api/" in control.href:
                downloaded(service, control.href)
                worked += 1
                continue
            if not use(viewer, control):
                continue
            worked += 1
            viewer.wait_for_timeout(100)
            assert (refused.answers, refused.sent) == ([], []), f"{control.name!r} on {place} is refused or commands"
            if viewer.url != f"{service.url}/#/{place}":
                open_place(viewer, service, place)
            elif viewer.locator(OVERLAY).count() and control.kind != "button":
                viewer.keyboard.press("Escape")
        assert bool(used) == (place not in BARE)
        assert worked >= 0.7 * len(used), "most were gone before they could be used"
        assert differences(before, changeable_state(script)) == []


def next_of(page: Page, skipped: str, used: set[str]) -> Found | None:
    """Return an unused control that is enabled; controls of overlays come first."""
    found = [one for one in controls(page, skipped) if one.enabled and one.key not in used]
    return next((one for one in found if not LEFT_ALONE.search(one.name)), None)


def downloaded(service: Service, address: str) -> None:
    """Request the target of a link as a viewer, without storing it."""
    with (
        client_with(service, "viewer-token") as viewer,
        viewer.stream("GET", f"/{address.removeprefix('./')}", follow_redirects=True) as answer,
    ):
        assert answer.status_code == 200, f"{address}: {answer.status_code}"


def differences(before: dict[str, Any], after: dict[str, Any]) -> list[str]:
    """Return the names of changed values; the measured values of the joint may vary."""
    return [
        f"{name}: {json.dumps(before[name])} and {json.dumps(after[name])}"
        for name in before
        if before[name] != after[name]
    ]


def test_controls_disabled_only_for_viewers_state_the_reason(browser: Browser, viewer: Page, service: Service) -> None:
    """A control that is disabled for viewers is also disabled for operators, or states the reason."""
    with client_with(service, "token") as script:
        until_state(script, lambda told: told["holder"] is None, "somebody holds control")
    context = browser.new_context(viewport=DESKTOP)
    with closing(context):
        operator = context.new_page()
        sign_in_at(operator, service, "studies")
        for place in PAGES:
            open_place(viewer, service, place)
            open_place(operator, service, place)
            theirs = {one.key: one for one in controls(operator, AROUND)}
            dead = [
                one.name
                for one in controls(viewer, AROUND)
                if not one.enabled and one.key in theirs and theirs[one.key].enabled and not one.told
            ]
            assert dead == [], f"on {place} these are there for a viewer, and cannot be used: {dead}"
