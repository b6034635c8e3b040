"""Every form shows the values that it sends, and that the service stores and reports, in every earlier state.

Every state checks all forms. Each experiment, push and trial runs in one or two states: see the tables at the end. Each
test brings the service into its state, so that it can run alone.
"""

from collections.abc import Callable, Iterator

import pytest
from playwright.sync_api import Browser, Locator, Page, expect

from tests.e2e import forms
from tests.e2e.browser import DESKTOP
from tests.e2e.forms import ROUNDED, TO_SI, differences
from tests.e2e.operator import MOTION_TIMEOUT_MS
from tests.e2e.page_texts import load_texts
from tests.e2e.stage import (
    EXPERIMENTS,
    IDENTIFICATIONS,
    LASTING,
    OTHERS,
    STATES,
    Stage,
    declared,
    form_of,
    release,
    start,
)
from tests.e2e.told import not_queued, not_stored, undeclared, words_of

IDENTIFY_TEXTS = load_texts("pages/identify")
EXPERIMENT_TEXTS = load_texts("pages/experiments")
OPERATE = load_texts("pages/operate")

DRY_RUN_TIMEOUT_MS = 120_000


@pytest.fixture(scope="module")
def stage(browser: Browser, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Stage]:
    opened = Stage(browser, tmp_path_factory.mktemp("data"))
    yield opened
    opened.close()
    assert opened.watched.complaints == []


def all_forms(stage: Stage) -> None:
    """Compare each form with declaration and active values; queue an experiment as shown and sent."""
    assert {one["name"] for one in stage.get("/api/experiments")["experiments"]} == {*EXPERIMENTS, *OTHERS}
    assert {one["kind"] for one in stage.get("/api/identification-kinds")["kinds"]} == set(IDENTIFICATIONS)
    own = stage.in_force()
    wrong: dict[str, list[str]] = {}
    for kind in (*OTHERS, *EXPERIMENTS, *IDENTIFICATIONS):
        form = form_of(stage, kind, LASTING.get(kind, {}))
        wrong[f"form of {kind}"] = undeclared(stage, form, declared(stage, kind)["settings"], own)
        if kind in EXPERIMENTS:
            wrong[f"queue of {kind}"] = not_queued(stage, form)
    stage.operator.go("Operate")
    for symbol, name in BOXES.items():
        expect(lambda_box(stage, symbol)).to_have_value(f"{own[name]:.3f}")
    assert stage.in_force() == own
    assert {where: found for where, found in wrong.items() if found} == {}


def run_of(kind: str) -> Callable[[Stage], None]:
    """Return the action that runs a kind: sent, run, stored and reported as shown, without changing the tuning."""

    def run(stage: Stage) -> None:
        own = stage.in_force()
        path = "/api/identifications" if kind in IDENTIFICATIONS else "/api/experiments"
        form = form_of(stage, kind, LASTING[kind])
        assert undeclared(stage, form, declared(stage, kind)["settings"], own) == []
        number, settings, wrong = start(stage, form, path)
        release(stage)
        # an identification uses the active tuning, which its form describes
        with_tuning = settings if kind in EXPERIMENTS else {**settings, **own, "seed": 0}
        assert [*wrong, *not_stored(stage, number, path, with_tuning)] == []
        assert differences(stage.in_force(), own) == []

    run.__name__ = kind
    return run


BOXES = {"λ_q": "lam_q", "λ_S": "lam_S"}


def lambda_box(stage: Stage, symbol: str) -> Locator:
    return stage.page.get_by_role("textbox", name=f"{symbol} value [s]", exact=True)


def lambda_on_operate(symbol: str, value: float) -> Callable[[Stage], None]:
    """Return the action that enters λ: sent, active, recorded in the next session, undone and redone."""

    def change(stage: Stage) -> None:
        page, before, name = stage.page, stage.in_force(), BOXES[symbol]
        stage.operator.go("Operate")
        box = lambda_box(stage, symbol)
        expect(box).to_have_value(f"{before[name]:.3f}")
        box.fill(str(value))
        with page.expect_request(lambda request: request.method == "PUT") as sent:
            box.press("Enter")
        assert sent.value.url.endswith("/api/tuning")
        assert sent.value.post_data_json == {name: value}
        stage.operator.wait(lambda: stage.in_force() == {**before, name: value})
        run = stage.session()
        assert differences(stage.stored(run), {**before, name: value}) == []
        undone = page.get_by_role("button", name="Undo change")
        _, answer = forms.pressed(page, undone, "/api/tuning/undo")
        assert answer[name] == before[name]
        expect(box).to_have_value(f"{before[name]:.3f}")
        assert stage.in_force() == before
        _, answer = forms.pressed(page, page.get_by_role("button", name="Redo change"), "/api/tuning/redo")
        assert answer[name] == value
        forms.pressed(page, undone, "/api/tuning/undo")
        expect(box).to_have_value(f"{before[name]:.3f}")
        assert stage.in_force() == before

    change.__name__ = f"{BOXES[symbol]} on Operate"
    return change


def a_trial(stage: Stage) -> None:
    """Staged changes are active for the stated time, and then reverted."""
    page, before = stage.page, stage.in_force()
    stage.operator.go("Operate")
    page.get_by_role("switch", name="Stage changes").check()
    stage.operator.enter("λ_q value [s]", 0.83)
    page.get_by_role("textbox", name=OPERATE["trialDuration"], exact=True).fill("60")
    assert stage.in_force() == before
    sent, told = forms.pressed(page, page.get_by_role("button", name="Try for", exact=True), "/api/tuning/trial")
    assert sent == {"lam_q": 0.83, "duration_s": 60.0}
    assert 59.0 < told["trial"]["remaining_s"] <= 60.0
    expect(page.get_by_role("status", name="Trial", exact=True)).to_contain_text(
        OPERATE["trialReverts"]
        .partition("{others}")[0]
        .format(lam_q=f"{before['lam_q']:.3f}", lam_S=f"{before['lam_S']:.3f}")
    )
    assert differences(stage.in_force(), {**before, "lam_q": 0.83}) == []
    page.get_by_role("button", name="Revert now").click()
    stage.operator.wait(lambda: stage.in_force() == before)
    page.get_by_role("region", name=OPERATE["tuningChanges"]).get_by_role("button", name="Discard", exact=True).click()
    page.get_by_role("switch", name="Stage changes").uncheck()


def a_push(stage: Stage) -> None:
    """A push has the entered values, also in the recording."""
    page = stage.page
    stage.operator.go("Operate")
    stage.operator.press("Run")
    stage.operator.wait(lambda: stage.get("/api/state")["recording_run"] is not None)
    run = int(stage.get("/api/state")["recording_run"])
    stage.operator.enter("Push [N]", -4.5)
    stage.operator.enter(OPERATE["pushDuration"], 6.0)
    group = page.get_by_role("group", name="Push", exact=True)
    sent, _ = forms.pressed(page, group.get_by_role("button", name="Push", exact=True), "/api/push")
    assert sent == {"F_push": -4.5, "duration_s": 6.0}
    felt = page.get_by_text(OPERATE["pushing"].format(force="\u22124.5"))
    expect(felt).to_be_visible()
    expect(felt).to_be_hidden(timeout=MOTION_TIMEOUT_MS)
    stage.operator.press("Pretension")
    stage.rest()
    stage.operator.wait(lambda: stage.get(f"/api/runs/{run}")["end_state"] != "running")  # the last samples are stored
    samples = stage.recorded(run, "F_push")
    pushed = [t for t, F_push in samples if F_push != 0.0]
    assert {F_push for _, F_push in samples} == {0.0, -4.5}
    assert 5.5 < pushed[-1] - pushed[0] < 6.0  # a busy machine skips ticks, also at both ends


def a_wall(stage: Stage) -> None:
    """An obstacle has the entered position."""
    page = stage.page
    stage.operator.go("Operate")
    stage.operator.enter(OPERATE["wallAngle"].format(unit="°"), -40.0)
    stage.operator.enter(OPERATE["wallStiffness"], 8000.0)
    stage.operator.enter(OPERATE["wallDamping"], 2.25)
    group = page.get_by_role("group", name="Wall", exact=True)
    group.get_by_role("combobox", name=OPERATE["wallSide"]).select_option("below")
    sent, _ = forms.pressed(page, group.get_by_role("button", name=OPERATE["addWall"], exact=True), "/api/wall")
    wanted = {"side": "below", "k_wall": 8000.0, "c_wall": 2.25, "q_wall": pytest.approx(-40.0 * TO_SI["°"][1])}
    assert sent["wall"] == wanted
    expect(page.get_by_text(OPERATE["wallBelow"].format(angle="\u221240.0°"))).to_be_visible()
    assert stage.get("/api/state")["wall"] == wanted
    forms.pressed(page, group.get_by_role("button", name=OPERATE["removeWall"], exact=True), "/api/wall")
    stage.operator.wait(lambda: stage.get("/api/state")["wall"] is None)


DONE: dict[str, tuple[Callable[[Stage], None], ...]] = {
    "fresh": (all_forms, run_of("robustness"), run_of("motor"), lambda_on_operate("λ_S", 0.66)),
    "bank in force": (all_forms, run_of("tracking"), run_of("spring"), a_trial),
    "after an experiment": (all_forms, run_of("compliance"), a_push),
    "after a restart": (
        all_forms,
        run_of("tracking"),
        run_of("lambda_sweep"),
        run_of("actuator"),
        lambda_on_operate("λ_q", 0.71),
        a_wall,
    ),
}
"""What is done in each state. Tracking, with the most settings, is run in two; the others take their turn."""


def test_every_kind_is_run_in_a_state_and_every_state_checks_all_forms() -> None:
    assert tuple(DONE) == STATES
    assert all(done[0] is all_forms for done in DONE.values())
    assert {one.__name__ for done in DONE.values() for one in done} >= {*EXPERIMENTS, *IDENTIFICATIONS}


@pytest.mark.parametrize(
    ("state", "done"),
    [pytest.param(state, one, id=f"{state}-{one.__name__}") for state in STATES for one in DONE[state]],
)
def test_forms_show_the_values_that_they_send(stage: Stage, state: str, done: Callable[[Stage], None]) -> None:
    stage.bring(state)
    done(stage)


def test_a_viewers_forms_show_the_active_values_and_send_only_dry_runs(stage: Stage, browser: Browser) -> None:
    stage.bring("after a restart")
    own = stage.in_force()
    page = viewer_of(stage, browser)
    page.get_by_role("link", name="Experiments", exact=True).click()
    for kind in EXPERIMENTS:
        about = declared(stage, kind)
        page.get_by_role("combobox", name=EXPERIMENT_TEXTS["kindOfExperiment"], exact=True).select_option(kind)
        form = page.get_by_role("form", name=about["title"], exact=True)
        assert undeclared(stage, form, about["settings"], own) == []
        deciding = [one.inner_text() for one in form.get_by_role("button").all() if one.inner_text()]
        assert set(deciding) <= {EXPERIMENT_TEXTS["dryRun"]}
    forms.fill(form, {"count": 2.0, "hold_s": 1.0})
    shown = forms.shown(form)
    page.set_default_timeout(DRY_RUN_TIMEOUT_MS)
    sent, played = forms.pressed(page, form.get_by_role("button", name=EXPERIMENT_TEXTS["dryRun"]), "/dry-run")
    assert differences(forms.as_sent(shown, sent["settings"]), sent["settings"], ROUNDED) == []
    assert differences(played["settings"], sent["settings"]) == []
    expect(page.get_by_role("region", name=EXPERIMENT_TEXTS["dryRun"], exact=True)).to_contain_text(words_of(own))
    page.get_by_role("link", name="Identify", exact=True).click()
    expect(page.get_by_text(IDENTIFY_TEXTS["forOperators"])).to_be_visible()
    assert page.get_by_role("main").get_by_role("form").count() == 0
    page.context.close()


def viewer_of(stage: Stage, browser: Browser) -> Page:
    page = browser.new_context(viewport=DESKTOP).new_page()
    page.goto(stage.service.url)
    page.get_by_role("textbox", name="Token").fill((stage.service.data / "viewer-token").read_text().strip())
    page.get_by_role("button", name="Sign in").click()
    expect(page.get_by_role("img", name="Viewer")).to_have_text("VIEW")
    return page
