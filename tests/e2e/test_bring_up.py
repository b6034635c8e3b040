"""Commissioning of a rig on the page, step by step, on the virtual card; the test computes motions and weights."""

import re
from collections.abc import Iterator
from typing import Any

import pytest
from playwright.sync_api import Browser, Locator, Page, expect

from backend.commissioning import messages
from tests.e2e.operator import Operator
from tests.e2e.page_texts import load_texts
from tests.e2e.service import Service, running_service
from tests.e2e.test_viewer import signed_in_as_viewer

TEXTS = load_texts("pages/bringUp")

STEP_TIMEOUT_MS = 120_000
"""Longer than a step waits by itself, as for a pretension: then it fails, and says so."""
DRIVES = {"wiring_test": TEXTS["drivesOff"], "zero": TEXTS["drivesOff"], "direction": TEXTS["drivesOn"]}
"""What the page says of the drives after some of the steps."""

QUESTIONS_MAX = 12
"""More than any step asks of a person."""


@pytest.fixture(scope="module")
def service(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Service]:
    with running_service(tmp_path_factory.mktemp("data"), plant=("rig", "--virtual-card")) as running:
        yield running


def test_an_operator_commissions_the_rig_on_the_page(operator: Operator, browser: Browser, service: Service) -> None:
    page = operator.page
    operator.sign_in()
    expect(page.get_by_role("img", name="Virtual card", exact=True)).to_have_text("VIRTUAL CARD")
    operator.go("Bring-up")
    expect(page.get_by_role("main")).to_contain_text(TEXTS["someDone"].format(done=0, count=7))
    for number, step in enumerate(told(page, service)["steps"], start=1):
        play(operator, number, step["title"])
        if step["id"] in DRIVES:
            expect(page.get_by_role("region", name=TEXTS["drives"])).to_contain_text(DRIVES[step["id"]])
        expect(page.get_by_role("button", name="STOP", exact=True)).to_be_in_viewport(ratio=1)
    expect(page.get_by_role("main")).to_contain_text(TEXTS["allDone"].format(count=7))
    steps = {step["id"]: step for step in told(page, service)["steps"]}
    assert {(step["state"], step["result"]["passed"], step["result"]["who"]) for step in steps.values()} == {
        ("current", True, "operator")
    }
    slope_labels = {str(messages.slope_of_load_cell(tendon=tendon)) for tendon in "AB"}
    slopes = [value for words, value in figures(steps["calibrate"]) if words in slope_labels]
    assert slopes == pytest.approx([10.0, 10.0], rel=2e-3)  # of the virtual card [N/V]
    moved = {str(messages.joint_motion_by_motor(motor=motor)) for motor in "AB"}
    travels = [abs(value) for words, value in figures(steps["direction"]) if words in moved]
    assert len(travels) == 2
    assert max(travels) < 0.1
    viewer, refused = signed_in_as_viewer(browser, service)
    viewer.goto(f"{service.url}/#/bring-up")
    expect(viewer.get_by_role("region", name=TEXTS["result"])).to_have_count(7)
    expect(viewer.get_by_role("main").get_by_role("button")).to_have_count(0)
    assert refused == []
    viewer.context.close()


def play(operator: Operator, number: int, title: str) -> None:
    """Start one step and confirm each of its requests."""
    card = operator.page.get_by_role("region", name=TEXTS["stepTitle"].format(number=number, title=title), exact=True)
    confirm = card.locator("button:not([aria-disabled=true])").filter(has_text=re.compile(f"^{TEXTS['confirm']}$"))
    ended = card.get_by_text(re.compile(f"^({TEXTS['current']}|{TEXTS['failed']})$"))
    operator.press(TEXTS["startStep"].format(action=TEXTS["start"], step=title.lower()))
    for _ in range(QUESTIONS_MAX):
        expect(confirm.or_(ended)).to_be_visible(timeout=STEP_TIMEOUT_MS)
        if not confirm.is_visible():
            break
        asked = request_in(card)
        assert asked != ""
        confirm.click()
        operator.wait(lambda before=asked: request_in(card) != before)  # type: ignore[misc]  # bound in each round
    expect(card.get_by_role("region", name=TEXTS["result"])).to_be_visible()
    assert ended.inner_text() == TEXTS["current"], card.inner_text()


def figures(step: Any) -> list[tuple[str, float]]:
    return [(figure["words"], figure["value"]) for figure in step["result"]["figures"]]


def request_in(card: Locator) -> str:
    """Return the current request to the operator; empty without one."""
    return " ".join(card.get_by_role("status", name=TEXTS["whatToDo"]).all_inner_texts())


def told(page: Page, service: Service) -> Any:
    answer = page.request.get(f"{service.url}/api/bring-up")
    assert answer.ok, answer.text()
    return answer.json()
