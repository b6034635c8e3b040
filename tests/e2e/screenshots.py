"""Pictures for the documentation, taken from the running system: ``python -m tests.e2e.screenshots``.

Every page in light and dark and on a tablet, with real data: a session with steps, an identification, a bank and a
tracking run are made first, in real time.
"""

import tempfile
from pathlib import Path

from playwright.sync_api import Browser, ViewportSize, expect

from tests.e2e.browser import DESKTOP, TABLET, chromium
from tests.e2e.operator import MOTION_TIMEOUT_MS, Operator
from tests.e2e.service import Service, running_service
from tests.e2e.test_session import build_and_activate_a_bank, identify, track

FOLDER = Path(__file__).parents[2] / "docs" / "screenshots"
PAGES = ("Operate", "Identify", "Banks", "Experiments", "Studies", "Runs", "Log", "System")
LOOKS: tuple[tuple[str, str, ViewportSize], ...] = (
    ("light", "light", DESKTOP),
    ("dark", "dark", DESKTOP),
    ("tablet", "light", TABLET),
)
FOLLOWED_MS = 6_000
"""How long the joint is followed before the Operate page is taken: a step and its settling in sight."""


def main() -> None:
    """Make the data, then take every page in every look."""
    FOLDER.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory() as data, running_service(Path(data)) as service, chromium() as browser:
        prepare(browser, service)
        for look, scheme, size in LOOKS:
            take(browser, service, look, scheme, size)


def prepare(browser: Browser, service: Service) -> None:
    """Fill the database with one run of each kind."""
    context = browser.new_context(viewport=DESKTOP)
    operator = Operator(context.new_page(), service)
    operator.sign_in()
    operator.page.get_by_role("button", name="Skip tour", exact=True).click(timeout=MOTION_TIMEOUT_MS)
    operator.bring_up()
    run = identify(operator)
    build_and_activate_a_bank(operator, run)
    track(operator)
    context.close()


def take(browser: Browser, service: Service, look: str, scheme: str, size: ViewportSize) -> None:
    """Take every page in one look."""
    context = browser.new_context(viewport=size, color_scheme="dark" if scheme == "dark" else "light")
    operator = Operator(context.new_page(), service)
    operator.sign_in()
    operator.be_in_run()
    for target, name in ((25.0, "Operate"), (-25.0, "Operate")):
        operator.go(name)
        operator.enter("q_ref value [deg]", target)
        operator.page.wait_for_timeout(FOLLOWED_MS)
    for name in PAGES:
        operator.go(name)
        expect(operator.page.get_by_role("main")).to_be_visible(timeout=MOTION_TIMEOUT_MS)
        operator.page.wait_for_load_state("networkidle")
        for waiting in ("Loading …", "Comparing …"):
            expect(operator.page.get_by_text(waiting, exact=True)).to_have_count(0, timeout=MOTION_TIMEOUT_MS)
        operator.page.screenshot(path=FOLDER / f"{name.lower()}-{look}.png")
        print(f"{name.lower()}-{look}.png")
    context.close()


if __name__ == "__main__":
    main()
