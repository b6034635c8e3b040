"""Refusals of the service appear at the field that caused them, also at files and number boxes."""

import json
from pathlib import Path

from playwright.sync_api import Browser, Locator, expect

from tests.e2e.browser import DESKTOP
from tests.e2e.operator import Operator
from tests.e2e.page_texts import load_texts
from tests.e2e.service import Service

OPERATE = load_texts("pages/operate")


def test_refusals_of_a_file_and_of_a_trial_time_appear_at_their_fields(
    browser: Browser, service: Service, tmp_path: Path
) -> None:
    page = browser.new_context(viewport=DESKTOP).new_page()  # the console may report refused requests
    operator = Operator(page, service)
    operator.sign_in()
    operator.go("Banks")
    button = page.get_by_role("button", name=load_texts("pages/banks")["importBank"])
    with page.expect_file_chooser() as chooser:
        button.click()
    file = tmp_path / "bank.json"
    file.write_text(json.dumps({"name": "lab", "entries": [{"S_nominal": 10}]}))
    chooser.value.set_files(file)
    expect_refusal_at(button, "entry 1, K of G_q: it is missing")

    operator.go("Operate")
    operator.take_control()
    page.get_by_role("switch", name="Stage changes").check()
    operator.enter("λ_q value [s]", 0.7)
    box = page.get_by_role("textbox", name=OPERATE["trialDuration"])
    box.fill("0.2")
    page.get_by_role("button", name="Try for").click()
    expect_refusal_at(box, "duration of the trial: 0.2 s is less than 1 s; choose 1 s at least")
    expect(box).to_have_attribute("aria-invalid", "true")
    page.context.close()


def expect_refusal_at(field: Locator, said: str) -> None:
    """Wait until the message describes the field and the field has the focus."""
    page = field.page
    sentence = page.get_by_text(said, exact=True)
    expect(sentence).to_have_count(1)
    expect(field).to_be_focused()
    place = sentence.get_attribute("id")
    assert place is not None
    assert place in (field.get_attribute("aria-describedby") or "").split()
