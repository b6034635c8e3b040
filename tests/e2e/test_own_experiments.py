"""An own experiment on the page: based on an existing one, refused at its line, saved, dry run, executed, listed."""

import asyncio
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest
from playwright.sync_api import Browser, Response, expect

from backend.banks.tuning_settings import compute_default_tuning
from backend.execution.runner import RunRequest, run_experiment
from backend.execution.simulation import open_headless_rig
from backend.experiments.library import build_experiment_definition, load_ready_text
from backend.experiments.parser import parse_experiment
from backend.experiments.plans import LoopSettings
from backend.storage.database import open_database
from plant.parameters import load_parameters
from tests.e2e.browser import DESKTOP
from tests.e2e.operator import MOTION_TIMEOUT_MS, Operator
from tests.e2e.page_texts import load_texts
from tests.e2e.service import Service
from tests.e2e.sharing import bring_to_run, sign_in_at
from tests.e2e.test_experiments_and_runs import DRY_RUN_TIMEOUT_MS

TEXTS = load_texts("pages/experiments")

OWN = """format: 1
name: nudges
title: Nudges under two λ
phases:
  - name: lead_in
    title: Lead-in
    parts:
      - {do: step, q_ref: 0.0, S_ref: 10.0, duration_s: 2.0}
  - name: nudges
    title: Nudges
    parts:
      - {do: tuning, lam_q: 0.8}
      - {do: pulse, q_ref: 0.1, duration_s: 1.0, rest_s: 1.0}
criteria:
  - {figure: min_tension_N, above: 2.0}
"""


@pytest.fixture(scope="module")
def service(fresh_service: Service) -> Service:
    return fresh_service


def test_an_own_experiment_is_edited_validated_saved_dry_run_and_executed(
    browser: Browser, service: Service, tmp_path: Path
) -> None:
    page = browser.new_context(viewport=DESKTOP).new_page()  # the console may report refused requests
    operator = Operator(page, service)
    bring_to_run(service)
    sign_in_at(page, service, "experiments")
    own = page.get_by_role("region", name=TEXTS["ownExperiments"], exact=True)
    text, said = own.get_by_role("textbox"), own.get_by_role("status", name="Refusal")
    own.get_by_text(TEXTS["asText"], exact=True).click()
    own.get_by_role("combobox", name=TEXTS["startFrom"]).select_option("step_battery")
    expect(text).to_have_value(load_ready_text("step_battery"))
    own.get_by_role("button", name=TEXTS["check"], exact=True).click()
    expect(said).to_contain_text("'step_battery' is the name of a built-in experiment")

    text.fill(OWN.replace("lam_q: 0.8", "lam_q: 0.1"))
    own.get_by_role("button", name=TEXTS["check"], exact=True).click()
    expect(said).to_contain_text("line 12: phases 2, parts 1: λ_q: 0.1 s is outside")
    marked = text.evaluate("box => box.value.slice(box.selectionStart, box.selectionEnd)")
    assert marked == "      - {do: tuning, lam_q: 0.1}"

    text.fill(OWN)
    own.get_by_role("button", name=TEXTS["check"], exact=True).click()
    contents = f"4.0 s, 2 parts, 1 {TEXTS['tuningChangeCount']}, 1 {TEXTS['criterionCount']}"
    peaks = TEXTS["peaks"].split("{")[0]
    looked_over = TEXTS["valid"].format(experiment="Nudges under two λ", contents=contents, peaks=peaks)
    expect(said).to_contain_text(looked_over, timeout=DRY_RUN_TIMEOUT_MS)
    predicted = said.inner_text()
    own.get_by_role("button", name=TEXTS["save"], exact=True).click()
    expect(said).to_contain_text(TEXTS["saved"].format(name="nudges", version=1))

    form = page.get_by_role("form", name="Nudges under two λ", exact=True)
    with page.expect_response(lambda answer: answer.url.endswith("/dry-run"), timeout=DRY_RUN_TIMEOUT_MS) as answered:
        form.get_by_role("button", name=TEXTS["dryRun"], exact=True).click()
    with ThreadPoolExecutor(1) as beside:  # Playwright keeps an event loop running in this thread
        figures = beside.submit(by_command, tmp_path).result()
    assert metrics_of(answered.value) == figures
    volts, low, high = (figures[name] for name in ("peak_voltage_V", "min_tension_N", "max_tension_N"))
    assert predicted.endswith(TEXTS["peaks"].format(voltage=f"{volts:#.3g}", low=f"{low:#.3g}", high=f"{high:#.3g}"))

    form.get_by_role(
        "button", name=TEXTS["startExperiment"].format(experiment="nudges under two λ"), exact=True
    ).click()
    result = page.get_by_role("region", name=TEXTS["result"], exact=True)
    expect(result).to_contain_text("Nudges under two λ, run", timeout=MOTION_TIMEOUT_MS)
    expect(result).to_contain_text("The criterion passed.", timeout=MOTION_TIMEOUT_MS)
    operator.go("Runs")
    expect(page.get_by_role("table").get_by_role("row").nth(1)).to_contain_text("Nudges under two λ")
    page.context.close()


def metrics_of(answer: Response) -> dict[str, float | None]:
    return {one["name"]: one["value"] for one in answer.json()["metrics"]}


def by_command(folder: Path) -> dict[str, float | None]:
    """Execute the same experiment from the command line, in another installation."""
    plan = build_experiment_definition(*parse_experiment(OWN)).default_plan
    database = open_database(folder)
    lab = load_parameters("lab")
    settings = LoopSettings(**compute_default_tuning(lab).tuning.to_document())
    with open_headless_rig(database, lab, settings) as station:
        result = asyncio.run(run_experiment(station, RunRequest(plan, settings, "A. Operator"))).evaluation.result
    database.close()
    assert result is not None
    return {one.name: one.value for one in result.metrics.figures}
