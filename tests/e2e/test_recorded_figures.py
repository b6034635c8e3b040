"""A run of ten minutes on the page: statistics, cursors, spectrum and saved data use every sample."""

import csv
import io
import math
import re
from collections.abc import Iterator
from contextlib import closing
from datetime import timedelta

import numpy as np
import pytest
from numpy.typing import NDArray
from playwright.sync_api import Page, Route, expect

from backend.storage import events, runs
from backend.storage.database import open_database
from tests.e2e.forms import REPORT_TIMEOUT_MS
from tests.e2e.operator import Operator
from tests.e2e.page_texts import load_texts
from tests.e2e.service import Service, running_service
from tests.recording.stored_run import FIRST_TICK, store_run

CHARTS = load_texts("charts")

COUNT = 600_000
DEG = 180.0 / math.pi
LONG_TEXT = "a push of 5.0 N that is written down with more words than fit above a chart"
EVENTS = {200.0: "first of three", 200.2: "second of three", 200.4: LONG_TEXT, 400.0: "alone"}


def made_up() -> dict[str, NDArray[np.float64]]:
    t = np.arange(COUNT) * 1e-3
    q = 0.5 * np.sin(2 * np.pi * 0.0513 * t) + 0.05 * np.sin(2 * np.pi * 3.0 * t)
    q[123_456] = 1.5  # one sample only
    S = np.where(t < 60.0, np.nan, 9.0 + np.sin(2 * np.pi * 20.0 * t))
    return {"q": q, "q_ref": np.round(q, 1), "S": S}


@pytest.fixture(scope="module")
def service(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Service]:
    data = tmp_path_factory.mktemp("figures")
    with closing(open_database(data)) as database:
        run_id = store_run(database, made_up())
        with database.session() as session:
            for at_s, text in EVENTS.items():
                at = runs.get(session, run_id).started_at + timedelta(microseconds=at_s)
                events.add(session, "push", text, run_id=run_id, tick=FIRST_TICK + round(1e3 * at_s), at=at)
    with running_service(data) as running:
        yield running


@pytest.fixture
def page(operator: Operator) -> Page:
    operator.sign_in()
    operator.page.goto(f"{operator.service.url}/#/runs/1")
    expect(operator.page.get_by_role("figure", name="Joint position", exact=True)).to_be_visible()
    return operator.page


def test_figures_of_a_ten_minute_run_are_computed_from_every_sample(page: Page) -> None:
    columns = {name: column.astype(np.float32).astype(float) for name, column in made_up().items()}
    _statistics(page, columns)
    _cursors(page, columns)
    _spectrum(page)
    _data(page, columns)
    _events(page)


def _statistics(page: Page, columns: dict[str, NDArray[np.float64]]) -> None:
    page.get_by_role("button", name="Statistics", exact=True).click()
    facts = page.get_by_role("status", name="Statistics details")
    expect(facts).to_have_text("From every sample between 0:00.000 and 9:59.999: 600\u202f000 samples.")
    for name, column, factor, decimals in (("q", columns["q"], DEG, 2), ("S", columns["S"], 1.0, 2)):
        there = factor * column[np.isfinite(column)]
        wanted = [
            (there.min(), decimals),
            (there.max(), decimals),
            (there.mean(), decimals),
            (there.std(), decimals + 1),
        ]
        row = page.get_by_role("table", name="Statistics").get_by_role("row")
        cells = row.filter(has=page.get_by_role("rowheader", name=name, exact=True)).first.get_by_role("cell")
        told = [text.replace("\u2212", "-").split("\n") for text in cells.all_inner_texts()]
        assert int(told[0][0].replace("\u202f", "")) == there.size
        for (first, *_), (value, digits) in zip(told[1:5], wanted, strict=True):
            assert float(first) == pytest.approx(value, abs=0.51 * 10.0**-digits)
        if name == "q":
            assert told[2][1] == "2:03.456"
        else:
            assert told[0][1] == CHARTS["withoutValue"].replace("{count}", "60\u202f000")


def _cursors(page: Page, columns: dict[str, NDArray[np.float64]]) -> None:
    page.get_by_role("button", name="Measure", exact=True).click()
    at = [float(str(page.locator(f"[data-role=cursor-{n}]").get_attribute("aria-valuenow"))) for n in (0, 1)]
    values = [DEG * columns["q"][math.floor(1e3 * time_s + 1e-6)] for time_s in at]
    told = [f"1: {values[0]:.2f}", f"2: {values[1]:.2f}", f"Δ {values[1] - values[0]:.2f}"]
    for role, text in zip(("cursor-0-q", "cursor-1-q", "delta-q"), told, strict=True):
        expect(page.locator(f"[data-role={role}]").first).to_have_text(text.replace("-", "\u2212"))
    expect(page.locator("[data-role=cursor-0-time]")).to_have_text(re.compile(r"1 +3:30\.0"))
    page.get_by_role("button", name="Measure", exact=True).click()


def _spectrum(page: Page) -> None:
    """The spectrum shows its progress, can be closed during the computation, and covers the complete range."""
    held = "**/api/runs/1/spectra*"
    waiting: list[Route] = []
    page.route(held, lambda route: waiting.append(route))
    page.get_by_role("button", name="Spectrum", exact=True).click()
    dialog = page.get_by_role("dialog", name="Spectrum", exact=True)
    expect(dialog.get_by_role("progressbar", name="Spectrum progress")).to_be_attached()
    expect(dialog).to_contain_text("Reading every sample of the range: 0 %")
    with page.expect_event("requestfailed", lambda request: "/spectra" in request.url):
        page.keyboard.press("Escape")
    expect(dialog).to_be_hidden()
    page.unroute(held)
    page.get_by_role("button", name="Spectrum", exact=True).click()
    facts = dialog.get_by_role("status", name="Spectrum details")
    expect(facts).to_contain_text("600\u202f000 samples")
    windows = CHARTS["windows"].partition(" ")[2].format(length="32\u202f768", step="0.0305")
    expect(facts).to_contain_text(windows)
    expect(dialog.get_by_role("img", name="Spectrum of Joint position")).to_be_visible()
    page.keyboard.press("Escape")


def _data(page: Page, columns: dict[str, NDArray[np.float64]]) -> None:
    with page.expect_download(timeout=REPORT_TIMEOUT_MS) as download:
        page.get_by_role("button", name="Save data", exact=True).click()
    assert download.value.suggested_filename == "sinew-run-1-0.000-to-599.999-s.csv"
    lines = download.value.path().read_text(encoding="utf-8").splitlines()
    rows = csv.DictReader(io.StringIO("\n".join(line for line in lines if not line.startswith("#"))))
    q = np.array([float(row["q"]) for row in rows])
    np.testing.assert_array_equal(q.astype(np.float32), columns["q"].astype(np.float32))


def _events(page: Page) -> None:
    """The pointer shows each event in full, also events that are too close for a label."""
    chart = page.get_by_role("figure", name="Joint position", exact=True)
    chart.scroll_into_view_if_needed()
    figure = chart.bounding_box()
    area = page.locator("[data-role=hover]").locator("..").bounding_box()
    assert figure is not None
    assert area is not None
    page.mouse.move(area["x"] + area["width"] * 200.2 / 600.0, figure["y"] + 0.6 * figure["height"])
    told = page.locator("[data-role=marks]")
    expect(told).to_be_visible()
    assert told.inner_text().splitlines() == [
        "3:20.000  first of three",
        "3:20.200  second of three",
        f"3:20.400  {LONG_TEXT}",
    ]
    expect(page.locator("[data-role=hover-time]")).to_have_text(re.compile(r"3:(19|20)\.\d{3}"))
