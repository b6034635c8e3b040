"""Differences between a form and its declaration, the queue, the run, the database and the report."""

import time
from typing import Any

from playwright.sync_api import Locator

from backend.experiments.library import READY_NAMES, load_ready_experiment
from backend.experiments.parser import to_canonical_text
from tests.e2e import forms
from tests.e2e.forms import ROUNDED, TO_SI, Values, differences
from tests.e2e.operator import MOTION_TIMEOUT_MS
from tests.e2e.page_texts import load_texts
from tests.e2e.stage import OWN, Stage

EXPERIMENT_TEXTS = load_texts("pages/experiments")

_TUNING = {*OWN, "bank"}


def undeclared(stage: Stage, form: Locator, settings: list[dict[str, Any]], in_force: Values) -> list[str]:
    """Return the fields of a form that differ from their declaration or from the active values."""
    deadline = time.monotonic() + MOTION_TIMEOUT_MS / 1000
    while (wrong := undeclared_now(form, settings, in_force)) and time.monotonic() < deadline:
        stage.page.wait_for_timeout(50)
    return wrong


def undeclared_now(form: Locator, settings: list[dict[str, Any]], in_force: Values) -> list[str]:
    fields = forms.fields(form)
    wrong = []
    for setting in settings:
        name = setting["name"]
        if name not in fields and setting["minimum"] == setting["maximum"]:
            continue  # without a choice there is no field
        field = fields[name]
        unit = TO_SI.get(field.unit, (field.unit, 1.0))[0]
        if unit != setting["unit"]:
            wrong.append(f"unit of {name}: {field.unit}, {setting['unit']}")
        if name in in_force and not (
            forms.same(field.value, in_force[name])
            and any(word in field.about for word in ("in force", EXPERIMENT_TEXTS["active"]))
        ):
            wrong.append(f"{name}: {field.value!r} ({field.about}), in force {in_force[name]!r}")
    if "bank" in fields:
        chosen = "geometric gains" if in_force["bank"] == 0 else "bank forms v1"
        wrong += [] if fields["bank"].text == chosen else [f"bank: {fields['bank'].text}, in force {chosen}"]
    elif words_of(in_force) not in form.inner_text():
        wrong.append(f"tuning in words: {words_of(in_force)} is not in {form.inner_text()!r}")
    return wrong


def words_of(tuning: Values) -> str:
    """Return the tuning as the form of an identification describes it."""
    models = "geometric gains" if tuning["bank"] == 0 else "bank forms v1"
    between = ", interpolating between operating points" if tuning["interpolate"] else ""
    motion = "lambda motion"
    if tuning["motion"] == "time-optimal":
        motion = f"time-optimal motion within {tuning['u_plan']:g} V"
    parts = (f"λ_{name} {tuning[f'lam_{name}']} s" for name in ("q", "S", "motor"))
    return f"{', '.join(parts)}, b {tuning['b']:g}, {models}{between}, {motion}"


def not_stored(stage: Stage, run: int, path: str, settings: Values) -> list[str]:
    """Return what differs in the service, the database or the report of a run."""
    told_of = stage.get(f"/api/runs/{run}")
    told, kept = told_of["settings"], stage.stored(run)
    written = kept.pop("experiment", None)
    url = f"{stage.service.url}/api/runs/{run}/report.html"
    printed = forms.reported(stage.browser, stage.page, url)
    in_print = {one["name"]: value for one, (_, value) in zip(told, printed, strict=True)}
    meant = [
        f"{words} for {one['meaning']}"
        for one, (words, _) in zip(told, printed, strict=True)
        if words.replace("_", "") != one["meaning"].replace("_", "")
    ]
    used = _used(settings, told_of["title"], is_identification="identifications" in path)
    return [
        f"{where}: {wrong}"
        for where, found in (
            ("view", differences(stage.get(f"{path}/{run}")["settings"], settings)),
            ("run", differences({one["name"]: one["value"] for one in told}, used)),
            ("database", differences(kept, settings)),
            ("experiment", [] if written == _written(told_of["kind"], told_of["title"]) else [str(written)]),
            ("report", [*meant, *differences(in_print, used, ROUNDED)]),
        )
        for wrong in found
    ]


def _used(settings: Values, title: str, *, is_identification: bool) -> Values:
    """Return the settings without the parts of the tuning that the control law does not use."""
    unused: set[str] = set()
    if settings["motion"] == "lambda":
        unused |= {"u_plan"}
    if title.lower().startswith("compliance"):
        unused |= {"lam_q", "k_ext"}
    if settings.get("controller") in ("single-loop", "feedback-linearization"):
        unused |= _TUNING - {"lam_q", "lam_S"}
    if is_identification:
        unused |= _TUNING - {"lam_motor"}
    return {name: value for name, value in settings.items() if name not in unused}


def _written(kind: str, title: str) -> str | None:
    """Return what a run stores of its experiment: the complete text, if it has one."""
    known = [load_ready_experiment(name)[0] for name in READY_NAMES]
    return next(
        (to_canonical_text(one) for one in known if kind == one.name or (kind, title) == ("experiment", one.title)),
        None,
    )


def not_queued(stage: Stage, form: Locator) -> list[str]:
    """Return what differs between the queue and the form."""
    shown = forms.shown(form)
    sent, queue = forms.pressed(stage.page, form.get_by_role("button", name=EXPERIMENT_TEXTS["addToQueue"]), "/queue")
    waiting = queue["items"][-1]
    stage.page.get_by_role("button", name=f"Remove experiment {waiting['id']} from the queue").click()
    meant = forms.as_sent(shown, sent["settings"])
    return [*differences(meant, sent["settings"], ROUNDED), *differences(waiting["settings"], sent["settings"])]
