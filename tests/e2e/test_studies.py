"""A study on the page: refused with a message, computed, stopped, resumed, drawn."""

from playwright.sync_api import Browser, expect

from tests.e2e.browser import DESKTOP
from tests.e2e.operator import Operator
from tests.e2e.page_texts import load_texts
from tests.e2e.service import Service
from tests.e2e.sharing import sign_in_at

TEXTS = load_texts("pages/studies")

PATIENCE_MS = 400_000
"""Those who compute a study give way to everything else on the machine."""

STUDY = """format: 1
name: small
title: Small map
settings: {q_duration_s: 0.5, S_duration_s: 0.5, S_high: 12.0}
axes:
  - {over: lam_q, values: [0.5, 0.8]}
  - {over: lam_S, values: [0.5, 0.7, 0.9]}
"""


def test_a_study_is_started_stopped_resumed_and_drawn(browser: Browser, service: Service) -> None:
    page = browser.new_context(viewport=DESKTOP).new_page()  # the console may report refused requests
    operator = Operator(page, service)
    sign_in_at(page, service, "studies")
    expect(page.get_by_role("main")).to_contain_text(TEXTS["noStudies"])
    new = page.get_by_role("region", name=TEXTS["newStudy"], exact=True)
    new.get_by_role("textbox", name=TEXTS["text"]).fill(STUDY.replace("0.8]", "9.0]"))
    new.get_by_role("button", name=TEXTS["compute"], exact=True).click()
    expect(new.get_by_role("status", name="Refusal")).to_contain_text("line 6: axes 1, over", timeout=PATIENCE_MS)

    new.get_by_role("textbox", name=TEXTS["text"]).fill(STUDY + "seeds: 500\n")
    new.get_by_role("button", name=TEXTS["compute"], exact=True).click()
    main = page.get_by_role("region", name="Small map", exact=True)
    expect(main).to_contain_text("of 3000 runs", timeout=PATIENCE_MS)
    maps = page.get_by_role("region", name=TEXTS["maps"], exact=True)
    smallest = TEXTS["mapOf"].format(metric="Smallest tension [N]", statistic=TEXTS["least"], count=500)
    least = maps.get_by_role("figure", name=smallest, exact=True)
    expect(least).to_be_visible(timeout=PATIENCE_MS)
    expect(least).to_contain_text("λ_q [s]")
    expect(least).to_contain_text("λ_S [s]")
    expect(main).to_contain_text("left")
    main.get_by_role("button", name=TEXTS["stop"], exact=True).click()
    expect(main).to_contain_text("Stopped,", timeout=PATIENCE_MS)
    main.get_by_role("button", name=TEXTS["resume"], exact=True).click()
    expect(main).to_contain_text("Running,", timeout=PATIENCE_MS)
    main.get_by_role("button", name=TEXTS["stop"], exact=True).click()
    expect(main).to_contain_text("Stopped,", timeout=PATIENCE_MS)
    assert page.get_by_role("table", name=TEXTS["results"], exact=True).get_by_role("row").count() > 1
    maps.get_by_role("combobox", name=TEXTS["metric"]).select_option("peak_voltage_V")
    for pick, shown in (("worst", "largest"), ("mean", "mean")):
        maps.get_by_role("combobox", name=TEXTS["cellValue"]).select_option(pick)
        peak = TEXTS["mapOf"].format(metric="Peak voltage [V]", statistic=TEXTS[shown], count=500)
        expect(maps.get_by_role("figure", name=peak, exact=True)).to_be_visible()

    operator.go("Studies")
    expect(page.get_by_role("table", name=TEXTS["title"], exact=True)).to_contain_text("Small map")
    page.context.close()
