"""The editor of sequences, by keyboard and by drag, compared with the dry run and the recorded run."""

import re
from typing import Any

import pytest
from playwright.sync_api import Browser, Locator, Page, expect

from tests.e2e import forms
from tests.e2e.browser import DESKTOP
from tests.e2e.operator import MOTION_TIMEOUT_MS, Operator
from tests.e2e.page_texts import load_texts
from tests.e2e.service import Service
from tests.e2e.test_experiments_and_runs import DRY_RUN_TIMEOUT_MS
from tests.e2e.test_own_experiments import metrics_of

PLAYED_TIMEOUT_MS = 3 * MOTION_TIMEOUT_MS
"""A run of 12 s and its result."""

TEXTS = load_texts("pages/experiments")


def hold(time: str) -> str:
    """Return the description of a hold."""
    return TEXTS["describeHold"].format(time=time)


def ramp(angle: str) -> str:
    """Return the description of a ramp of q in 2 s."""
    references = TEXTS["referenceTo"].format(symbol="q", value=angle)
    return TEXTS["describeRamp"].format(references=references, time="2 s", push="")


def of_part(label: str, number: str) -> str:
    """Return the name of a field of a part."""
    return f"{label} {TEXTS['ofPart'].format(number=number)}"


@pytest.fixture(scope="module")
def service(fresh_service: Service) -> Service:
    return fresh_service


def previewed(own: Locator) -> str:
    """Return the sentence of the preview once it describes the current sequence."""
    preview = own.get_by_role("region", name=TEXTS["preview"], exact=True)
    status = preview.get_by_role("status", name=TEXTS["previewStatus"])
    expect(status).to_have_text(TEXTS["previewCurrent"], timeout=DRY_RUN_TIMEOUT_MS)
    return str(preview.get_by_text(TEXTS["valid"].split("}")[1].split("{")[0].strip()).inner_text())


def order(own: Locator) -> list[str]:
    """Return kind and number of the parts in their order."""
    kinds = own.get_by_role("combobox", name=re.compile("^" + TEXTS["kindOfPart"].split("{")[0]))
    return [f"{str(one.get_attribute('aria-label')).split()[-1]} {one.input_value()}" for one in kinds.all()]


def get(page: Page, service: Service, path: str) -> Any:
    answer = page.request.get(f"{service.url}{path}")
    assert answer.ok, answer.text()
    return answer.json()


def test_a_sequence_is_composed_previewed_saved_run_and_recreated(browser: Browser, service: Service) -> None:  # noqa: PLR0915  # one story
    page = browser.new_context(viewport=DESKTOP).new_page()  # the console may report refused requests
    operator = Operator(page, service)
    operator.sign_in()
    operator.be_in_run()
    operator.go("Experiments")
    own = page.get_by_role("region", name=TEXTS["ownExperiments"], exact=True)
    own.get_by_role("combobox", name=TEXTS["startFrom"]).select_option("sample sequence")
    own.get_by_role("textbox", name=TEXTS["name"], exact=True).fill("composed")
    own.get_by_role("textbox", name=TEXTS["experimentTitle"], exact=True).fill("Composed")
    assert order(own) == ["1.1 step", "1.2 ramp", "1.3 hold"]

    # by keyboard: the button that moved a part retains the focus, so that it can be pressed again
    own.get_by_role("button", name=TEXTS["movePartDown"].format(number="1.1"), exact=True).focus()
    page.keyboard.press("Enter")
    expect(own.get_by_role("button", name=TEXTS["movePartDown"].format(number="1.2"), exact=True)).to_be_focused()
    expect(own.get_by_role("status", name=TEXTS["moved"])).to_have_text(
        TEXTS["partMoved"].replace("{from}", "1.1").replace("{to}", "1.2")
    )
    assert order(own) == ["1.1 ramp", "1.2 step", "1.3 hold"]
    own.get_by_role("button", name=TEXTS["movePartUp"].format(number="1.2"), exact=True).focus()
    page.keyboard.press("Enter")
    expect(own.get_by_role("button", name=TEXTS["movePartUp"].format(number="1.1"), exact=True)).to_be_focused()
    assert order(own) == ["1.1 step", "1.2 ramp", "1.3 hold"]

    # a loop, and a part dragged into it
    own.get_by_role("button", name=TEXTS["repeatPart"].format(number="1.2"), exact=True).click()
    assert order(own) == ["1.1 step", "1.2 repeat", "1.2.1 ramp", "1.3 hold"]
    last = own.get_by_role("listitem", name=TEXTS["part"].format(number="1.3"), exact=True)
    last.get_by_title(TEXTS["dragPart"]).drag_to(
        own.get_by_role("button", name=TEXTS["addPartAt"].format(number="1.2.2"), exact=True)
    )
    expect(own.get_by_role("combobox", name=TEXTS["kindOfPart"].format(number="1.2.2"), exact=True)).to_have_value(
        "hold"
    )
    assert order(own) == ["1.1 step", "1.2 repeat", "1.2.1 ramp", "1.2.2 hold"]
    own.get_by_role("button", name=TEXTS["copyPart"].format(number="1.2.1"), exact=True).click()
    own.get_by_role("textbox", name=of_part("q_ref [°]", "1.2.1"), exact=True).fill("-10")
    own.get_by_role("textbox", name=of_part("q_ref [°]", "1.2.2"), exact=True).fill("200")
    row = own.get_by_role("listitem", name=TEXTS["part"].format(number="1.2.2"), exact=True)
    expect(own.get_by_role("alert")).to_have_text(
        re.compile("200° is outside")
    )  # one alert: the loop does not repeat it
    expect(row.get_by_role("alert")).to_be_visible()
    own.get_by_role("textbox", name=of_part("q_ref [°]", "1.2.2"), exact=True).fill("20")
    expect(row).to_contain_text(ramp("20°"))
    sentence = previewed(own)
    expect(row).to_contain_text(
        ", ".join(
            (
                TEXTS["scheduled"].format(start="4", end="12 s"),
                TEXTS["startsFrom"].format(symbol="q", value="−10°", speed="15°/s"),
            )
        )
    )
    expect(row.get_by_role("alert")).to_have_count(0)

    # the own criterion, as the preview describes it
    second = TEXTS["ofCriterion"].format(number=2)
    own.get_by_role("button", name=TEXTS["addCriterion"]).click()
    own.get_by_role("combobox", name=f"{TEXTS['metric']} {second}").select_option("peak_voltage_V")
    own.get_by_role("textbox", name=f"{TEXTS['bound']} [V] {second}").fill("0.5")
    assert previewed(own) == sentence.replace("1 criterion", "2 criteria")
    verdicts = own.get_by_role("table", name=TEXTS["criteriaOf"].format(source=TEXTS["previewSource"])).get_by_role(
        "row"
    )
    expect(verdicts.nth(2)).to_contain_text(TEXTS["fail"])

    own.get_by_role("button", name=TEXTS["save"], exact=True).click()
    expect(own.get_by_role("status", name="Refusal")).to_contain_text(TEXTS["saved"].format(name="composed", version=1))
    form = page.get_by_role("form", name="Composed", exact=True)
    with page.expect_response(lambda answer: answer.url.endswith("/dry-run"), timeout=DRY_RUN_TIMEOUT_MS) as answered:
        form.get_by_role("button", name=TEXTS["dryRun"], exact=True).click()
    figures = metrics_of(answered.value)
    volts, low, high = (figures[name] for name in ("peak_voltage_V", "min_tension_N", "max_tension_N"))
    assert sentence.endswith(TEXTS["peaks"].format(voltage=f"{volts:#.3g}", low=f"{low:#.3g}", high=f"{high:#.3g}"))
    expect(verdicts.nth(2)).to_contain_text(f"{volts:#.3g}")

    # the next version states what changed
    own.get_by_role("textbox", name=of_part(f"{TEXTS['time']} [s]", "1.2.3"), exact=True).fill("1")
    own.get_by_text(TEXTS["versionsCount"].format(name="composed", count=1)).click()
    versions = own.get_by_role("table", name=TEXTS["versions"].format(name="composed"))
    expect(versions).to_contain_text(TEXTS["removed"].format(line=TEXTS["inLoop"] + hold("2 s")))
    expect(versions).to_contain_text(TEXTS["added"].format(line=TEXTS["inLoop"] + hold("1 s")))
    own.get_by_role("button", name=TEXTS["save"], exact=True).click()
    expect(own.get_by_role("status", name="Refusal")).to_contain_text(TEXTS["saved"].format(name="composed", version=2))
    expect(versions.get_by_role("row").nth(1)).to_contain_text(TEXTS["same"])
    listed = get(page, service, "/api/experiments/own/composed/versions")["experiments"]
    assert [(one["version"], one["who"]) for one in listed] == [(2, "operator"), (1, "operator")]
    own.get_by_role("button", name=TEXTS["openVersion"].format(version=1)).click()
    expect(own.get_by_role("textbox", name=of_part(f"{TEXTS['time']} [s]", "1.2.3"), exact=True)).to_have_value("2")
    previewed(own)

    # the recorded run agrees with the sequence, and can be edited again
    _, started = forms.pressed(
        page,
        form.get_by_role("button", name=TEXTS["startExperiment"].format(experiment="composed"), exact=True),
        "/api/experiments",
    )
    run = started["id"]
    result = page.get_by_role("region", name=TEXTS["result"], exact=True)
    expect(result).to_contain_text(
        TEXTS["resultOf"].split("{time}")[0].strip().format(experiment="Composed", run=run), timeout=MOTION_TIMEOUT_MS
    )
    expect(result).to_contain_text("of 2 criteria", timeout=PLAYED_TIMEOUT_MS)
    page.goto(f"{service.url}/#/runs/{run}")
    page.get_by_role("link", name=load_texts("pages/runs")["createExperiment"]).click()
    expect(own.get_by_role("textbox", name=TEXTS["name"], exact=True)).to_have_value(f"as_run_{run}")
    words = [
        row.inner_text()
        for row in own.get_by_role("listitem", name=re.compile("^" + TEXTS["part"].split("{")[0])).all()
    ]
    told = [
        TEXTS["describeTuning"].format(changes="λ_q"),
        TEXTS["describeStep"].split("{")[0] + TEXTS["referenceTo"].format(symbol="q", value="0°"),
        *[ramp("−10°"), ramp("20°"), hold("")] * 2,
    ]
    assert all(part in row for part, row in zip(told, words, strict=True)), words
    previewed(own)
    page.context.close()
