"""The 3D view on the page: it shows the scene of viser, reconnects, and does not block the page."""

import io
import re

from PIL import Image
from playwright.sync_api import Browser, Error, Locator, Page, Route, expect

from tests.e2e.browser import DESKTOP
from tests.e2e.operator import MOTION_TIMEOUT_MS, Operator, kept
from tests.e2e.page_texts import load_texts
from tests.e2e.relay import relayed
from tests.e2e.service import Service

RUNS = load_texts("pages/runs")
SHARED = load_texts("components")

PICTURE_TIMEOUT_MS = 120_000
"""Long enough for a picture that the processor draws while it is busy with other things."""

SCENE = re.compile(r"/scene/\?")
ITS_PAGE = SHARED["sceneLoadingPage"]


def test_the_3d_view_shows_its_loading_state_and_a_failure(browser: Browser, service: Service) -> None:
    operator = Operator(browser.new_context(viewport=DESKTOP).new_page(), service)
    page = operator.page
    errors: list[Error] = []
    page.on("pageerror", lambda error: errors.append(error))
    asked: list[Route] = []
    page.route(SCENE, lambda route: asked.append(route))
    operator.sign_in()
    with page.expect_request(SCENE):
        show_in_3d(page)
    words = page.get_by_role("status", name="3D view status")
    expect(words).to_have_text(ITS_PAGE)
    operator.wait(lambda: len(asked) == 1)
    asked.pop().abort()
    expect(words).to_have_text(SHARED["sceneFailed"], timeout=MOTION_TIMEOUT_MS)
    assert errors == []
    with page.expect_request(SCENE):
        operator.press(SHARED["tryAgain"])
    expect(words).to_have_text(ITS_PAGE)
    operator.wait(lambda: len(asked) == 1)
    asked.pop().continue_()
    expect(words).to_be_empty(timeout=PICTURE_TIMEOUT_MS)
    assert colours(canvas_of(page, "3D view").screenshot()) > 100  # the text is empty because the picture is shown
    page.context.close()


def test_the_settings_of_the_3d_view_are_restored_on_another_machine(browser: Browser, service: Service) -> None:
    here = Operator(browser.new_context(viewport=DESKTOP).new_page(), service)
    here.page.route(SCENE, lambda _: None)  # this test does not check the picture
    here.sign_in()
    show_in_3d(here.page)
    with here.page.expect_response(kept("camera", "Springs")):
        here.page.get_by_role("combobox", name="Camera").select_option("Springs")
    here.page.context.close()
    there = Operator(browser.new_context(viewport=DESKTOP).new_page(), service)
    there.page.route(SCENE, lambda _: None)
    there.sign_in()
    expect(there.page.get_by_role("combobox", name="Camera")).to_have_value("Springs", timeout=MOTION_TIMEOUT_MS)
    expect(there.page.get_by_title("3D view", exact=True)).to_have_attribute("src", re.compile("Position=0.4,-5,-1.4"))
    with there.page.expect_response(kept("solid_unaided", False)):
        there.press("Show flat")
    there.page.reload()
    expect(there.page.get_by_role("button", name="Show in 3D")).to_be_enabled(timeout=MOTION_TIMEOUT_MS)
    there.page.context.close()


def test_the_3d_view_reconnects_after_a_connection_loss_and_shows_the_motion(operator: Operator) -> None:
    page = operator.page
    with relayed(operator.service) as (operator.service, relay):
        operator.sign_in()
        operator.be_in_run()
        show_in_3d(page)
        canvas = canvas_of(page, "3D view")
        wait_for_a_picture(operator, canvas)
        words = page.get_by_role("status", name="3D view status")
        expect(words).to_be_empty(timeout=PICTURE_TIMEOUT_MS)
        relay.hold("/scene")
        expect(words).to_have_text(SHARED["sceneLost"], timeout=MOTION_TIMEOUT_MS)
        relay.release()
        expect(words).to_be_empty(timeout=PICTURE_TIMEOUT_MS)
        wait_for_a_picture(operator, canvas)
        operator.be_in_run()  # without a GPU, the first picture may take so long that the page loses control
        before = canvas.screenshot()
        operator.enter("q_ref value [°]", 40.0)
        operator.wait(lambda: difference(before, canvas.screenshot()) > 0.01, PICTURE_TIMEOUT_MS)
        page.get_by_role("button", name="STOP", exact=True).click()
        operator.expect_mode("tripped")
        page.close()  # before the relay ends, so that no request fails


def test_a_run_is_replayed_in_3d(operator: Operator) -> None:
    page = operator.page
    operator.sign_in()
    operator.go("Runs")
    page.get_by_role("table", name=RUNS["table"], exact=True).get_by_role("link").first.click()
    replay = page.get_by_role("region", name=RUNS["replay"], exact=True)
    show_in_3d(page)
    canvas = canvas_of(page, RUNS["replayIn3D"])
    wait_for_a_picture(operator, canvas)
    position = page.get_by_role("slider", name=RUNS["replayPosition"], exact=True)
    position.press("Home")
    expect(replay.get_by_role("status", name=RUNS["replayTime"], exact=True)).to_have_text("0:00.00")
    operator.wait_for_samples(1000)
    before = canvas.screenshot()
    position.press("End")
    for _ in range(10):  # the end is one sample after the last sample
        position.press("ArrowLeft")
    operator.wait(lambda: difference(before, canvas.screenshot()) > 0.01, PICTURE_TIMEOUT_MS)


def show_in_3d(page: Page) -> None:
    """Press the button, unless the 3D view is open already."""
    button = page.get_by_role("button", name=re.compile("^Show (flat|in 3D)$"))
    expect(button).to_be_enabled(timeout=MOTION_TIMEOUT_MS)
    if button.inner_text() == "Show in 3D":
        button.click()
    expect(button).to_have_text("Show flat")


def canvas_of(page: Page, frame: str) -> Locator:
    """Return the canvas of viser once it exists."""
    canvas = page.frame_locator(f"iframe[title='{frame}']").locator("canvas").last
    expect(canvas).to_be_visible(timeout=PICTURE_TIMEOUT_MS)
    return canvas


def wait_for_a_picture(operator: Operator, canvas: Locator) -> None:
    """Wait until the canvas has more than one colour."""
    operator.wait(lambda: colours(canvas.screenshot()) > 100, PICTURE_TIMEOUT_MS)


def colours(picture: bytes) -> int:
    """Return the number of colours of a picture."""
    return len(set(Image.open(io.BytesIO(picture)).convert("RGB").get_flattened_data()))


def difference(one: bytes, other: bytes) -> float:
    """Return the share of pixels in which two pictures of one size differ."""
    first, second = (Image.open(io.BytesIO(picture)).convert("RGB").get_flattened_data() for picture in (one, other))
    return sum(a != b for a, b in zip(first, second, strict=True)) / len(first)
