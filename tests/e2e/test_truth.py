"""The page agrees with the service after every action of a robot, and offers only accepted commands."""

from collections.abc import Iterator
from contextlib import closing

import pytest
from playwright.sync_api import Browser, Page, expect

from tests.e2e.browser import DESKTOP
from tests.e2e.service import Service
from tests.e2e.sharing import sign_in_at
from tests.e2e.truth.checked import lasting, settled
from tests.e2e.truth.moment import Around
from tests.e2e.truth.robot import fresh_seed, robot_at_work

DEEDS = 300
LOOKS = 4


@pytest.fixture(scope="module")
def service(fresh_service: Service) -> Service:
    return fresh_service


@pytest.fixture(scope="module")
def around(browser: Browser, service: Service) -> Iterator[Around]:
    context = browser.new_context(viewport=DESKTOP)
    page = context.new_page()
    sign_in_at(page, service, "operate")
    with closing(Around(page, service)) as both:
        yield both
    context.close()


HELD = """([selector, attribute, value]) => {
    const say = one => {
        if (attribute === null) { if (one.textContent !== value) one.textContent = value; }
        else if (one.getAttribute(attribute) !== value) one.setAttribute(attribute, value);
    };
    window.lying = new MutationObserver(() => document.querySelectorAll(selector).forEach(say));
    document.querySelectorAll(selector).forEach(say);
    window.lying.observe(document.body, { subtree: true, childList: true, characterData: true, attributes: true });
}"""
"""Makes an element say something else, however often the page writes it anew."""

MODE = "[role=status][aria-label=Mode] dfn"
RUN = "[aria-label='Change mode'] button:nth-of-type(2)"
LIES = {
    "a mode that is another": (MODE, None, "run", "mode"),
    "a simulator that is a rig": ("header [role=img]", None, "RIG", "badge of the plant"),
    "a holder of control": (
        "header button[aria-label^='Control: ']",
        "aria-label",
        "Control: Ana",
        "holder of control",
    ),
    "a control that is offered": (RUN, "aria-disabled", "false", "whether 'Run' in 'Mode' can be pressed"),
    "a digit that is rounded wrongly": ("[data-role=value-u_A]", None, "0.01", "u_A [V] in Motor voltage"),
    "a proof of no stop": (
        "output[aria-label='Stop result']",
        None,
        "Zero volts in 2 control steps",
        "proof of a stop",
    ),
    "a margin": ("output[aria-label='Motor loop']", None, "Motor loop at λ_motor 0.0854 s: M_s 1.2", "margins of the"),
}


@pytest.mark.parametrize("lie", LIES)
def test_a_wrong_value_on_the_page_is_detected(around: Around, lie: str) -> None:
    """In mode off all values are constant, so only the wrong value is found."""
    selector, attribute, value, name = LIES[lie]
    around.page.bring_to_front()
    truth = settled(around)
    assert truth == []
    around.page.evaluate(HELD, [selector, attribute, value])
    found = lasting(around, LOOKS)
    around.page.evaluate("window.lying.disconnect()")
    redraw_page(around.page)
    assert [one.partition(":")[0].startswith(name) for one in found] == [True], found


def redraw_page(page: Page) -> None:
    """Make the page redraw all values."""
    page.reload()
    expect(page.get_by_role("banner")).to_be_visible()


@pytest.mark.timeout(5400)  # a few seconds per action; each wait has its own timeout
def test_pages_agree_with_the_service_after_every_action_of_two_people(
    browser: Browser, service: Service, pytestconfig: pytest.Config
) -> None:
    asked, count = pytestconfig.getoption("--truth-seed"), pytestconfig.getoption("--truth-deeds")
    seed = fresh_seed() if asked is None else int(asked)
    print(f"seed {seed}: pytest --truth-seed={seed} does the same deeds")
    go_on = bool(pytestconfig.getoption("--truth-go-on"))
    robot_at_work(browser, service, seed, DEEDS if count is None else int(count), print, go_on=go_on)
