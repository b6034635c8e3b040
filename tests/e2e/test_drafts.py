"""Drafts of forms persist after navigation and reload, and can be discarded."""

from collections.abc import Callable

import pytest
from playwright.sync_api import Locator, Page, expect

from tests.e2e.operator import Operator
from tests.e2e.page_texts import load_texts

IDENTIFY_TEXTS = load_texts("pages/identify")
EXPERIMENT_TEXTS = load_texts("pages/experiments")
STUDY_TEXTS = load_texts("pages/studies")
OPERATE = load_texts("pages/operate")

Box = Callable[[Page], Locator]


def in_region(name: str, label: str) -> Box:
    return lambda page: page.get_by_role("region", name=name, exact=True).get_by_label(label, exact=True)


def begun_with_the_sample(page: Page) -> None:
    own = page.get_by_role("region", name=EXPERIMENT_TEXTS["ownExperiments"], exact=True)
    if own.get_by_role("textbox", name=EXPERIMENT_TEXTS["name"], exact=True).count() == 0:
        own.get_by_role("combobox", name=EXPERIMENT_TEXTS["startFrom"]).select_option("sample sequence")


def nothing(_page: Page) -> None:
    pass


FORMS: list[tuple[str, str, Callable[[Page], None], Box, str, str | None]] = [
    (
        "Experiments",
        "e",
        begun_with_the_sample,
        in_region(EXPERIMENT_TEXTS["ownExperiments"], EXPERIMENT_TEXTS["name"]),
        "typed",
        EXPERIMENT_TEXTS["draftOf"],
    ),
    (
        "Experiments",
        "e",
        nothing,
        in_region(EXPERIMENT_TEXTS["newExperiment"], "Hold time of each position reference [s]"),
        "7.5",
        EXPERIMENT_TEXTS["settingsOf"].split(" {")[0],
    ),
    (
        "Studies",
        "t",
        nothing,
        in_region(STUDY_TEXTS["newStudy"], STUDY_TEXTS["text"]),
        "format: 1\nname: typed\n",
        STUDY_TEXTS["draftOf"],
    ),
    (
        "Identify",
        "i",
        nothing,
        in_region(IDENTIFY_TEXTS["newIdentification"], IDENTIFY_TEXTS["periods"]),
        "5",
        IDENTIFY_TEXTS["draftOf"],
    ),
    ("Operate", "o", nothing, in_region("Push", "Push [N]"), "7.5", None),
    ("Operate", "o", nothing, in_region("Wall", OPERATE["wallStiffness"]), "7000", None),
]


@pytest.mark.parametrize(
    ("name", "key", "begin", "box", "typed", "draft"), FORMS, ids=["own", "kind", "study", "identify", "push", "wall"]
)
def test_drafts_persist_after_navigation_and_reload_and_can_be_discarded(
    same_operator: Operator,
    name: str,
    key: str,
    begin: Callable[[Page], None],
    box: Box,
    typed: str,
    draft: str | None,
) -> None:
    page = same_operator.page
    same_operator.go(name)
    begin(page)
    before = box(page).input_value()
    assert before != typed
    box(page).fill(typed)
    if draft is None:
        box(page).press("Enter")  # boxes without a form apply a value on Enter
    box(page).blur()  # so that the shortcuts of the page apply
    page.keyboard.press("l" if name == "Operate" else "o")
    same_operator.go("Log")
    page.keyboard.press(key)
    expect(box(page)).to_have_value(typed)
    page.reload()
    expect(box(page)).to_have_value(typed)
    if draft is None:
        return
    mark = page.get_by_role("group", name=f"Draft of the {draft}")
    expect(mark).to_contain_text("since 20")
    mark.get_by_role("button", name="Discard the draft").click()
    mark.get_by_role("button", name="Keep draft", exact=True).click()
    expect(box(page)).to_have_value(typed)
    mark.get_by_role("button", name="Discard the draft").click()
    mark.get_by_role("button", name="Discard draft", exact=True).click()
    expect(box(page)).to_have_value(before)
    expect(mark).to_have_count(0)
