"""The page Operate on small windows: every chart is accessible, legends are complete, nothing is covered."""

from functools import partial
from itertools import combinations, pairwise

from playwright.sync_api import Browser, Page, ViewportSize, expect

from tests.e2e.layout import Box, covered, cut, document_scrolls_by, scrolled_page, sideways, stays, survey
from tests.e2e.operator import MOTION_TIMEOUT_MS, Operator
from tests.e2e.service import Service

PHONE = ViewportSize(width=390, height=844)
SIZES = {
    "1440x900 at 200 %, as WCAG 1.4.4 asks for it": ViewportSize(width=720, height=450),
    "low": ViewportSize(width=1440, height=500),
    "phone": PHONE,
    "tablet": ViewportSize(width=1024, height=768),
}
CHARTS = [f"main figure[aria-label='{name}']" for name in ("Joint position", "Joint stiffness", "Tendon force")]
CHARTS.append("main figure[aria-label='Motor voltage']")
VIEWS = [f"main section[aria-label='{name}']" for name in ("Actuator", "Reachable map")]
CONTROLS = [f"main section[aria-label='{name}']" for name in ("Mode", "References", "Tuning")]
TOOLS, FIGURES, STOP = "main [role=toolbar]", "main table[aria-label=Statistics]", "button[aria-label=STOP]"
LEAST_CHART_PX = 40
"""Below this height a curve says nothing."""


def test_every_chart_can_be_scrolled_into_view_and_nothing_is_covered(operator: Operator) -> None:
    page = operator.page
    operator.sign_in()
    operator.go("Operate")
    expect(page.get_by_role("slider", name="λ_q", exact=True)).to_be_attached(timeout=MOTION_TIMEOUT_MS)
    statistics = page.get_by_role("button", name="Statistics")
    wrong: dict[str, list[str]] = {}
    for pressed in ("false", "true"):
        if statistics.get_attribute("aria-pressed") != pressed:
            statistics.click()
        expect(statistics).to_have_attribute("aria-pressed", pressed)
        for name, size in SIZES.items():
            page.set_viewport_size(size)
            wrong[f"{name}, statistics {pressed}"] = stays(page, partial(_what_is_wrong, page))
    statistics.click()
    assert {name: faults for name, faults in wrong.items() if faults} == {}


def _what_is_wrong(page: Page) -> list[str]:
    whole = [*CHARTS, *VIEWS, *CONTROLS, TOOLS, FIGURES]
    placed = [(name, box) for name, found in survey(page, {one: one for one in whole}).items() for box in found]
    assert {name for name, _ in placed} >= set(whole) - {FIGURES}
    # the controls may be in their own scrolling column
    paper = scrolled_page(page)
    wrong = [f"{name} cannot be scrolled to" for name, box in placed if name not in CONTROLS and not paper.holds(box)]
    wrong += [f"{one[0]} lies over {other[0]}" for one, other in combinations(placed, 2) if one[1].overlaps(other[1])]
    for chart in CHARTS:
        wrong += [f"{chart}: {fault}" for fault in _wrong_in_chart(page, chart)]
    wrong += [
        f"something covers {one}" for one in covered(page, f"{TOOLS} button, main figcaption button, nav > *, {STOP}")
    ]
    wrong += [f"cut: {one}" for one in cut(page, "main figcaption span:not(.visually-hidden)")]
    if document_scrolls_by(page) > 0:
        wrong.append(f"the document scrolls by {document_scrolls_by(page)} px, and STOP with it")
    if sideways(page) > 0:
        wrong.append(f"{sideways(page)} px too wide")
    return wrong


def _wrong_in_chart(page: Page, chart: str) -> list[str]:
    parts = {"whole": chart, "legend": f"{chart} figcaption", "words": f"{chart} figcaption > span"}
    found = survey(page, {**parts, "canvas": f"{chart} canvas"})
    whole, legend, canvas = found["whole"][0], found["legend"][0], found["canvas"][0]
    wrong = [f"{name} sticks out" for name, box in (("legend", legend), ("canvas", canvas)) if not whole.holds(box)]
    if canvas.bottom - canvas.top < LEAST_CHART_PX or legend.overlaps(canvas):
        wrong.append(f"canvas {canvas} with legend {legend}")
    if not all(legend.holds(word) for word in found["words"]) or _overlapping(found["words"]):
        wrong.append(f"legend {legend} with {found['words']}")
    return wrong


def _overlapping(found: list[Box]) -> bool:
    return any(one.overlaps(other) for one, other in combinations(found, 2))


def test_a_phone_shows_charts_and_views_above_the_controls(browser: Browser, service: Service) -> None:
    context = browser.new_context(viewport=PHONE, has_touch=True, is_mobile=True)
    operator = Operator(context.new_page(), service)
    page = operator.page
    operator.sign_in()
    operator.go("Operate")
    expect(page.get_by_role("slider", name="λ_q", exact=True)).to_be_attached(timeout=MOTION_TIMEOUT_MS)
    stop = page.get_by_role("button", name="STOP", exact=True)
    expect(page.get_by_role("status", name="Mode", exact=True)).to_be_in_viewport(ratio=1)
    found = survey(page, {one: one for one in (*CHARTS, *VIEWS, *CONTROLS)})
    for above, below in pairwise(found.values()):
        assert above[0].bottom <= below[0].top + 1
    for place in found:
        page.locator(place).scroll_into_view_if_needed()
        expect(stop).to_be_in_viewport(ratio=1)
        assert covered(page, STOP) == []
    main = page.get_by_role("main")
    main.evaluate(
        "main => main.scrollTo(0, main.scrollHeight)"
    )  # at the end of the page, the sticky buttons are at their normal position
    assert _out_of_order(page, "main figure, main canvas, main button, main input") == []
    main.evaluate("main => main.scrollTo(0, 0)")
    _swipe_up(page, CHARTS[1])
    operator.wait(lambda: main.evaluate("main => main.scrollTop") > 50)  # swiping on a chart scrolls the page
    stop.click()
    fault = page.get_by_role("alert", name="Fault", exact=True)
    expect(fault).to_contain_text("STOP was pressed")
    told = fault.bounding_box()
    assert told is not None
    assert told["width"] > 0.8 * PHONE["width"]  # wide enough for lines of text
    operator.press("Reset")
    operator.expect_mode("off")
    context.close()


def _out_of_order(page: Page, selector: str) -> list[str]:
    """Return the elements wholly above their predecessor; an input without size is represented by its label."""
    found = page.evaluate(
        """selector => {
            const drawn = one => one.offsetParent !== null && one.getBoundingClientRect().width > 0;
            const seen = [...document.querySelectorAll(selector)].filter(drawn);
            const boxes = seen.map(one => one.getBoundingClientRect());
            return seen.filter((_, at) => at > 0 && boxes[at].bottom <= boxes[at - 1].top).map(one => one.outerHTML);
        }""",
        selector,
    )
    return list(found)


def _swipe_up(page: Page, over: str) -> None:
    """Swipe up with one finger by touch events."""
    where = page.locator(over).bounding_box()
    assert where is not None
    x, y = where["x"] + where["width"] / 2, where["y"] + where["height"] / 2
    session = page.context.new_cdp_session(page)
    for kind, moved in (("touchStart", 0), ("touchMove", 40), ("touchMove", 120), ("touchMove", 200), ("touchEnd", 0)):
        touches = [] if kind == "touchEnd" else [{"x": x, "y": y - moved}]
        session.send("Input.dispatchTouchEvent", {"type": kind, "touchPoints": touches})
