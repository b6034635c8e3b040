"""The log on the page: each line is an entry of the service, and links to its time in the recording."""

import math
import re
from datetime import datetime
from typing import Any

import httpx
import pytest
from playwright.sync_api import Locator, Page, expect

from tests.e2e.operator import Operator
from tests.e2e.page_texts import load_texts
from tests.e2e.service import Service

SHARED = load_texts("components")

TEXTS = load_texts("pages/log")


@pytest.fixture(scope="module")
def service(fresh_service: Service) -> Service:
    return fresh_service


def log_entries(page: Page, query: str = "") -> list[dict[str, Any]]:
    """Return the entries of the service for the same query."""
    answer = page.evaluate(f"fetch('./api/log?limit=100{query}').then(answer => answer.json())")
    return list(answer["entries"])


def lines(page: Page) -> list[list[str]]:
    rows = page.get_by_role("table", name="Log").locator("tbody tr")
    return [[cell.strip() for cell in row] for row in rows.evaluate_all(CELLS)]


CELLS = "rows => rows.map(row => [...row.cells].map(cell => cell.innerText))"


def row_of(page: Page, text: str) -> Locator:
    return page.get_by_role("table", name="Log").get_by_role("row").filter(has_text=text).first


def test_log_entries_are_searched_annotated_and_linked_to_the_recording(operator: Operator) -> None:
    page = operator.page
    operator.sign_in()
    operator.be_in_run()
    operator.enter("q_ref value [°]", 15.0)
    operator.wait(lambda: abs(operator.reading("Joint position", "q") - 15.0) < 0.3)
    page.get_by_role("button", name=re.compile("^STOP")).click()
    operator.expect_mode("tripped")
    page.get_by_role("link", name=SHARED["events"]).click()  # the link in the fault banner
    expect(page.get_by_role("heading", level=1, name="Log")).to_be_attached()
    operator.press("Reset")
    operator.expect_mode("off")

    operator.wait(lambda: any(entry["flight"] for entry in log_entries(page)))  # written after its interval
    operator.wait(lambda: len(lines(page)) == len(log_entries(page)))
    told = log_entries(page)
    for line, entry in zip(lines(page), told, strict=True):
        assert line[0].endswith(f".{datetime.fromisoformat(entry['at']).microsecond // 1000:03d}")
        assert line[2] == shown(entry["text"])
        assert line[3] == (entry["who"] or TEXTS["bySystem"])
        place = "" if entry["run"] is None else f"Run {entry['run']}"
        at = "" if entry["t"] is None else f" at {entry['t']:.3f} s"
        assert line[4].startswith(place + at), entry
    assert {"run", "mode", "references", "trip", "access"} <= {entry["kind"] for entry in told}

    box = page.get_by_role("searchbox", name=TEXTS["searchLog"])
    box.fill("q_ref")
    expect(row_of(page, "q_ref 15°")).to_be_visible()
    operator.wait(lambda: len(lines(page)) == len(log_entries(page, "&words=q_ref")))
    box.fill("")
    page.get_by_label("Show").select_option("alarms")
    operator.wait(lambda: len(lines(page)) == len(log_entries(page, "&kind=fault&kind=trip&kind=recording")))
    trip = next(entry for entry in log_entries(page, "&kind=trip") if entry["run"] is not None)
    row = row_of(page, trip["text"])
    row.get_by_role("button", name=re.compile("^" + re.escape(TEXTS["edit"].split("{")[0]))).click()
    page.get_by_role("textbox", name=TEXTS["noteOfEvent"]).fill("on purpose")
    page.get_by_role("textbox", name=TEXTS["tagsOfEvent"]).fill("drill two words")
    page.get_by_role("button", name=TEXTS["save"], exact=True).click()
    expect(row).to_contain_text("on purpose")
    said = log_entries(page, "&words=on+purpose")
    assert [(entry["note"], entry["tags"]) for entry in said] == [("on purpose", ["drill", "two", "words"])]
    data = httpx.get(
        row.get_by_role("link", name=TEXTS["flightRecord"]).evaluate("a => a.href"),
        headers=bearer(operator),
        timeout=60.0,
    )
    assert data.status_code == 200
    assert data.text.startswith("#")

    row.get_by_role("link", name=re.compile("^Run")).click()
    expect(page.get_by_role("heading", level=1)).to_contain_text(f"Run {trip['run']}")
    replay = page.get_by_role("status", name=load_texts("pages/runs")["replayTime"])
    expect(replay).to_be_visible()
    minutes, seconds = replay.inner_text().split(":")
    assert 60 * int(minutes) + float(seconds) == pytest.approx(trip["t"], abs=0.01)


def shown(text: str) -> str:
    """Return a text with references in degrees; other texts contain no angles here."""
    found = re.fullmatch(r"q_ref ([-\d.]+)\srad(.*)", text)
    return text if found is None else f"q_ref {math.degrees(float(found[1])):.4g}°{found[2]}"


def bearer(operator: Operator) -> dict[str, str]:
    token = (operator.service.data / "token").read_text().strip()
    return {"Authorization": f"Bearer {token}"}


def test_a_search_without_matches_shows_an_empty_log(operator: Operator) -> None:
    page = operator.page
    operator.sign_in()
    operator.go("Log")
    expect(page.get_by_role("table", name="Log")).to_be_visible()
    expect(page.get_by_role("button", name=TEXTS["older"])).to_be_disabled()  # all entries fit on one page
    page.get_by_label("From", exact=True).fill("2001-01-01")
    page.get_by_label("To", exact=True).fill("2001-01-02")
    expect(page.get_by_text(TEXTS["noMatch"])).to_be_visible()
    page.get_by_role("button", name=TEXTS["clear"]).click()
    expect(page.get_by_role("table", name="Log")).to_be_visible()
