"""Input that the robot does not send: drafts of forms, and unconfirmed numbers."""

from collections.abc import Callable

from playwright.sync_api import expect

from tests.e2e.page_texts import load_texts
from tests.e2e.truth.deeds import OPERATE, VOLTAGE_LIMIT, Deed, Scene
from tests.e2e.truth.drafts import BOXES

EXPERIMENT_TEXTS = load_texts("pages/experiments")

NUMBERS = {
    "q_ref value [°]": ("references", "q_ref"),
    "q_ref value [rad]": ("references", "q_ref"),
    "S_ref value [N·m/rad]": ("references", "S_ref"),
    "λ_q value [s]": ("tuning", "lam_q"),
    "λ_S value [s]": ("tuning", "lam_S"),
    VOLTAGE_LIMIT: ("tuning", "u_plan"),
    OPERATE["rejectionGain"]: ("tuning", "k_ext"),
}
"""Boxes that send on Enter, and where the state has their value."""

TYPED = {"q_ref value [°]": "11.3", "q_ref value [rad]": "0.123", "S_ref value [N·m/rad]": "9.87",
         "λ_q value [s]": "0.765", "λ_S value [s]": "0.765", VOLTAGE_LIMIT: "5.3",
         OPERATE["rejectionGain"]: "0.37"}  # fmt: skip
WAYS_OUT = ("Tab", "Escape", "elsewhere", "another page", "reload", "history")


def _offered_numbers(scene: Scene) -> list[str]:
    return [label for label in NUMBERS if scene.shown.offers(label)]


def _leave(scene: Scene, how: str) -> None:
    """Move the focus out of the box. The next check reads the opened page."""
    page = scene.page
    if how in ("Tab", "Escape"):
        page.keyboard.press(how)
    elif how == "elsewhere":
        page.get_by_role("heading", level=2).first.click()
    elif how == "another page":
        name = scene.chance.choice(("Log", "Runs", "Banks", "Studies"))
        page.get_by_role("navigation", name="Main").get_by_role("link", name=name, exact=True).click()
    elif how == "reload":
        page.reload()
        page.get_by_role("banner").wait_for()
    else:
        page.evaluate("location.hash = '#/system'")


def leave_a_number(scene: Scene) -> None:
    """Enter a number and leave the box without Enter: nothing is sent, and the page shows a message."""
    label = scene.chance.choice(_offered_numbers(scene))
    how = scene.chance.choice(WAYS_OUT)
    scene.say(f"{label} {TYPED[label]}, stored by {how}")
    part, name = NUMBERS[label]
    box = scene.page.get_by_role("textbox", name=label, exact=True)
    before = scene.around.state()
    box.fill(TYPED[label])
    if not box.is_enabled():
        return  # another person or a run has changed the tuning
    expect(box).to_have_attribute("data-unsent", "true")
    _leave(scene, how)
    scene.page.wait_for_timeout(200)
    after = scene.around.state()
    if _is_quiet(before) and _is_quiet(after) and before[part][name] != after[part][name]:
        raise AssertionError(f"{label}: leaving it by {how} changed {before[part][name]} to {after[part][name]}")
    if how in ("Tab", "elsewhere") and box.is_enabled():
        expect(scene.page.get_by_text("was not sent").first).to_be_visible()
        expect(box).not_to_have_attribute("data-unsent", "true")


def _is_quiet(state: dict[str, object]) -> bool:
    """Return whether no run and no trial changes references and tuning, and references are commanded."""
    in_force = state["references"]
    assert isinstance(in_force, dict)
    return state["task"] is None and state["trial"] is None and bool(in_force["in_force"])


def _boxes_in_sight(scene: Scene) -> list[str]:
    here = scene.shown.place
    return [name for name, box in BOXES.items() if box.place == here and _can_be_typed(scene, name)]


def _can_be_typed(scene: Scene, name: str) -> bool:
    found = BOXES[name].find(scene.page)
    return found.count() == 1 and found.is_visible() and found.is_editable()


def _type_a_draft(scene: Scene) -> None:
    begin = scene.main.get_by_role("region", name=EXPERIMENT_TEXTS["ownExperiments"]).get_by_role(
        "combobox", name=EXPERIMENT_TEXTS["startFrom"]
    )
    if begin.count() == 1 and not _can_be_typed(scene, "name of an own experiment") and not _has_draft(scene):
        begin.select_option("sample sequence")
        BOXES["name of an own experiment"].find(scene.page).wait_for()
    names = _boxes_in_sight(scene)
    name = scene.chance.choice(names)
    box = BOXES[name]
    text, how = box.text(scene.chance), scene.chance.choice(WAYS_OUT)
    if how == "Escape":
        how = "Tab"  # in a box, Escape discards the input
    scene.say(f"{name} {text!r}, stored by {how}")
    box.find(scene.page).fill(text)
    scene.typed.keep(name, text)
    _leave(scene, how)


def _has_draft(scene: Scene) -> bool:
    return scene.page.get_by_role("group", name="Draft of the experiment", exact=True).count() > 0


def _discard(scene: Scene) -> None:
    """Press Discard and answer the question: retain or discard the draft."""
    marks = scene.main.get_by_role("button", name="Discard the draft of the ")
    place = scene.chance.randrange(marks.count())
    of = (marks.nth(place).get_attribute("aria-label") or "").removeprefix("Discard the draft of the ")
    mark = scene.page.get_by_role("group", name=f"Draft of the {of}", exact=True)
    marks.nth(place).click()
    answer = scene.chance.choice(("Keep draft", "Discard draft"))
    scene.say(f"{of}: {answer}")
    mark.get_by_role("button", name=answer, exact=True).click()
    if answer == "Discard draft":
        for name, box in BOXES.items():
            if box.draft == of:
                scene.typed.forget(name)


def _at(place: str, of: Callable[[Scene], bool]) -> Callable[[Scene], bool]:
    return lambda scene: scene.shown.place == place and of(scene)


TYPING = (
    Deed("leave a number", "operate", 6, lambda scene: bool(_offered_numbers(scene)), leave_a_number),
    *(
        Deed(f"draft on {place}", place, weight, _at(place, lambda scene: bool(_boxes_in_sight(scene))), _type_a_draft)
        for place, weight in (("operate", 4), ("experiments", 4), ("identify", 4), ("studies", 8), ("system", 4),
                              ("runs", 3))
    ),
    Deed("discard a draft", None, 3,
         lambda scene: any(one.name.startswith("Discard the draft of ") for one in scene.shown.buttons), _discard),
)  # fmt: skip
