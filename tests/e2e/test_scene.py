"""The 3D view in the page: it shows what viser draws and leaves the page able to act."""

import io

from PIL import Image
from playwright.sync_api import expect

from tests.e2e.operator import MOTION_TIMEOUT_MS, Operator


def test_the_actuator_is_drawn_and_stop_still_acts(operator: Operator) -> None:
    page = operator.page
    operator.sign_in()
    operator.bring_up()
    page.get_by_role("button", name="Show in 3D", exact=True).click()
    canvas = page.frame_locator("iframe[title='3D view']").locator("canvas").last
    expect(canvas).to_be_visible(timeout=MOTION_TIMEOUT_MS)
    operator.wait(lambda: colours(canvas.screenshot()) > 100)
    page.get_by_role("button", name="STOP", exact=True).click()
    operator.expect_mode("tripped")


def colours(picture: bytes) -> int:
    """How many colours a picture has: an empty canvas has one."""
    return len(set(Image.open(io.BytesIO(picture)).convert("RGB").get_flattened_data()))
