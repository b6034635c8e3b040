"""A trigger from its card on Operate to its record in charts; an armed trigger persists after a reload."""

import re

from playwright.sync_api import expect

from tests.api.conftest import client_with
from tests.e2e.operator import MOTION_TIMEOUT_MS, Operator
from tests.e2e.page_texts import load_texts
from tests.e2e.sharing import bring_to_run, sign_in_at

RUNS = load_texts("pages/runs")
TEXTS = load_texts("pages/system")

LEVEL_DEG, STEP_RAD = 5.0, 0.2


def test_an_armed_trigger_persists_after_a_reload_and_links_to_its_flight_record(operator: Operator) -> None:
    page, service = operator.page, operator.service
    bring_to_run(service)
    sign_in_at(page, service, "operate")
    card = page.get_by_role("region", name=TEXTS["trigger"], exact=True)
    form = card.get_by_role("form", name=TEXTS["triggerForm"], exact=True)
    form.get_by_label(TEXTS["signal"]).select_option("q_ref")
    form.get_by_label(TEXTS["condition"]).select_option("rising")
    for label, text in (("level", f"{LEVEL_DEG:g}"), ("before", "0.2"), ("after", "0.3")):
        form.get_by_label(re.compile("^" + re.escape(TEXTS[label].replace("{unit}", "")))).fill(text)
    form.get_by_role("button", name=TEXTS["arm"], exact=True).click()
    told = card.get_by_role("status", name=TEXTS["triggerState"], exact=True)
    expect(told).to_contain_text("Armed: q_ref rising through 5°; 0 of 1 captured (armed by operator)")
    page.reload()
    expect(told).to_contain_text("Armed: q_ref rising through 5°")
    expect(card.get_by_role("button", name=TEXTS["disarm"], exact=True)).to_be_visible()

    with client_with(service, "token") as script:
        script.put("/api/references", json={"q_ref": STEP_RAD, "S_ref": 10.0}).raise_for_status()
    expect(told).to_have_text("Not armed: all captures are complete; 1 of 1 captured", timeout=MOTION_TIMEOUT_MS)
    card.get_by_role("link", name=TEXTS["captures"], exact=True).click()
    records = page.get_by_role("table", name=TEXTS["flights"], exact=True)
    row = records.get_by_role("row").filter(has_text="trigger: q_ref rising through 5°")
    expect(row).to_contain_text("−0.2 to 0.3")
    expect(row).to_contain_text("operator")
    row.get_by_role("link").first.click()
    facts = page.get_by_role("region", name=RUNS["trigger"], exact=True)
    expect(facts).to_contain_text(RUNS["rangeAround"].replace("{before}", "0.200").replace("{after}", "0.300"))
    replay = page.get_by_role("region", name=RUNS["replay"], exact=True)
    expect(replay.get_by_role("status", name=RUNS["replayTime"], exact=True)).to_have_text("0:00.00")
