"""Runs on the virtual card in the browser agree with the simulator, and are labelled."""

import math
from collections.abc import Iterator, Mapping
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import pytest
from playwright.sync_api import Locator, expect

from backend.banks.tuning_settings import compute_default_tuning
from backend.experiments.library import IDENTIFICATIONS, experiments_by_name, find_experiment
from backend.experiments.plans import LoopSettings, Plan
from backend.models.settings import build_plan
from plant.interface import SIMULATOR
from tests.e2e.forms import REPORT_TIMEOUT_MS, fill, pressed
from tests.e2e.operator import Operator
from tests.e2e.page_texts import load_texts
from tests.e2e.service import Service, running_service
from tests.execution.test_simulation import ALIKE, PARAMETERS, figures, performed

IDENTIFY_TEXTS = load_texts("pages/identify")
EXPERIMENT_TEXTS = load_texts("pages/experiments")
SHARED = load_texts("components")

RUN_TIMEOUT_MS = 180_000
"""Ten times what the longest of these takes by the loop's own time."""

HELD_S = 8.0
"""The simulator's pretension is held for some seconds too before it begins: a person is not as fast as a program."""

BY_DEFAULT = LoopSettings(**compute_default_tuning(PARAMETERS).tuning.to_document())
"""Of a data folder in which nobody has chosen a tuning."""

ORDERS: dict[str, Mapping[str, Any]] = {
    "compliance": {"S_ref": 12.0, "profile": "steps", "hold_s": 0.6},
    "tracking": {"q_duration_s": 1.0, "S_duration_s": 1.0},
    "motor": {"u_low": 3.0, "levels": 2, "step_s": 1.5, "settle_s": 0.5},
    "spring": {"sweep_s": 3.0, "cycles": 1, "settle_s": 0.5},
    "actuator": {"bits": 6, "settle_s": 3.0},
}
"""Everything that a person can start on a rig by itself, as short as it still comes to figures."""


@pytest.fixture(scope="module")
def service(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Service]:
    with running_service(tmp_path_factory.mktemp("data"), plant=("rig", "--virtual-card")) as running:
        yield running


@pytest.mark.timeout(900)  # five runs in real time; each wait has its own timeout
def test_runs_on_the_virtual_card_agree_with_the_simulator(operator: Operator, tmp_path: Path) -> None:
    page = operator.page
    operator.sign_in()
    expect(page.get_by_role("img", name="Virtual card", exact=True)).to_have_text("VIRTUAL CARD")
    operator.press("Pretension")
    expect(page.get_by_role("status", name="Status", exact=True)).to_contain_text(SHARED["statusReady"])
    with ThreadPoolExecutor(1) as beside:  # Playwright keeps an event loop running in this thread
        for name, settings in ORDERS.items():
            plan = planned(name, settings)
            simulated = beside.submit(performed, tmp_path / name, plan, SIMULATOR, HELD_S, BY_DEFAULT)
            run = (
                experimented(operator, name, settings)
                if name in experiments_by_name()
                else identified(operator, name, settings)
            )
            told = get(operator, f"/api/experiments/{run}")
            assert told["status"] == "completed", told["message"]
            agree(name, told["metrics"], figures(simulated.result()[0]))
    assert {run["plant"] for run in get(operator, "/api/runs")["runs"]} == {"virtual card"}
    report = page.request.get(f"{operator.service.url}/api/runs/{run}/report.html", timeout=REPORT_TIMEOUT_MS)
    assert "virtual card" in report.text()


def planned(name: str, settings: Mapping[str, float | str]) -> Plan:
    return (
        find_experiment(name).make_plan(settings)
        if name in experiments_by_name()
        else build_plan(IDENTIFICATIONS[name].plan, settings)
    )


def experimented(operator: Operator, name: str, settings: Mapping[str, float | str]) -> int:
    """Start an experiment, wait for its end, read verdict and metrics on the page; return its run."""
    page, title = operator.page, experiments_by_name()[name].title
    operator.go("Experiments")
    page.get_by_role("combobox", name=EXPERIMENT_TEXTS["kindOfExperiment"], exact=True).select_option(name)
    fill(page.get_by_role("form", name=title, exact=True), settings)
    run = started(operator, f"Start {title.lower()}", "/api/experiments")
    result = page.get_by_role("region", name="Result", exact=True)
    expect(result).to_contain_text(f"run {run},", timeout=RUN_TIMEOUT_MS)
    metrics = result.get_by_role("table", name="Metrics", exact=True)
    expect(metrics).to_be_visible(timeout=RUN_TIMEOUT_MS)
    told = get(operator, f"/api/experiments/{run}")
    expect(result.get_by_role("table", name="Criteria", exact=True).get_by_role("row")).to_have_count(
        len(told["criteria"]) + 1
    )
    assert read(metrics) == [shown(metric) for metric in told["metrics"]]
    return run


def identified(operator: Operator, name: str, settings: Mapping[str, float | str]) -> int:
    """Start an identification, wait for its end, read verdict and estimates on the page; return its run."""
    page = operator.page
    operator.go("Identify")
    page.get_by_role("radiogroup", name=IDENTIFY_TEXTS["kind"]).get_by_text(IDENTIFICATIONS[name].title).click()
    form = page.get_by_role("form", name=IDENTIFY_TEXTS["newIdentification"], exact=True)
    expect(form.locator(f"[name={next(iter(settings))}]")).to_be_visible()
    fill(form, settings)
    run = started(operator, IDENTIFY_TEXTS["start"], "/api/identifications")
    result = page.get_by_role("region", name=IDENTIFY_TEXTS["result"], exact=True)
    expect(result).to_contain_text(IDENTIFY_TEXTS["runLink"].format(run=run), timeout=RUN_TIMEOUT_MS)
    expect(result.get_by_role("table").first).to_be_visible(timeout=RUN_TIMEOUT_MS)
    told = get(operator, f"/api/identifications/{run}")
    assert told["usable"], told["message"]
    expect(result).to_contain_text(told["message"])
    for motor in told["motors"]:
        title = IDENTIFY_TEXTS["estimatesOf"].format(side=motor["side"])
        estimates = result.get_by_role("table", name=title, exact=True)
        expect(estimates).to_contain_text(f"{motor['fitted']['K_m']:#.4g}")
    for spring in told["springs"]:
        title = IDENTIFY_TEXTS["polynomialsOf"].format(title=IDENTIFY_TEXTS["spring"].format(name=spring["name"]))
        polynomials = result.get_by_role("table", name=title, exact=True)
        expect(polynomials).to_contain_text(IDENTIFY_TEXTS["recommended"].format(order=spring["recommended"]))
    return run


def started(operator: Operator, button: str, path: str) -> int:
    start = operator.page.get_by_role("button", name=button, exact=True)
    expect(start).not_to_have_attribute("aria-disabled", "true")
    return int(pressed(operator.page, start, path)[1]["id"])


def agree(name: str, ours: list[dict[str, Any]], theirs: Mapping[str, tuple[float | None, str]]) -> None:
    """Check that the metrics agree with the simulator within quantization."""
    assert {figure["name"] for figure in ours} == theirs.keys()
    for figure in ours:
        value, expected = figure["value"], theirs[figure["name"]][0]
        assert (value is None) == (expected is None), (name, figure["name"])
        if value is not None:
            bound = pytest.approx(expected, abs=ALIKE[figure["unit"]], rel=0.02)
            assert value == bound, (name, figure["name"])


def read(metrics: Locator) -> list[Any]:
    """Return the displayed numbers of a table of metrics; none where a metric was not measured."""
    cells = metrics.evaluate("table => [...table.tBodies[0].rows].map(row => row.cells[1].innerText)")
    return [None if text == "not measured" else pytest.approx(float(text.replace("\u2212", "-"))) for text in cells]


def shown(metric: Mapping[str, Any]) -> float | None:
    """Return a metric with the displayed four digits and unit."""
    if metric["value"] is None:
        return None
    return float(f"{metric['value'] * (180.0 / math.pi if metric['unit'] == 'rad' else 1.0):.4g}")


def get(operator: Operator, path: str) -> Any:
    answer = operator.page.request.get(f"{operator.service.url}{path}")
    assert answer.ok, answer.text()
    return answer.json()
