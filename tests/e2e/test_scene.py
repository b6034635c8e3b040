"""The 3D view in the page: it shows what viser draws, comes back after a drop, and leaves the page able to act."""

import io

from PIL import Image
from playwright.sync_api import Locator, Page, expect

from tests.e2e.operator import MOTION_TIMEOUT_MS, Operator
from tests.e2e.relay import relayed


def test_the_actuator_is_drawn_and_stop_still_acts(operator: Operator) -> None:
    page = operator.page
    operator.sign_in()
    operator.bring_up()
    page.get_by_role("button", name="Show in 3D", exact=True).click()
    operator.wait(lambda: colours(canvas_of(page, "3D view").screenshot()) > 100)
    page.get_by_role("button", name="STOP", exact=True).click()
    operator.expect_mode("tripped")


def test_the_view_comes_back_after_a_drop_and_shows_what_moves(operator: Operator) -> None:
    page = operator.page
    with relayed(operator.service) as (operator.service, relay):
        operator.sign_in()
        operator.be_in_run()
        page.get_by_role("button", name="Show in 3D", exact=True).click()
        canvas = canvas_of(page, "3D view")
        operator.wait(lambda: colours(canvas.screenshot()) > 100)
        begun = relay.count("/scene")
        relay.cut("/scene")
        operator.wait(lambda: relay.count("/scene") > begun)
        operator.wait(lambda: colours(canvas.screenshot()) > 100)
        before = canvas.screenshot()
        operator.enter("q_ref value [deg]", 40.0)
        operator.wait(lambda: difference(before, canvas.screenshot()) > 0.01)
        page.get_by_role("button", name="STOP", exact=True).click()
        operator.expect_mode("tripped")


def test_a_run_is_replayed_in_3d(operator: Operator) -> None:
    page = operator.page
    operator.sign_in()
    operator.go("Runs")
    page.get_by_role("table", name="Runs", exact=True).get_by_role("link").first.click()
    replay = page.get_by_role("region", name="Replay", exact=True)
    replay.get_by_role("button", name="Show in 3D", exact=True).click()
    canvas = canvas_of(page, "3D view of the replay")
    operator.wait(lambda: colours(canvas.screenshot()) > 100)
    position = page.get_by_role("slider", name="Replay position", exact=True)
    position.press("Home")
    expect(replay.get_by_role("status", name="Replay time", exact=True)).to_have_text("0:00.00")
    operator.wait_for_samples(1000)
    before = canvas.screenshot()
    position.press("End")
    for _ in range(10):  # the end itself is a sample later than the last
        position.press("ArrowLeft")
    operator.wait(lambda: difference(before, canvas.screenshot()) > 0.01)


def canvas_of(page: Page, frame: str) -> Locator:
    """Where viser draws, once it is there."""
    canvas = page.frame_locator(f"iframe[title='{frame}']").locator("canvas").last
    expect(canvas).to_be_visible(timeout=MOTION_TIMEOUT_MS)
    return canvas


def colours(picture: bytes) -> int:
    """How many colours a picture has: an empty canvas has one."""
    return len(set(Image.open(io.BytesIO(picture)).convert("RGB").get_flattened_data()))


def difference(one: bytes, other: bytes) -> float:
    """Share of the points in which two pictures of one size differ."""
    first, second = (Image.open(io.BytesIO(picture)).convert("RGB").get_flattened_data() for picture in (one, other))
    return sum(a != b for a, b in zip(first, second, strict=True)) / len(first)
