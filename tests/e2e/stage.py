"""A service that passes through the states in which a form is used, with an operator at its forms.

The states are: fresh; an active bank with an own tuning; after an experiment with another tuning; after a restart of
the service. They follow each other on one data folder.
"""

import csv
import json
import re
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import httpx
from playwright.sync_api import Browser, Locator, Page, expect

from backend.storage import runs
from backend.storage.database import open_database
from tests.e2e import forms
from tests.e2e.browser import DESKTOP, Watched
from tests.e2e.forms import ROUNDED, Values, differences
from tests.e2e.operator import MOTION_TIMEOUT_MS, Operator
from tests.e2e.page_texts import load_texts
from tests.e2e.service import Service, running_service
from tests.e2e.sharing import give_up_control, sign_in_at

IDENTIFY_TEXTS = load_texts("pages/identify")
EXPERIMENT_TEXTS = load_texts("pages/experiments")
OPERATE = load_texts("pages/operate")

STATES = ("fresh", "bank in force", "after an experiment", "after a restart")
DRY_RUN_TIMEOUT_MS = 120_000

BANK = {
    "format": "sinew-bank",
    "version": 1,
    "name": "forms",
    "entries": [
        {"S_nominal": 10.55, "K_q": 0.05, "T_q": 0.342, "K_S": 0.7209, "T_S": 0.342, "tension_N": 20.0},
        {"S_nominal": 12.43, "K_q": 0.05, "T_q": 0.342, "K_S": 0.7209, "T_S": 0.342, "tension_N": 30.0},
    ],
}
OWN: Values = {
    "lam_q": 0.62,
    "lam_S": 0.55,
    "lam_motor": 0.09,
    "b": 0.25,
    "interpolate": True,
    "motion": "time-optimal",
    "u_plan": 7.5,
    "k_ext": 0.0,
}
"""A tuning of which every part differs from its default but k_ext, which no start of the service keeps."""

CHANGED: Values = {
    "q_amplitude": 0.6,
    "q_hold": 0.1,
    "S_hold": 10.5,
    "S_low": 9.0,
    "S_high": 12.0,
    "controller": "single-loop",
    "q_duration_s": 6.75,
    "S_duration_s": 5.5,
    "lam_q": 0.9,
    "lam_S": 0.8,
    "lam_motor": 0.0854,
    "b": 1.0,
    "bank": 0.0,
    "interpolate": False,
    "motion": "lambda",
    "u_plan": 6.5,
    "k_ext": 0.4,
}
"""Every field of a form at another value than what is in force or usual."""

EXPERIMENTS = ("tracking", "compliance", "robustness", "lambda_sweep")
"""Those that are started; the forms of the others are looked at."""

OTHERS = (
    "step_battery",
    "stiffness_sweep",
    "bank_comparison",
    "disturbance_battery",
    "frequency_response",
    "hold_at_rest",
    "impact",
    "motion_comparison",
)
IDENTIFICATIONS = ("actuator", "motor", "spring")
LASTING: dict[str, Values] = {
    "tracking": {"q_duration_s": 6.0, "S_duration_s": 5.0},
    "compliance": {"profile": "steps", "hold_s": 5.0},
    "robustness": {"hold_s": 10.0},
    "lambda_sweep": {"hold_s": 9.0},
    "actuator": {"tension_N": 12.0, "bits": 4.0, "periods": 1.0, "settle_s": 20.0},
    "motor": {"levels": 2.0, "step_s": 0.3, "settle_s": 5.0},
    "spring": {"sweep_s": 20.0, "cycles": 1.0, "settle_s": 0.5},
}
"""A program that goes on until it is ended, however late the page is to do so, by what is run."""


class Stage:
    """A service that can be restarted on its data folder, with an operator and a page."""

    def __init__(self, browser: Browser, data: Path) -> None:
        self.browser = browser
        self.reached = "fresh"
        self._data = data
        self._running = ExitStack()
        self._begin()

    def close(self) -> None:
        self.watched.page.context.close()
        self._running.close()

    def bring(self, state: str) -> None:
        """Pass through the states from the current one to ``state``."""
        while self.reached != state:
            self.reached = STATES[STATES.index(self.reached) + 1]
            match self.reached:
                case "bank in force":
                    self._use_bank()
                case "after an experiment":
                    self._run_another_tuning()
                case "after a restart":
                    self.close()
                    self._begin()
                case _:
                    raise ValueError(f"there is no state {self.reached!r}")
        self._hold()
        self.rest()

    def rest(self) -> None:
        """Release control and open a page without live charts, which need most of a processor.

        A page that is too busy to send heartbeats would stop the joint while it has control.
        """
        give_up_control(self.page)
        self.operator.go("Studies")

    def get(self, path: str) -> Any:
        answer = self.page.request.get(f"{self.service.url}{path}")
        assert answer.ok, answer.text()
        return answer.json()

    def in_force(self) -> Values:
        """Return the active tuning of the operator."""
        tuning = self.get("/api/tuning")
        return {name: tuning[name] for name in OWN} | {"bank": (tuning["bank"] or {"id": 0})["id"]}

    def stored(self, run: int) -> Values:
        """Return the settings of a run in the database."""
        database = open_database(self._data)
        with database.reading() as session:
            kept = runs.get(session, run).settings
        database.close()
        return {**kept.get("plan", {}), **kept.get("loop", {})}

    def recorded(self, run: int, signal: str) -> list[tuple[float, float]]:
        """Return time [s] and value of one signal in the download of a run."""
        url = f"{self.service.url}/api/runs/{run}/data.csv"
        answer = self.page.request.get(url, timeout=forms.REPORT_TIMEOUT_MS)  # the export has the lowest priority
        assert answer.ok, answer.text()
        lines = [line for line in answer.text().splitlines() if not line.startswith("#")]
        return [(float(row["t"]), float(row[signal])) for row in csv.DictReader(lines)]

    def session(self) -> int:
        """Record a short manual session and return its number."""
        self.operator.press("Run")
        self.operator.wait(lambda: self.get("/api/state")["recording_run"] is not None)
        run = int(self.get("/api/state")["recording_run"])
        self.operator.press("Pretension")
        self.operator.wait(lambda: self.get("/api/state")["mode"] == "pretension")
        self._hold()
        return run

    def _begin(self) -> None:
        self.service: Service = self._running.enter_context(running_service(self._data))
        self.watched = Watched(self.browser.new_context(viewport=DESKTOP).new_page())
        self.page: Page = self.watched.page
        self.operator = Operator(self.page, self.service)
        sign_in_at(self.page, self.service, "studies")

    def _hold(self) -> None:
        """Establish the pretension, from which every program starts."""
        state = self.get("/api/state")
        if not state["pretension_done"]:
            if state["mode"] != "pretension":
                self.operator.go("Operate")
                if self.operator.settled_mode() == "tripped":  # control was lost in an earlier action
                    self.operator.take_control()
                    self.operator.press("Reset")
                    self.operator.expect_mode("off")
                self.operator.press("Pretension")
                self.operator.wait(lambda: self.get("/api/state")["mode"] == "pretension")
                self.operator.go("Studies")
            self.operator.wait(lambda: bool(self.get("/api/state")["pretension_done"]))

    def _learn(self) -> None:
        """Calibrate the external force without contact, which disturbance rejection requires."""
        self.operator.go("Operate")
        self.operator.press("Run")

        def learned() -> bool:
            self.page.get_by_role(
                "button", name=OPERATE["calibrate"], exact=True
            ).click()  # refused until the joint is at rest
            return bool(self.get("/api/state")["touch"]["learned"])

        self.operator.wait(learned)

    def _use_bank(self) -> None:
        page = self.page
        self.operator.go("Banks")
        with page.expect_file_chooser() as chooser:
            page.get_by_role("button", name=load_texts("pages/banks")["importBank"]).click()
        file = {"name": "forms.json", "mimeType": "application/json", "buffer": json.dumps(BANK).encode()}
        with page.expect_request("**/api/banks/file") as sent:
            chooser.value.set_files(file)  # type: ignore[arg-type]  # a dict of these keys, which it is
        assert sent.value.post_data_json == BANK
        activate = page.get_by_role(
            "button", name=load_texts("pages/banks")["activateBank"].replace("{bank}", "forms v1")
        )
        forms.pressed(page, activate, "/activate")
        self.operator.take_control()
        page.get_by_role("button", name="Control: you").click()
        page.get_by_role("menuitem", name="Give up control").click()
        nobody = page.get_by_role("button", name="Control: nobody")
        expect(nobody).to_be_visible()
        with self._script() as script:
            script.put("/api/tuning", json=OWN).raise_for_status()
        expect(nobody).to_have_count(0)  # the script has control, and the page names it
        self.operator.take_control()

    def _run_another_tuning(self) -> None:
        """Run an experiment of which every setting differs from the active one."""
        self._learn()
        self._hold()
        form = form_of(self, "tracking", CHANGED)
        shown = forms.shown(form)
        assert differences(CHANGED, {name: shown[name] for name in CHANGED}, ROUNDED) == []
        start(self, form, "/api/experiments")
        release(self)
        discard_changes(self, "tracking")

    def _script(self) -> httpx.Client:
        token = (self._data / "token").read_text().strip()
        return httpx.Client(base_url=self.service.url, headers={"Authorization": f"Bearer {token}"}, timeout=30.0)


def form_of(stage: Stage, kind: str, changes: Values) -> Locator:
    """Open and fill in the form of an experiment or of an identification."""
    page = stage.page
    stage.operator.go("Identify" if kind in IDENTIFICATIONS else "Experiments")
    title = declared(stage, kind)["title"]
    if kind in IDENTIFICATIONS:
        page.get_by_role("radiogroup", name=IDENTIFY_TEXTS["kind"]).get_by_text(title, exact=True).click()
        form = page.get_by_role("form", name=IDENTIFY_TEXTS["newIdentification"])
    else:
        page.get_by_role("combobox", name=EXPERIMENT_TEXTS["kindOfExperiment"], exact=True).select_option(kind)
        form = page.get_by_role("form", name=title, exact=True)
    expect(form).to_be_visible()
    forms.fill(form, changes)
    return form


def discard_changes(stage: Stage, kind: str) -> None:
    """Discard the settings that a form retains after its start, so that it shows the active tuning."""
    form = form_of(stage, kind, {})
    form.get_by_role("button", name=re.compile("^Discard the draft of ")).click()
    form.get_by_role("button", name="Discard draft", exact=True).click()
    expect(form.get_by_role("group", name=re.compile("^Draft of "))).to_have_count(0)


def declared(stage: Stage, kind: str) -> Any:
    """Return the declaration of a kind of experiment or identification by the service."""
    if kind in IDENTIFICATIONS:
        return next(one for one in stage.get("/api/identification-kinds")["kinds"] if one["kind"] == kind)
    return next(one for one in stage.get("/api/experiments")["experiments"] if one["name"] == kind)


def start(stage: Stage, form: Locator, path: str) -> tuple[int, Values, list[str]]:
    """Press the start button; return the run, the request, and their differences to the form."""
    button = form.get_by_role("button", name="Start")
    expect(button).not_to_have_attribute("aria-disabled", "true", timeout=MOTION_TIMEOUT_MS)
    shown = forms.shown(form)
    sent, answer = forms.pressed(stage.page, button, path)
    sent = sent["settings"] if "settings" in sent else {name: value for name, value in sent.items() if name != "kind"}
    shown = {name: value for name, value in shown.items() if value != ""}
    return int(answer["id"]), sent, differences(forms.as_sent(shown, sent), sent, ROUNDED)


def release(stage: Stage) -> None:
    """Wait until the program moves, abort it, and release control."""
    stage.operator.wait(lambda: stage.get("/api/state")["mode"] in ("experiment", "identify"))
    stage.operator.go("Operate")
    stage.operator.press("Pretension")
    stage.operator.wait(lambda: stage.get("/api/state")["task"] is None)
    stage.rest()
