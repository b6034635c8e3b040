"""States after the work: stored runs, a trip, a viewer, a service that does not respond."""

import os
import signal

from playwright.sync_api import Browser, expect

from tests.e2e.looks.pages import Look, settled, visit
from tests.e2e.operator import Operator
from tests.e2e.page_texts import load_texts
from tests.e2e.service import Service
from tests.e2e.test_viewer import signed_in_as_viewer

STUDY_TEXTS = load_texts("pages/studies")


def look_back(operator: Operator, look: Look) -> None:
    """Show one run, its replay, its comparison with another run, all metrics, a completed study, a document."""
    page = operator.page
    found = page.request.get(f"{operator.service.url}/api/runs?kind=tracking").json()["runs"]
    tracked = [run["id"] for run in found]
    for address, name in (
        (f"runs/{tracked[0]}", "run"),
        (f"runs/{tracked[0]}/{tracked[-1]}", "runs-compared"),
        ("runs/metrics", "runs-metrics"),
        ("docs/first-hour", "document"),
    ):
        visit(operator, address)
        if name == "runs-compared":  # below what the first of them came to
            page.get_by_role("region", name=load_texts("pages/runs")["curves"], exact=True).evaluate(
                "card => card.scrollIntoView()"
            )
        look(page, name)
    visit(operator, "studies")
    page.get_by_role("table", name=STUDY_TEXTS["title"], exact=True).get_by_role("link").first.click()
    maps = page.get_by_role("region", name="Maps", exact=True)
    expect(maps.get_by_role("figure").first).to_be_visible()
    settled(page)
    look(page, "study")


def trip(operator: Operator, look: Look) -> None:
    """Press STOP during motion; show each page that changes, and the flight record."""
    page = operator.page
    operator.be_in_run()
    operator.enter("q_ref value [°]", 20.0)
    operator.wait_for_samples(500)
    page.get_by_role("button", name="STOP", exact=True).click()
    operator.expect_mode("tripped")
    record = page.get_by_role("link", name="Flight record", exact=True)
    expect(record).to_be_visible()
    look(page, "operate-tripped")
    for name in ("identify", "banks", "experiments", "studies", "runs", "log", "system"):
        visit(operator, name)
        look(page, f"{name}-tripped")
    record.click()
    expect(page.get_by_role("region", name=load_texts("pages/runs")["trip"], exact=True)).to_be_visible()
    settled(page)
    look(page, "flight")


def watch(browser: Browser, service: Service, look: Look) -> None:
    """Show the pages of a viewer, and the page while the service does not respond."""
    page, _ = signed_in_as_viewer(browser, service)
    viewer = Operator(page, service)
    for name in ("operate", "identify", "banks", "experiments", "system"):
        visit(viewer, name)
        look(page, f"{name}-viewer")
    visit(viewer, "operate")
    os.kill(service.pid, signal.SIGSTOP)
    try:
        expect(page.get_by_role("status", name="Link", exact=True)).not_to_have_attribute("data-health", "live")
        look(page, "operate-no-answer")
    finally:
        os.kill(service.pid, signal.SIGCONT)
    page.context.close()
