"""A report in a browser: figures can be enlarged by pointer or keyboard, and no script runs."""

from playwright.sync_api import Browser

from backend.reports.experiment_report import tracking_report
from backend.reports.model import to_html
from tests.reports.tracking_run import PLAN, samples, source_of


def test_a_figure_of_a_report_can_be_enlarged_and_is_printed_completely(browser: Browser) -> None:
    context = browser.new_context(viewport={"width": 1000, "height": 900}, java_script_enabled=False)
    page = context.new_page()
    page.set_content(to_html(tracking_report(source_of(samples(PLAN)))))
    figure = page.locator("figure").first
    drawing, sheet = figure.locator("svg"), figure.get_by_role("region", name="Figure 1")

    def width() -> float:
        box = drawing.bounding_box()
        assert box is not None
        return box["width"]

    whole = width()
    for size in (2, 4, 8):
        figure.get_by_text(f"{size}×").click()
        assert abs(width() / whole - size) < 0.01
        box = sheet.bounding_box()
        assert box is not None
        assert box["width"] < 1.01 * whole  # the sheet scrolls, and the width of the page is constant
    figure.get_by_label("8×").press("ArrowLeft")
    assert abs(width() / whole - 4) < 0.01
    page.emulate_media(media="print")
    assert not figure.get_by_text("4×").is_visible()
    assert width() < 1.3 * whole  # the window has the width of the paper
    context.close()
