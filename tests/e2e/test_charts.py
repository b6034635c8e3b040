"""Operation of the live charts: zoom, hold, cursors, statistics, spectrum, files, stored colours."""

import csv
import io
import re

import pytest
from PIL import Image
from playwright.sync_api import Page, expect

from tests.e2e.operator import MOTION_TIMEOUT_MS, Operator, kept
from tests.e2e.page_texts import load_texts

CHARTS = load_texts("charts")
OPERATE = load_texts("pages/operate")
HELD, FOLLOWING = (OPERATE[name].partition(",")[0] for name in ("held", "following"))


@pytest.fixture
def watching(same_operator: Operator) -> Operator:
    """An operator in mode Run, with the pointer outside of the charts."""
    page = same_operator.page
    page.mouse.move(5, 5)
    same_operator.be_in_run()
    in_sight = page.get_by_role("status", name="View", exact=True)
    expect(in_sight).to_have_text(re.compile(f"{HELD}|{FOLLOWING}"))
    if HELD in in_sight.inner_text():
        same_operator.press("Live")
    return same_operator


@pytest.fixture
def moving(watching: Operator) -> Operator:
    """An operator whose joint has just moved by 10 degrees."""
    target = 10.0 if abs(watching.reading("Joint position", "q_ref")) < 5.0 else 0.0
    watching.enter("q_ref value [°]", target)
    watching.wait(lambda: abs(watching.reading("Joint position", "q") - target) < 0.3)
    return watching


def test_zoom_and_hold_persist_during_streaming_and_live_resets_them(moving: Operator) -> None:
    page = moving.page
    page.get_by_role("button", name="Hold", exact=True).click()
    wheel(page, -400)
    in_sight = page.get_by_role("status", name="View", exact=True)
    expect(in_sight).to_have_text(re.compile(HELD + r", (?!20\.0 s)"))  # the page has processed the wheel
    zoomed = in_sight.inner_text()
    zoomed = zoomed[zoomed.index(HELD) :]  # on a busy machine the text begins with the delay of the page
    before = fresh_picture(moving)
    ticks = moving.wait_for_samples(500)
    assert ticks >= 500
    assert fresh_picture(moving) == before
    assert in_sight.inner_text().endswith(zoomed)

    page.get_by_role("button", name="Live", exact=True).click()
    expect(in_sight).to_contain_text(FOLLOWING)
    moving.wait(lambda: moving.picture("Joint position") != before)
    page.mouse.dblclick(*middle_of_a_chart(page))
    expect(in_sight).to_contain_text("20.0 s")


def test_b_selects_axes_over_a_chart_and_opens_banks_elsewhere(watching: Operator) -> None:
    page = watching.page
    page.evaluate("document.activeElement.blur()")
    page.mouse.move(*middle_of_a_chart(page))
    page.keyboard.press("b")
    expect(page.get_by_role("heading", level=1, name="Operate")).to_be_attached()
    page.mouse.move(5, 5)
    page.keyboard.press("b")
    expect(page.get_by_role("heading", level=1, name="Banks")).to_be_attached()


def test_two_cursors_measure_time_and_value_and_follow_the_arrow_keys(watching: Operator) -> None:
    page = watching.page
    measure, both = page.get_by_role("button", name="Measure", exact=True), page.locator("[data-role=delta-q]")
    first = page.locator("[data-role=cursor-0]")

    def is_measured() -> bool:
        """Hold and measure the visible interval; a page opened a moment ago has no data at the first cursor."""
        if measure.get_attribute("aria-pressed") == "true":
            measure.click()
            watching.press("Live")
        before = str(first.get_attribute("aria-valuenow"))
        measure.click()
        expect(first).not_to_have_attribute("aria-valuenow", before)
        return both.inner_text().startswith("Δ")

    watching.wait(is_measured)
    delta = page.locator("[data-role=delta-t]")
    expect(delta).to_contain_text("Δt 6.000 s")
    page.get_by_role("slider", name="Measuring cursor 2 [s]").press("ArrowRight")
    expect(delta).to_contain_text("Δt 6.100 s")
    page.keyboard.press("m")
    expect(delta).to_be_hidden()


def test_statistics_cover_the_visible_interval_and_stay_open_after_a_reload(moving: Operator) -> None:
    page = moving.page
    with page.expect_response(kept("statistics", True)):
        page.get_by_role("button", name="Statistics", exact=True).click()
    table = page.get_by_role("table", name="Statistics", exact=True)
    row = table.get_by_role("row").filter(has=page.get_by_role("rowheader", name="qref"))
    moving.wait(lambda: "10.00" in row.inner_text(), MOTION_TIMEOUT_MS)
    page.reload()
    expect(table).to_be_visible(timeout=MOTION_TIMEOUT_MS)
    page.get_by_role("button", name="Statistics", exact=True).click()
    expect(table).to_be_hidden()


def test_the_spectrum_dialog_shows_the_selected_chart(watching: Operator) -> None:
    page = watching.page
    page.get_by_role("button", name="Spectrum", exact=True).click()
    dialog = page.get_by_role("dialog", name="Spectrum", exact=True)
    expect(dialog.get_by_role("img", name="Spectrum of Joint position")).to_be_visible()
    expect(dialog.get_by_role("status", name="Spectrum details")).to_contain_text("(°)²/Hz")
    dialog.get_by_role("combobox", name="Chart").select_option("Tendon force")
    dialog.get_by_text("Amplitude", exact=True).click()
    expect(dialog.get_by_role("status", name="Spectrum details")).to_contain_text("N vs Hz")
    page.keyboard.press("Escape")
    expect(dialog).to_be_hidden()


def test_saved_picture_and_data_contain_the_visible_interval(moving: Operator) -> None:
    page = moving.page
    with page.expect_download() as download:
        page.get_by_role("button", name="Save data", exact=True).click()
    rows = list(csv.DictReader(io.StringIO(download.value.path().read_text(encoding="utf-8"))))
    times = [float(row["t [s]"]) for row in rows]
    assert times[1] - times[0] == pytest.approx(0.001, abs=1e-6)
    assert times[-1] - times[0] <= 20.01
    told = [(float(row["q_ref [rad]"]), float(row["q [rad]"])) for row in rows if row["q_ref [rad]"]]
    before = max(place for place, (q_ref, _) in enumerate(told) if abs(q_ref - told[-1][0]) > 0.1)
    q = [q for _, q in told[before:]]  # earlier motions are visible too
    assert max(q) - min(q) == pytest.approx(0.1745, abs=0.05)

    page.get_by_role("button", name="Save picture", exact=True).click()
    with page.expect_download() as download:
        page.get_by_role("menuitem", name=re.compile("PNG")).click()
    picture = Image.open(download.value.path())
    assert picture.width == round(180 / 25.4 * 300)
    assert picture.format == "PNG"
    assert len(set(picture.convert("RGB").get_flattened_data())) > 8


def test_colours_and_hidden_signals_are_stored_per_person(watching: Operator) -> None:
    page = watching.page
    page.get_by_role("button", name="Colour of q", exact=True).click()
    page.get_by_role("button", name="Colour #D55E00", exact=True).click()
    with page.expect_response(kept("hidden", ["F_B"])):
        watching.legend("Tendon force", "F_B").click()
    page.evaluate("localStorage.clear()")
    page.reload()
    line = page.get_by_role("button", name="Colour of q_ref", exact=True).locator("line")
    expect(line).to_have_css("stroke", "rgb(213, 94, 0)", timeout=MOTION_TIMEOUT_MS)
    expect(watching.legend("Tendon force", "F_B")).to_have_attribute("aria-pressed", "false")
    page.get_by_role("button", name="Colour of q", exact=True).click()
    page.get_by_role("button", name=CHARTS["defaultColour"], exact=True).click()
    expect(line).to_have_css("stroke", "rgb(0, 114, 178)")
    watching.legend("Tendon force", "F_B").click()


def fresh_picture(operator: Operator) -> bytes:
    """Return a chart that is not greyed for late samples, once two successive pictures are equal."""
    charts = operator.page.get_by_role("region", name="Charts", exact=True)
    pictures = [operator.picture("Joint position")]

    def is_still() -> bool:
        pictures.append(operator.picture("Joint position"))
        return charts.get_attribute("data-stale") == "false" and pictures[-1] == pictures[-2]

    operator.wait(is_still)
    return pictures[-1]


def middle_of_a_chart(page: Page) -> tuple[float, float]:
    box = page.get_by_role("figure", name="Joint position", exact=True).bounding_box()
    assert box is not None
    return box["x"] + 0.6 * box["width"], box["y"] + 0.6 * box["height"]


def wheel(page: Page, by: float) -> None:
    page.mouse.move(*middle_of_a_chart(page))
    page.keyboard.down("Control")
    page.mouse.wheel(0, by)
    page.keyboard.up("Control")
