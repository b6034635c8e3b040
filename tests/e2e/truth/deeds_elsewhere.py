"""Actions of the robot outside of Operate: runs, banks, notes, control, STOP, and navigation."""

from collections.abc import Callable

from backend.models.run import MOTIONS
from tests.e2e.page_texts import load_texts
from tests.e2e.truth.deeds import Deed, Scene, Value, pressing
from tests.e2e.truth.drafts import TRACKING
from tests.e2e.truth.legality import may_retune
from tests.e2e.truth.moment import DRY_RUN

EXPERIMENT_TEXTS = load_texts("pages/experiments")

WAYS = ("Operate", "Identify", "Banks", "Experiments", "Studies", "Runs", "Log", "System")
ADDRESSES = ("docs", "docs/first-hour", "glossary", "system/developer", "bring-up", "runs/metrics")
"""Pages that no link of the navigation leads to."""

BUSY = frozenset({429})
"""Another page has something played: no state tells it."""

DRY_RUN_TIMEOUT_MS = 600_000
"""The first dry run of a service starts the process that plays it."""

TEXTS = load_texts("pages/log")
IDENTIFY_TEXTS = load_texts("pages/identify")
UNDO_VERSION = IDENTIFY_TEXTS["undo"].split("{")[0]
BANKS = load_texts("pages/banks")
ACTIVATE = BANKS["activateBank"].split("{")[0]
OPERATE = load_texts("pages/operate")


def always(_scene: Scene) -> bool:
    return True


def _fill(scene: Scene, form: str, values: dict[str, str]) -> None:
    for name, value in values.items():
        scene.main.locator(f"form[aria-label='{form}'] [name={name}]").fill(value)


def _offers_queue(scene: Scene) -> bool:
    return (
        scene.shown.offers(EXPERIMENT_TEXTS["addToQueue"])
        and len(scene.shown.all["lists"].get(EXPERIMENT_TEXTS["queue"], [])) < 3
    )


def _short(scene: Scene) -> None:
    _fill(scene, TRACKING, {"q_duration_s": "2", "S_duration_s": "2"})


def _set_loop(scene: Scene) -> None:
    """Change some of the loop settings in the form of the experiment."""
    tuning, chance = scene.state["own_tuning"] or scene.state["tuning"], scene.chance
    values: dict[str, str | bool] = {
        "lam_motor": f"{chance.uniform(scene.state['tuning']['lam_motor_min'] + 1e-3, 0.15):.4f}",
        "b": f"{chance.uniform(0.0, 1.0):.2f}",
        "interpolate": not tuning["interpolate"],
        "motion": next(one for one in MOTIONS if one != tuning["motion"]),
        "u_plan": f"{chance.uniform(scene.state['tuning']['u_plan_min'] + 0.05, 8.0):.1f}",
    }
    chosen = {name: values[name] for name in chance.sample(sorted(values), chance.randint(0, len(values)))}
    scene.say(f"settings of the loop {chosen}")
    form = scene.main.locator(f"form[aria-label='{TRACKING}']")
    for folded in form.locator("details:not([open]) > summary").all():
        folded.click()
    for name, value in chosen.items():
        box = form.locator(f"[name={name}]")
        if isinstance(value, bool):
            box.set_checked(value)
        elif name == "motion":
            box.select_option(value)
        else:
            box.fill(value)


def _dry_run(scene: Scene) -> None:
    """Start a dry run of the experiment and wait for its result, which is then compared with the service."""
    _short(scene)
    _set_loop(scene)
    with scene.page.expect_response(f"**{DRY_RUN}", timeout=DRY_RUN_TIMEOUT_MS):
        scene.press(EXPERIMENT_TEXTS["dryRun"])


def _retune_by_script(scene: Scene) -> None:
    """Change parts of the tuning that no page offers, by a script that releases control afterwards."""
    chance, tuning = scene.chance, scene.state["tuning"]
    values = {
        "lam_motor": round(chance.uniform(tuning["lam_motor_min"] + 1e-3, 0.12), 4),
        "b": round(chance.uniform(0.0, 1.0), 2),
        "interpolate": not tuning["interpolate"],
    }
    chosen = {name: values[name] for name in chance.sample(sorted(values), chance.randint(1, len(values)))}
    answer = scene.around.script.put("/api/tuning", json=chosen)
    scene.say(f"{chosen}: {answer.status_code}")
    if scene.around.state()["holder"] is not None:
        scene.around.script.delete("/api/control")


def _nobody_tunes(scene: Scene) -> bool:
    return scene.state["holder"] is None and may_retune(scene.state)


def _undo_version(scene: Scene) -> None:
    scene.press(next(one.name for one in scene.shown.buttons if one.name.startswith(UNDO_VERSION)))


def _experiment(scene: Scene) -> None:
    _short(scene)
    _set_loop(scene)
    name = next(one.name for one in scene.shown.buttons if one.name.startswith("Start tracking"))
    scene.press(name)


def _queue(scene: Scene) -> None:
    _short(scene)
    _set_loop(scene)
    scene.press(EXPERIMENT_TEXTS["addToQueue"])


def _unqueue(scene: Scene) -> None:
    names = [one.name for one in scene.shown.buttons if one.name.startswith("Remove experiment ")]
    scene.press(scene.chance.choice(names))


def _motors(scene: Scene) -> None:
    scene.say("motors, two short steps")
    scene.main.get_by_role("radiogroup", name=IDENTIFY_TEXTS["kind"]).get_by_text("Motors", exact=True).click()
    _fill(scene, IDENTIFY_TEXTS["newIdentification"], {"levels": "2", "step_s": "0.3", "settle_s": "0.5"})
    start = scene.button(IDENTIFY_TEXTS["start"])
    scene.page.wait_for_timeout(600)  # until the forecast of the current form is shown
    if start.get_attribute("aria-disabled") != "true":
        start.click()


def _activate(scene: Scene) -> None:
    names = [one.name for one in scene.shown.buttons if one.name.startswith(ACTIVATE) and one.enabled]
    scene.press(scene.chance.choice(names))


def _note(scene: Scene) -> None:
    pencils = scene.main.get_by_role("button", name=TEXTS["edit"].split("{")[0])
    words = f"seen {scene.chance.randrange(1000)}"
    scene.say(f"note {words!r}")
    pencils.nth(scene.chance.randrange(min(5, pencils.count()))).click()
    scene.page.get_by_role("textbox", name="Note on the event").fill(words)
    scene.page.get_by_role("textbox", name="Tags of the event").press("Enter")


def _go(scene: Scene) -> None:
    name = scene.chance.choice(WAYS)
    scene.say(name)
    scene.page.get_by_role("navigation", name="Main").get_by_role("link", name=name, exact=True).click()


def _go_by_address(scene: Scene) -> None:
    """Open a page by its address: a document, or the target of a list."""
    runs = scene.around.script.get("/api/runs?limit=5").raise_for_status().json()["runs"]
    flights = scene.around.script.get("/api/flights").raise_for_status().json()["flights"]
    found = [*ADDRESSES, *(f"runs/{one['id']}" for one in runs), *(f"flights/{one['id']}" for one in flights[:2])]
    address = scene.chance.choice(found)
    scene.say(address)
    scene.page.evaluate("address => { location.hash = '#/' + address; }", address)


def _back(scene: Scene) -> None:
    way = scene.chance.choice(("back", "forward"))
    scene.say(way)
    scene.page.evaluate(f"history.{way}()")
    scene.page.wait_for_timeout(300)
    if scene.page.url.startswith("about:"):  # before the first page of the application in the history
        scene.page.go_forward()
        scene.page.get_by_role("banner").wait_for()


def _go_by_key(scene: Scene) -> None:
    key = scene.chance.choice("oibetrhsdg")
    scene.say(key)
    scene.page.evaluate("document.activeElement?.blur()")
    scene.page.keyboard.press(key)


def _take_here(scene: Scene) -> None:
    scene.say("where it lacks")
    scene.page.get_by_role("button", name="Take control", exact=True).first.click()


def _stop(scene: Scene) -> None:
    if scene.chance.random() < 0.5:
        scene.say("by key")
        scene.page.keyboard.press("Control+Shift+E")
    else:
        scene.press("STOP")


def _control(scene: Scene) -> None:
    scene.page.get_by_role("button", name="Control: ").click()
    items = scene.page.get_by_role("menuitem")
    items.first.wait_for()
    wanted = [one for one in items.all_inner_texts() if one.startswith(("Take", "Give up"))]
    scene.say(wanted[0])
    scene.page.get_by_role("menuitem", name=wanted[0], exact=True).click()


def _reload(scene: Scene) -> None:
    scene.page.reload()
    scene.page.get_by_role("banner").wait_for()


def _scheme(scene: Scene) -> None:
    scene.page.get_by_role("button", name="Colour scheme").click()
    name = scene.chance.choice(("Light", "Dark", "System"))
    scene.say(name)
    scene.page.get_by_role("menuitem", name=name).click()


def _angles(scene: Scene) -> None:
    scene.page.get_by_role("button", name="Angles in ").click()


def _offers(start: str) -> Callable[[Scene], bool]:
    """Return whether a button with this prefix of its name is enabled."""
    return lambda scene: any(one.name.startswith(start) and one.enabled for one in scene.shown.buttons)


ELSEWHERE = (
    Deed("start a short experiment", "experiments", 4, _offers("Start tracking"), _experiment, Value),
    Deed("queue a short experiment", "experiments", 1.5, _offers_queue, _queue, Value),
    Deed(
        "take one out of the queue",
        "experiments",
        0.7,
        _offers(EXPERIMENT_TEXTS["removeFromQueue"].split("{")[0]),
        _unqueue,
    ),
    pressing(EXPERIMENT_TEXTS["startQueue"], "experiments", 1.5),
    pressing(EXPERIMENT_TEXTS["startQueueAgain"], "experiments", 1.5),
    pressing(EXPERIMENT_TEXTS["pauseQueue"], "experiments", 0.7),
    pressing(OPERATE["softAbort"], "experiments", 3),
    pressing(OPERATE["softAbort"], "identify", 1),
    Deed("identify the motors", "identify", 2, _offers(IDENTIFY_TEXTS["start"]), _motors, Value),
    Deed("dry run", "experiments", 3, _offers(EXPERIMENT_TEXTS["dryRun"]), _dry_run, Value | BUSY),
    pressing(EXPERIMENT_TEXTS["closeDryRun"], "experiments", 0.5),
    pressing(IDENTIFY_TEXTS["applyParameters"], "identify", 10, Value),
    Deed("undo a version of the parameters", "identify", 4, _offers(UNDO_VERSION), _undo_version, Value),
    Deed("retune by a script", None, 12, _nobody_tunes, _retune_by_script, Value),
    Deed(
        "activate a bank", "banks", 3, _offers(ACTIVATE), _activate, Value
    ),  # the models of the bank may allow other λ
    pressing(BANKS["useGeometric"], "banks", 1, Value),
    pressing("Undo change", "banks", 1),
    pressing("Redo change", "banks", 1),
    Deed("note in the log", "log", 2, _offers(TEXTS["edit"].split("{")[0]), _note),
    Deed("go", None, 6, always, _go),
    Deed("go by address", None, 4, always, _go_by_address),
    Deed("go by key", None, 2, always, _go_by_key),
    Deed("go back", None, 1, always, _back),
    Deed("take control", None, 4, lambda scene: scene.shown.offers("Take control"), _take_here),
    Deed("STOP", None, 2.5, always, _stop),
    pressing("Reset", None, 12),
    Deed("control", None, 2, always, _control),
    Deed("reload", None, 2, always, _reload),
    Deed("colour scheme", None, 1, always, _scheme),
    Deed("unit of angles", None, 1.5, always, _angles),
)
