"""The tutorial docs/tutorial/first-hour.md, from slack tendons to a tuned controller and a report, by keyboard.

The steps follow the tutorial on the simulator, with the shortest runs that suffice. The service is queried for the
result of each step.
"""

import math
import re
import subprocess
import sys
from collections.abc import Mapping
from functools import partial
from pathlib import Path
from typing import Any

import pytest
from playwright.sync_api import expect

from tests.e2e.forms import REPORT_TIMEOUT_MS
from tests.e2e.keyboard import Keys
from tests.e2e.operator import Operator
from tests.e2e.page_texts import load_texts
from tests.e2e.service import Service

IDENTIFY_TEXTS = load_texts("pages/identify")
OPERATE = load_texts("pages/operate")
SHARED = load_texts("components")

RUN_TIMEOUT_MS = 240_000
CLI_S = 120.0


@pytest.fixture(scope="module")
def service(fresh_service: Service) -> Service:
    return fresh_service


def get(operator: Operator, path: str) -> Any:
    answer = operator.page.request.get(f"{operator.service.url}{path}")
    assert answer.ok, answer.text()
    return answer.json()


@pytest.mark.timeout(1200)  # five runs in real time; each wait has its own timeout
def test_the_first_hour_tutorial_is_completed_with_the_keyboard(operator: Operator, tmp_path: Path) -> None:
    operator.sign_in()
    keys = Keys(operator.page)
    look_around(operator, keys)
    pretension(operator, keys)
    move_the_joint(operator, keys)
    identified(operator, keys, 1, {"u_low": 2.5, "levels": 2, "step_s": 1.5, "settle_s": 0.5})
    identified(operator, keys, 2, {"sweep_s": 20, "cycles": 1, "settle_s": 0.5})
    run = identified(operator, keys, 0, {"tension_N": 20, "bits": 6, "settle_s": 3})
    build_a_bank(operator, keys, run)
    tune(operator, keys)
    run_an_experiment(operator, keys)
    take_a_report_home(operator, keys, tmp_path / "report.html")
    set_up_is_done(operator, keys)
    assert keys.stops > 100


def look_around(operator: Operator, keys: Keys) -> None:
    keys.use("Skip tour")
    keys.shortcut("o", "Operate")
    state = operator.state()
    assert (state["plant"]["kind"], state["mode"]) == ("simulator", "off")
    keys.press("Control+Shift+E")
    operator.expect_mode("tripped")
    state = operator.state()
    assert (state["mode"], state["fault"]["code"]) == ("tripped", "stop_pressed")
    assert state["stop_proof"]["zero_tick"] - state["stop_proof"]["arrived_tick"] <= 2
    keys.use("Reset")
    operator.expect_mode("off")
    assert operator.state()["fault"] is None
    keys.shortcut("g", "Glossary")
    keys.shortcut("o", "Operate")


def reads(operator: Operator, figure: str, signal: str, wanted: float, within: float) -> bool:
    return abs(operator.reading(figure, signal) - wanted) < within


def pretension(operator: Operator, keys: Keys) -> None:
    keys.use("Pretension")
    operator.wait(lambda: bool(operator.state()["pretension_done"]))
    for force in ("F_A", "F_B"):
        operator.wait(partial(reads, operator, "Tendon force", force, 10.0, 1.0))
    keys.use("Run")
    operator.expect_mode("run")
    operator.wait(lambda: operator.state()["recording_run"] is not None)


def move_the_joint(operator: Operator, keys: Keys) -> None:
    for box, value in (("q_ref value [°]", "30"), ("S_ref value [N·m/rad]", "12")):
        keys.to(box)
        keys.write(value)
        keys.press("Enter")
    operator.wait(lambda: operator.state()["references"]["S_ref"] == pytest.approx(12.0))
    assert operator.state()["references"]["q_ref"] == pytest.approx(math.radians(30.0))
    operator.wait(partial(reads, operator, "Joint position", "q", 30.0, 0.3))
    operator.wait(partial(reads, operator, "Joint stiffness", "S", 12.0, 0.2))
    keys.shortcut("h", "Log")
    told = [entry["text"] for entry in get(operator, "/api/log?kind=references")["entries"]]
    assert len(told) == 2
    expect(operator.page.get_by_role("table", name="Log")).to_contain_text("q_ref 30°, S_ref 12 N·m/rad")


def identified(operator: Operator, keys: Keys, place: int, settings: Mapping[str, float]) -> int:
    """Identify with the kind at this position of the choice; return the run, whose list entry states its end."""
    page = operator.page
    keys.shortcut("i", "Identify")
    before = {one["id"] for one in get(operator, "/api/identifications")["identifications"]}
    told = get(operator, "/api/identification-kinds")["kinds"]
    radios = page.get_by_role("radiogroup", name=IDENTIFY_TEXTS["kind"]).get_by_role("radio")
    expect(radios).to_have_count(3)
    keys.to(re.compile(f"^({'|'.join(one['title'] for one in told)})$"))
    for _ in range(len(told)):
        if not radios.nth(place).is_checked():
            keys.press("ArrowRight")
    expect(radios.nth(place)).to_be_checked()
    keys.fill(dict(settings), IDENTIFY_TEXTS["newIdentification"])
    start = page.get_by_role("button", name=IDENTIFY_TEXTS["start"])
    expect(start).not_to_have_attribute("aria-disabled", "true")
    keys.use(IDENTIFY_TEXTS["start"])

    def over() -> bool:
        found = [one for one in get(operator, "/api/identifications")["identifications"] if one["id"] not in before]
        return bool(found) and found[0]["status"] != "running" and operator.state()["task"] is None

    operator.wait(over, RUN_TIMEOUT_MS)
    (one,) = [one for one in get(operator, "/api/identifications")["identifications"] if one["id"] not in before]
    assert (one["kind"], one["status"]) == (told[place]["kind"], "completed"), one["message"]
    assert one["usable"], one["message"]
    link = IDENTIFY_TEXTS["runLink"].format(run=one["id"])
    row = page.get_by_role("table", name=IDENTIFY_TEXTS["runs"]).get_by_role("row").filter(has_text=link)
    expect(row).to_contain_text("Completed")
    expect(page.get_by_role("region", name=IDENTIFY_TEXTS["result"], exact=True)).to_contain_text(link)
    return int(one["id"])


def build_a_bank(operator: Operator, keys: Keys, run: int) -> None:
    keys.use(IDENTIFY_TEXTS["useRun"].format(run=run), key="Space")
    keys.fill({"name": "first"}, IDENTIFY_TEXTS["bankFromRuns"])
    keys.use(IDENTIFY_TEXTS["buildBank"])
    operator.wait(lambda: len(get(operator, "/api/banks")["banks"]) == 1)
    (bank,) = get(operator, "/api/banks")["banks"]
    assert (bank["name"], [entry["identification"] for entry in bank["entries"]]) == ("first", [run])
    keys.use(IDENTIFY_TEXTS["activateBank"].format(bank="first v1"))
    operator.wait(lambda: (operator.state()["tuning"]["bank"] or {}).get("id") == bank["id"])
    keys.shortcut("b", "Banks")
    expect(operator.page.get_by_role("status", name=load_texts("pages/banks")["activeTuning"])).to_contain_text(
        "bank first v1"
    )


def tune(operator: Operator, keys: Keys) -> None:
    """Tune with the arrow keys on the slider, a push, and a trial that is ended; then save."""
    page = operator.page
    keys.shortcut("o", "Operate")
    keys.use("Run")
    operator.expect_mode("run")
    for slider, name in (("λ_q", "lam_q"), ("λ_S", "lam_S")):
        before = operator.state()["tuning"][name]
        keys.to(slider)
        keys.press("ArrowRight", times=5)
        operator.wait(partial(is_raised, operator, f"{slider} value [s]", name, before))
        expect(page.get_by_role("group", name=OPERATE["preview"].format(symbol=slider))).to_contain_text(
            OPERATE["sensitivityPeak"]
        )
    keys.use("Push", region="Push")
    operator.wait(lambda: any(one["text"].startswith("push of 10.0 N") for one in log(operator)))
    try_and_keep(operator, keys)
    keys.use("Save", region=OPERATE["tuningChanges"])
    operator.wait(lambda: get(operator, "/api/tuning/saved")["who"] is not None)
    saved, tuning = get(operator, "/api/tuning/saved"), operator.state()["tuning"]
    assert all(saved[name] == tuning[name] for name in ("lam_q", "lam_S", "lam_motor", "b", "motion", "u_plan"))


def is_raised(operator: Operator, box: str, name: str, before: float) -> bool:
    """Return whether λ has increased and its box shows the active value."""
    shown = float(operator.page.get_by_role("textbox", name=box).input_value())
    told: float = operator.state()["tuning"][name]
    return told > before and abs(shown - told) < 6e-4


def try_and_keep(operator: Operator, keys: Keys) -> None:
    """Stage a λ, try it, and revert it; the earlier tuning is active again."""
    before = operator.state()["tuning"]["lam_q"]
    keys.use("Stage changes", key="Space")
    keys.to("λ_q value [s]")
    keys.write("0.9")
    keys.press("Enter")
    keys.use("Try for")
    operator.wait(lambda: operator.state()["trial"] is not None)
    assert operator.state()["tuning"]["lam_q"] == pytest.approx(0.9)
    operator.wait(lambda: operator.state()["trial"] is None)
    assert operator.state()["tuning"]["lam_q"] == before
    keys.use("Discard")
    keys.use("Stage changes", key="Space")
    assert operator.state()["tuning"]["lam_q"] == before


def log(operator: Operator) -> list[dict[str, Any]]:
    return list(get(operator, "/api/log?limit=30")["entries"])


def run_an_experiment(operator: Operator, keys: Keys) -> None:
    page = operator.page
    keys.shortcut("e", "Experiments")
    form = "Tracking of position and stiffness"
    expect(page.get_by_role("form", name=form)).to_be_visible()
    keys.fill({"q_duration_s": 4, "S_duration_s": 4}, form)
    keys.use("Dry run")
    expect(page.get_by_role("region", name="Dry run")).to_be_visible(timeout=RUN_TIMEOUT_MS)
    keys.use(re.compile("^Start tracking"))
    operator.wait(lambda: operator.state()["task"] is not None)
    run = operator.state()["task"]["run"]
    operator.wait(lambda: operator.state()["task"] is None, RUN_TIMEOUT_MS)
    told = get(operator, f"/api/experiments/{run}")
    assert (told["status"], told["settings"]["q_duration_s"]) == ("completed", 4)
    criteria = page.get_by_role("table", name="Criteria", exact=True)
    expect(criteria).to_be_visible()
    shown = [row.get_by_role("cell").all_inner_texts() for row in criteria.get_by_role("row").all()[1:]]
    assert len(shown) == len(told["criteria"])
    for cells, criterion in zip(shown, told["criteria"], strict=True):
        wanted = {True: "pass", False: "fail", None: "not measured"}[criterion["passed"]]
        assert any(wanted in cell for cell in cells), (cells, criterion)


def take_a_report_home(operator: Operator, keys: Keys, file: Path) -> None:
    """Download the report by keyboard: one file, from which every number can be computed again."""
    page = operator.page
    keys.to("Report (HTML)")
    with page.context.expect_page(timeout=REPORT_TIMEOUT_MS) as opened:
        keys.press("Enter")
    opened.value.wait_for_url(re.compile(r"report\.html$"), timeout=REPORT_TIMEOUT_MS)
    answer = page.request.get(opened.value.url, timeout=REPORT_TIMEOUT_MS)
    assert answer.ok, answer.text()
    opened.value.close()
    file.write_bytes(answer.body())
    words = [sys.executable, "-m", "backend", "report", "verify", str(file), "--data", str(operator.service.data)]
    verified = subprocess.run(words, check=False, capture_output=True, text=True, timeout=CLI_S)
    assert verified.returncode == 0, verified.stdout + verified.stderr
    keys.shortcut("r", "Runs")
    runs = get(operator, "/api/runs?limit=50&offset=0")["runs"]
    expect(operator.page.get_by_role("table", name=load_texts("pages/runs")["table"]).get_by_role("row")).to_have_count(
        len(runs) + 1
    )


def set_up_is_done(operator: Operator, keys: Keys) -> None:
    """Compare the setup list with the service; all steps but pretension are done."""
    keys.press("c")
    steps = operator.page.get_by_role("list", name=SHARED["setupSteps"]).get_by_role("listitem")
    told = get(operator, "/api/checklist")["steps"]
    expect(steps).to_have_count(len(told))
    assert [step.get_attribute("data-state") for step in steps.all()] == [one["state"] for one in told]
    undone = [one["name"] for one in told if one["state"] != "done"]
    assert undone in ([], ["pretension"]), told
    keys.press("Escape")
