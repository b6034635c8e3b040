"""For every form of the page: what is shown is what is sent, stored and reported, whatever was before.

Each test brings the service into its state by itself, so that it runs alone too.
"""

import json
import time
from collections.abc import Iterator
from functools import partial
from typing import Any

import pytest
from playwright.sync_api import Browser, Locator, Page, expect

from backend.experiments.composing.ready_made import NAMES, ready_made
from backend.experiments.composing.text import canonical
from tests.e2e import forms
from tests.e2e.browser import DESKTOP
from tests.e2e.forms import ROUNDED, TO_SI, Values, differences
from tests.e2e.operator import MOTION_TIMEOUT_MS
from tests.e2e.stage import (
    EXPERIMENTS,
    IDENTIFICATIONS,
    LASTING,
    OTHERS,
    STATES,
    Stage,
    declared,
    form_of,
    let_go,
    start,
)

DRY_RUN_TIMEOUT_MS = 120_000


@pytest.fixture(scope="module")
def stage(browser: Browser, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Stage]:
    opened = Stage(browser, tmp_path_factory.mktemp("data"))
    yield opened
    opened.close()
    assert opened.watched.complaints == []


@pytest.fixture(scope="module", params=STATES)
def state(stage: Stage, request: pytest.FixtureRequest) -> str:
    """Each state in turn; all tests of one before the next."""
    stage.bring(str(request.param))
    return str(request.param)


def undeclared(stage: Stage, form: Locator, settings: list[dict[str, Any]], in_force: Values) -> list[str]:
    """Name what a form shows otherwise than it is declared or in force, once the page has been told all."""
    deadline = time.monotonic() + MOTION_TIMEOUT_MS / 1000
    while (wrong := undeclared_now(form, settings, in_force)) and time.monotonic() < deadline:
        stage.page.wait_for_timeout(50)
    return wrong


def undeclared_now(form: Locator, settings: list[dict[str, Any]], in_force: Values) -> list[str]:
    fields = forms.fields(form)
    wrong = []
    for setting in settings:
        name = setting["name"]
        if name == "segments":
            continue
        field = fields[name]
        unit = TO_SI.get(field.unit, (field.unit, 1.0))[0]
        if unit != setting["unit"]:
            wrong.append(f"unit of {name}: {field.unit}, {setting['unit']}")
        if name in in_force and not (forms.same(field.value, in_force[name]) and "in force" in field.about):
            wrong.append(f"{name}: {field.value!r} ({field.about}), in force {in_force[name]!r}")
    if "bank" in fields:
        chosen = "gains from geometry" if in_force["bank"] == 0 else "bank forms v1"
        wrong += [] if fields["bank"].text == chosen else [f"bank: {fields['bank'].text}, in force {chosen}"]
    elif words_of(in_force) not in form.inner_text():
        wrong.append(f"tuning in words: {words_of(in_force)} is not in {form.inner_text()!r}")
    return wrong


def words_of(tuning: Values) -> str:
    """A tuning as the form of an identification, which has no fields for it, tells it."""
    models = "gains from geometry" if tuning["bank"] == 0 else "bank forms v1"
    between = ", interpolating between entries" if tuning["interpolate"] else ""
    plan = f", plan of {tuning['u_plan']:g} V" if tuning["u_plan"] else ""
    parts = (f"λ_{name} {tuning[f'lam_{name}']} s" for name in ("q", "S", "motor"))
    return f"{', '.join(parts)}, b {tuning['b']:g}, {models}{between}{plan}"


def not_kept(stage: Stage, run: int, path: str, settings: Values) -> list[str]:
    """Name what service, database or report tell otherwise of a run."""
    told_of = stage.get(f"/api/runs/{run}")
    told, kept = told_of["settings"], stage.stored(run)
    written = kept.pop("experiment", None)
    url = f"{stage.service.url}/api/runs/{run}/report.html"
    printed, segments = forms.reported(stage.browser, stage.page, url)
    in_rows = [one for one in told if one["name"] != "segments"]
    in_print = {one["name"]: value for one, (_, value) in zip(in_rows, printed, strict=True)}
    meant = [
        f"{words} for {one['meaning']}"
        for one, (words, _) in zip(in_rows, printed, strict=True)
        if words.replace("_", "") != one["meaning"].replace("_", "")
    ]
    if segments:
        in_print["segments"] = json.dumps(segments)
    return [
        f"{where}: {wrong}"
        for where, found in (
            ("view", differences(stage.get(f"{path}/{run}")["settings"], settings)),
            ("run", differences({one["name"]: one["value"] for one in told}, settings)),
            ("database", differences(kept, settings)),
            ("experiment", [] if written == _written(told_of["kind"], told_of["title"]) else [str(written)]),
            ("report", [*meant, *differences(in_print, settings, ROUNDED)]),
        )
        for wrong in found
    ]


def _written(kind: str, title: str) -> str | None:
    """What a run keeps of the experiment that it plays: the whole text of it, where it is one."""
    known = [ready_made(name)[0] for name in NAMES]
    return next(
        (canonical(one) for one in known if kind == one.name or (kind, title) == ("experiment", one.title)), None
    )


def not_queued(stage: Stage, form: Locator) -> list[str]:
    """Name what waits in the queue otherwise than the form shows it."""
    shown = forms.shown(form)
    sent, queue = forms.pressed(stage.page, form.get_by_role("button", name="Add to queue"), "/queue")
    waiting = queue["items"][-1]
    stage.page.get_by_role("button", name=f"Remove experiment {waiting['id']} from the queue").click()
    return [*differences(shown, sent["settings"], ROUNDED), *differences(waiting["settings"], sent["settings"])]


def test_every_form_is_what_runs(stage: Stage, state: str) -> None:
    assert {one["name"] for one in stage.get("/api/experiments")["experiments"]} == {*EXPERIMENTS, *OTHERS}
    assert {one["kind"] for one in stage.get("/api/identification-kinds")["kinds"]} == set(IDENTIFICATIONS)
    own = stage.in_force()
    wrong: dict[str, list[str]] = {}
    for kind in OTHERS:
        form = form_of(stage, kind, {})
        wrong[f"form of {kind}"] = undeclared(stage, form, declared(stage, kind)["settings"], own)
    for kind in (*EXPERIMENTS, *IDENTIFICATIONS):
        path = "/api/identifications" if kind in IDENTIFICATIONS else "/api/experiments"
        form = form_of(stage, kind, LASTING[kind])
        wrong[f"form of {kind}"] = undeclared(stage, form, declared(stage, kind)["settings"], own)
        if kind in EXPERIMENTS:
            wrong[f"queue of {kind}"] = not_queued(stage, form)
        run, settings, wrong[f"order of {kind}"] = start(stage, form, path)
        let_go(stage, kind)
        # an identification runs with the tuning in force, which its form tells in words
        with_tuning = settings if kind in EXPERIMENTS else {**settings, **own, "seed": 0}
        wrong[f"run of {kind}"] = not_kept(stage, run, path, with_tuning)
        wrong[f"after {kind}"] = differences(stage.in_force(), own)
    assert {where: found for where, found in wrong.items() if found} == {}


def test_lambda_on_operate_is_what_is_in_force_kept_and_recorded(stage: Stage, state: str) -> None:
    """The boxes show what is in force; what is typed is sent, in force, in the next session's record, and is undone."""
    page, before = stage.page, stage.in_force()

    def in_force(wanted: Values) -> bool:
        return stage.in_force() == wanted

    stage.operator.go("Operate")
    for symbol, name, value in (("λ_q", "lam_q", 0.71), ("λ_S", "lam_S", 0.66)):
        box = page.get_by_role("textbox", name=f"{symbol} value [s]", exact=True)
        expect(box).to_have_value(f"{before[name]:.3f}")
        box.fill(str(value))
        with page.expect_request(lambda request: request.method == "PUT") as sent:
            box.press("Enter")
        assert sent.value.url.endswith("/api/tuning")
        assert sent.value.post_data_json == {name: value}
        stage.operator.wait(partial(in_force, {**before, name: value}))
        run = stage.session()
        assert differences(stage.stored(run), {**before, name: value}) == []
        undone = page.get_by_role("button", name="Undo change")
        _, answer = forms.pressed(page, undone, "/api/tuning/undo")
        assert answer[name] == before[name]
        expect(box).to_have_value(f"{before[name]:.3f}")
        assert stage.in_force() == before


def test_a_trial_is_what_is_staged_in_force_and_taken_back(stage: Stage, state: str) -> None:
    page, before = stage.page, stage.in_force()
    stage.operator.go("Operate")
    page.get_by_role("switch", name="Stage changes").check()
    stage.operator.enter("λ_q value [s]", 0.83)
    page.get_by_role("textbox", name="Length of the trial [s]", exact=True).fill("60")
    assert stage.in_force() == before
    sent, told = forms.pressed(page, page.get_by_role("button", name="Try for", exact=True), "/api/tuning/trial")
    assert sent == {"lam_q": 0.83, "duration_s": 60.0}
    assert 59.0 < told["trial"]["remaining_s"] <= 60.0
    expect(page.get_by_role("status", name="Trial", exact=True)).to_contain_text(
        f"back to {before['lam_q']:.3f}, {before['lam_S']:.3f} s"
    )
    assert differences(stage.stored(stage.session()), {**before, "lam_q": 0.83}) == []
    page.get_by_role("button", name="Revert now").click()
    stage.operator.wait(lambda: stage.in_force() == before)
    page.get_by_role("switch", name="Stage changes").uncheck()


def test_a_push_is_what_its_boxes_say(stage: Stage, state: str) -> None:
    page = stage.page
    stage.operator.go("Operate")
    stage.operator.press("Run")
    stage.operator.wait(lambda: stage.get("/api/state")["recording_run"] is not None)
    run = int(stage.get("/api/state")["recording_run"])
    stage.operator.enter("Push [N]", -4.5)
    stage.operator.enter("Push for [s]", 6.0)
    group = page.get_by_role("group", name="Push", exact=True)
    sent, _ = forms.pressed(page, group.get_by_role("button", name="Push", exact=True), "/api/push")
    assert sent == {"F_push": -4.5, "duration_s": 6.0}
    felt = page.get_by_text("Pushed with \u22124.5 N.")
    expect(felt).to_be_visible()
    expect(felt).to_be_hidden(timeout=MOTION_TIMEOUT_MS)
    stage.operator.press("Pretension")
    stage.operator.wait(lambda: stage.get(f"/api/runs/{run}")["end_state"] != "running")  # its last samples are stored
    samples = stage.recorded(run, "F_push")
    pushed = [t for t, F_push in samples if F_push != 0.0]
    assert {F_push for _, F_push in samples} == {0.0, -4.5}
    assert 5.5 < pushed[-1] - pushed[0] < 6.0  # a busy machine skips ticks, at either end too


def test_a_wall_is_what_its_boxes_say(stage: Stage, state: str) -> None:
    page = stage.page
    stage.operator.go("Operate")
    stage.operator.enter("Wall at [deg]", -40.0)
    stage.operator.enter("Stiffness of the wall [N/m]", 8000.0)
    stage.operator.enter("Damping of the wall [s/m]", 2.25)
    group = page.get_by_role("group", name="Wall", exact=True)
    group.get_by_role("combobox", name="Side of the wall").select_option("below")
    sent, _ = forms.pressed(page, group.get_by_role("button", name="Put up", exact=True), "/api/wall")
    wanted = {"side": "below", "k_wall": 8000.0, "c_wall": 2.25, "q_wall": pytest.approx(-40.0 * TO_SI["deg"][1])}
    assert sent["wall"] == wanted
    expect(page.get_by_text("A wall stands below \u221240.0")).to_be_visible()
    assert stage.get("/api/state")["wall"] == wanted
    forms.pressed(page, group.get_by_role("button", name="Take away", exact=True), "/api/wall")
    stage.operator.wait(lambda: stage.get("/api/state")["wall"] is None)


def test_a_viewers_forms_show_what_is_in_force_and_send_nothing_but_a_dry_run(stage: Stage, browser: Browser) -> None:
    stage.bring("after a restart")
    own = stage.in_force()
    page = viewer_of(stage, browser)
    page.get_by_role("link", name="Experiments", exact=True).click()
    for kind in EXPERIMENTS:
        about = declared(stage, kind)
        page.get_by_role("combobox", name="Kind of experiment", exact=True).select_option(kind)
        form = page.get_by_role("form", name=about["title"], exact=True)
        assert undeclared(stage, form, about["settings"], own) == []
        deciding = [one.inner_text() for one in form.get_by_role("button").all() if one.inner_text()]
        assert set(deciding) <= {"Dry run", "Add segment"}
    for number in (4, 3, 2):
        form.get_by_role("button", name=f"Remove segment {number}", exact=True).click()
    forms.fill_segment(form, 1, duration_s=0.5)
    shown = forms.shown(form)
    page.set_default_timeout(DRY_RUN_TIMEOUT_MS)
    sent, played = forms.pressed(page, form.get_by_role("button", name="Dry run"), "/dry-run")
    assert differences(shown, sent["settings"], ROUNDED) == []
    assert differences(played["settings"], sent["settings"]) == []
    expect(page.get_by_role("region", name="Dry run", exact=True)).to_contain_text(words_of(own))
    page.get_by_role("link", name="Identify", exact=True).click()
    expect(page.get_by_text("You are signed in as a viewer")).to_be_visible()
    assert page.get_by_role("main").get_by_role("form").count() == 0
    page.context.close()


def viewer_of(stage: Stage, browser: Browser) -> Page:
    page = browser.new_context(viewport=DESKTOP).new_page()
    page.goto(stage.service.url)
    page.get_by_role("textbox", name="Token").fill((stage.service.data / "viewer-token").read_text().strip())
    page.get_by_role("button", name="Sign in").click()
    expect(page.get_by_role("img", name="Viewer")).to_have_text("VIEW")
    return page
