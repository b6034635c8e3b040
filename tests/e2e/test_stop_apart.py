"""STOP works when the application fails: translated page, failed component, no storage, no bundle."""

import re
from collections.abc import Callable, Iterator

import httpx
import pytest
from playwright.sync_api import Browser, BrowserContext, Page, Route, ViewportSize, expect

from tests.api.conftest import client_with
from tests.e2e.browser import DESKTOP
from tests.e2e.operator import MOTION_TIMEOUT_MS, Operator
from tests.e2e.service import Service

PAGES = (
    "operate",
    "bring-up",
    "identify",
    "banks",
    "experiments",
    "studies",
    "runs",
    "log",
    "docs",
    "glossary",
    "system",
)
SIZES = ((360, 640), (720, 450), (1024, 768), (1440, 900), (2560, 1440))
"""Sizes of a window [px]; the first two are also what a zoom of 200 % leaves of a common one."""

TRANSLATED = """() => {
  const wrap = (root) => {
    const walker = document.createTreeWalker(root, NodeFilter.SHOW_TEXT), found = [];
    while (walker.nextNode()) found.push(walker.currentNode);
    for (const text of found) {
      const parent = text.parentElement;
      if (!text.nodeValue.trim() || !parent || /^(SCRIPT|STYLE|TEXTAREA|FONT)$/.test(parent.tagName)) continue;
      const outer = document.createElement('font'), inner = document.createElement('font');
      inner.textContent = text.nodeValue;
      outer.append(inner);
      parent.replaceChild(outer, text);
    }
  };
  wrap(document.body);
  new MutationObserver((changes) => changes.forEach(({ addedNodes }) => addedNodes.forEach((node) => {
    if (node.nodeType === 1 && node.tagName !== 'FONT') wrap(node);
  }))).observe(document.body, { childList: true, subtree: true });
}"""
"""What a page translation does to text, also where the document asks that nothing translates it."""

WITHOUT_STORAGE = """
  const refuse = () => { throw new DOMException('blocked', 'SecurityError') };
  for (const name of ['localStorage', 'sessionStorage', 'indexedDB'])
    Object.defineProperty(window, name, { get: refuse });
  Object.defineProperty(Document.prototype, 'cookie', { get: refuse, set: refuse });
"""

Press = Callable[[Page], None]
PRESSES: dict[str, Press] = {
    "button": lambda page: page.get_by_role("button", name="STOP", exact=True, include_hidden=True).click(),
    "keys": lambda page: page.keyboard.press("Control+Shift+E"),
}


@pytest.fixture(params=PRESSES)
def press(request: pytest.FixtureRequest) -> Press:
    return PRESSES[request.param]


@pytest.fixture
def script(service: Service) -> Iterator[httpx.Client]:
    with client_with(service, "token") as client:
        yield client


@pytest.fixture
def context(browser: Browser, service: Service) -> Iterator[BrowserContext]:
    """A browser with a signed-in person."""
    made = browser.new_context(viewport=DESKTOP)
    made.add_init_script(
        "if (location.origin !== 'null') try { localStorage.setItem('sinew-goes-by-role', '') } catch {}"
    )
    page = made.new_page()
    page.goto(service.link)
    expect(page.get_by_role("banner")).to_be_visible()
    page.close()
    yield made
    made.close()


def mode(script: httpx.Client) -> str:
    return str(script.get("/api/state").raise_for_status().json()["mode"])


def stops(page: Page, script: httpx.Client, press: Press) -> None:
    """Press STOP and check that the service confirms it and the trip is latched."""
    with page.expect_response("**/api/stop") as answer:
        press(page)
    proof = answer.value.json()
    assert proof["zero_tick"] >= proof["arrived_tick"]
    assert mode(script) == "tripped"


def test_stop_works_on_every_translated_page(context: BrowserContext, service: Service, script: httpx.Client) -> None:
    page = context.new_page()
    operator = Operator(page, service)
    for place, name in enumerate(PAGES):
        page.goto(service.url)
        page.reload()  # a change of the fragment alone loads nothing
        operator.be_in_run()
        page.goto(f"{service.url}/#/{name}")
        expect(page.get_by_role("main")).to_be_visible()
        page.evaluate(TRANSLATED)
        page.wait_for_timeout(300)  # live values are drawn into the translated page
        stops(page, script, list(PRESSES.values())[place % 2])


def thrown(route: Route) -> None:
    """Answer with a part of the bundle whose components all throw."""
    text = route.fetch().text()
    exported = re.findall(r"export\s*\{([^}]*)\}", text)
    names = [one.split(" as ")[-1].strip() for part in exported for one in part.split(",")]
    broken = "const broken = () => { throw new Error('broken by the test') };"
    body = f"{broken}\nexport {{ {', '.join(f'broken as {name}' for name in names if name)} }};"
    route.fulfill(body=body, content_type="text/javascript")


@pytest.mark.parametrize("name", PAGES)
def test_stop_and_navigation_work_after_a_component_throws(
    context: BrowserContext, service: Service, script: httpx.Client, name: str
) -> None:
    page = context.new_page()
    if name == "operate":  # its parts are in the main bundle
        page.add_init_script("HTMLCanvasElement.prototype.getContext = () => { throw new Error('broken by the test') }")
    else:
        page.route(re.compile(r"/assets/[A-Z]\w*Page-[\w-]+\.js"), thrown)
    page.goto(f"{service.url}/#/{name}")
    failed = page.get_by_role("alert", name=re.compile(" failed$")).first
    expect(failed).to_contain_text("broken by the test", timeout=MOTION_TIMEOUT_MS)
    expect(page.get_by_role("navigation", name="Main")).to_be_visible()
    for press in PRESSES.values():
        stops(page, script, press)


def test_stop_works_without_browser_storage(
    context: BrowserContext, service: Service, script: httpx.Client, press: Press
) -> None:
    page = context.new_page()
    page.add_init_script(WITHOUT_STORAGE)
    page.goto(service.url)
    expect(page.get_by_role("button", name="STOP", exact=True)).to_be_visible()
    stops(page, script, press)


def test_stop_works_without_the_bundle_and_the_page_states_the_error(
    context: BrowserContext, service: Service, script: httpx.Client, press: Press
) -> None:
    page = context.new_page()
    page.route("**/assets/**", lambda route: route.abort())
    page.goto(service.url)
    stops(page, script, press)
    expect(page.get_by_role("alert", name="STOP", exact=True)).to_contain_text("Zero volts in")


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_the_message_of_an_unconfirmed_stop_fits_every_window_size(
    context: BrowserContext, service: Service, scheme: str
) -> None:
    page = context.new_page()
    page.emulate_media(color_scheme="dark" if scheme == "dark" else "light")
    page.goto(service.url)
    Operator(page, service).be_in_run()  # the notice ends when the motors are at rest
    page.route("**/api/stop", lambda route: route.abort())
    for width, height in SIZES:
        page.set_viewport_size(ViewportSize(width=width, height=height))
        PRESSES["button"](page)
        notice = page.get_by_role("alert", name="STOP", exact=True)
        expect(notice).to_have_text("STOP NOT CONFIRMED: use the stop at the machine. The service cannot be reached.")
        expect(notice).to_be_in_viewport(ratio=1)
        cut = notice.evaluate("at => [at.scrollWidth > at.clientWidth, at.scrollHeight > at.clientHeight]")
        assert cut == [False, False], f"{width} × {height}"
        covered = notice.evaluate(
            "at => { const {left, top, width, height} = at.getBoundingClientRect();"
            " return [[.05, .5], [.5, .5], [.95, .5]].some(([x, y]) =>"
            " document.elementFromPoint(left + x * width, top + y * height) !== at) }"
        )
        assert not covered, f"{width} × {height}"
