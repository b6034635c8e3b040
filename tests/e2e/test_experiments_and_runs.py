"""Own experiments, dry run and queue; lineage, tags, replay and comparison of their runs; the setup list."""

import math
from collections.abc import Iterator

import pytest
from playwright.sync_api import Browser, expect

from tests.api.conftest import client_with
from tests.e2e.browser import DESKTOP
from tests.e2e.operator import MOTION_TIMEOUT_MS, Operator, kept
from tests.e2e.page_texts import load_texts
from tests.e2e.service import Service
from tests.e2e.sharing import SharedPage, bring_to_run, shared_page, sign_in_at

EXPERIMENT_TEXTS = load_texts("pages/experiments")
RUNS = load_texts("pages/runs")
SHARED = load_texts("components")

DRY_RUN_TIMEOUT_MS = 120_000
"""The simulator's process starts with the first dry run and gives way to everything else."""


SHORT = """format: 1
name: short
title: Short
phases:
  - name: all
    title: All
    parts:
      - {do: step, q_ref: 0.2, S_ref: 10, duration_s: 1}
      - {do: step, q_ref: 0.5, S_ref: 10, duration_s: 2}
"""


@pytest.fixture(scope="module")
def service(fresh_service: Service) -> Service:
    with client_with(fresh_service, "token") as script:
        script.post("/api/experiments/own", json={"text": SHORT}).raise_for_status()
    return fresh_service


@pytest.fixture(scope="module")
def shared(browser: Browser, service: Service) -> Iterator[SharedPage]:
    with shared_page(browser, service, "operate") as shared:
        yield shared


@pytest.fixture
def operator(shared: SharedPage, request: pytest.FixtureRequest) -> Iterator[Operator]:
    with shared.turn_of(request) as operator:
        yield operator


def test_a_new_person_sees_the_tour_once(operator: Operator) -> None:
    page = operator.page
    tour = page.get_by_role("region", name="Tour", exact=True)
    expect(tour).to_contain_text("1 of 6", timeout=MOTION_TIMEOUT_MS)
    tour.get_by_role("button", name="Next", exact=True).click()
    expect(tour).to_contain_text("Pretension")
    with page.expect_response(kept("toured", True)):
        tour.get_by_role("button", name="Skip tour", exact=True).click()
    expect(tour).to_be_hidden()
    page.reload()
    expect(page.get_by_role("button", name="Live", exact=True)).to_be_visible()
    page.wait_for_load_state("networkidle")
    expect(tour).to_be_hidden()


def test_an_own_experiment_is_dry_run_queued_and_executed(operator: Operator) -> None:
    page = operator.page
    operator.go("Experiments")
    bring_to_run(operator.service)  # control is free: a page that is busy with the dry run stops nothing
    page.get_by_role("combobox", name=EXPERIMENT_TEXTS["kindOfExperiment"], exact=True).select_option("short@1")

    page.get_by_role("button", name=EXPERIMENT_TEXTS["dryRun"], exact=True).click()
    dry = page.get_by_role("region", name=EXPERIMENT_TEXTS["dryRun"], exact=True)
    expect(dry).to_contain_text("Completed", timeout=DRY_RUN_TIMEOUT_MS)
    expect(
        dry.get_by_role("table", name=EXPERIMENT_TEXTS["metricsOf"].format(source=EXPERIMENT_TEXTS["dryRunSource"]))
    ).to_contain_text("Peak voltage")
    expect(dry.get_by_role("figure", name="Joint position")).to_be_visible()
    operator.expect_mode("run")
    page.get_by_role("button", name=EXPERIMENT_TEXTS["closeDryRun"], exact=True).click()

    for _ in range(2):
        page.get_by_role("button", name=EXPERIMENT_TEXTS["addToQueue"], exact=True).click()
    waiting = page.get_by_role("list", name=EXPERIMENT_TEXTS["queue"], exact=True).get_by_role("listitem")
    expect(waiting).to_have_count(2)
    operator.press(EXPERIMENT_TEXTS["startQueue"])
    operator.go("Studies")  # on a slow machine, a page with live charts may lose control
    operator.wait(lambda: len(ended(operator)) == 2 and "running" not in ended(operator))
    operator.go("Experiments")
    expect(page.get_by_text(EXPERIMENT_TEXTS["queueEmpty"])).to_be_visible()
    table = page.get_by_role("table", name=EXPERIMENT_TEXTS["earlierExperiments"], exact=True)
    expect(table.get_by_text("completed")).to_have_count(2, timeout=MOTION_TIMEOUT_MS)


def ended(operator: Operator) -> list[str]:
    """Return the end states of the experiments according to the service; running ones included."""
    runs = operator.page.evaluate("fetch('./api/runs?kind=experiment').then(answer => answer.json())")["runs"]
    return [run["end_state"] for run in runs]


def test_the_page_of_a_run_shows_replay_lineage_and_comparison(operator: Operator) -> None:
    page = operator.page
    operator.go("Runs")
    page.get_by_role("combobox", name=RUNS["kind"], exact=True).select_option("experiment")
    table = page.get_by_role("table", name=RUNS["table"], exact=True)
    expect(table.get_by_role("row").filter(has_text="session")).to_have_count(0)  # the earlier list is shown until then
    table.get_by_role("link").first.click()
    expect(page.get_by_role("region", name=RUNS["lineage"], exact=True)).to_contain_text(
        RUNS["unchanged"].replace("{parameters}", "lab")
    )

    replay = page.get_by_role("region", name=RUNS["replay"], exact=True)
    expect(replay).to_contain_text(RUNS["replayBadge"])
    expect(replay).to_contain_text(RUNS["notLive"].split("}")[1])
    replay.get_by_role("button", name=RUNS["play"], exact=True).click()
    expect(replay.get_by_role("button", name=RUNS["play"], exact=True)).to_be_visible(timeout=MOTION_TIMEOUT_MS)
    run = int(page.url.split("/runs/")[1])
    lasted_s = page.evaluate(f"fetch('./api/runs/{run}').then(answer => answer.json())")["duration_s"]
    assert 3.0 <= lasted_s < 3.2  # a busy machine skips ticks, also at the end
    shown = replay.get_by_role("status", name=RUNS["replayTime"], exact=True).inner_text()
    assert float(shown.removeprefix("0:")) == pytest.approx(lasted_s, abs=0.0051)
    operator.wait(lambda: abs(operator.reading("Joint position", "q_ref")) > 1.0)  # the cursor of the charts followed

    page.get_by_role("slider", name=RUNS["replayPosition"], exact=True).press("Home")
    expect(replay.get_by_role("status", name=RUNS["replayTime"], exact=True)).to_have_text("0:00.00")

    compare = page.get_by_role("combobox", name=RUNS["compareWith"], exact=True)
    compare.select_option(index=1)
    expect(operator.legend("Joint position", "q′")).to_be_visible(timeout=MOTION_TIMEOUT_MS)
    page.get_by_role("figure", name="Joint position", exact=True).hover(
        force=True
    )  # at the end, one of both runs may be over
    operator.wait(lambda: not math.isnan(operator.reading("Joint position", "q′")))
    comparison = page.get_by_role("region", name=RUNS["comparison"], exact=True)
    expect(
        comparison.get_by_role("table", name=RUNS["comparison"], exact=True).get_by_role("row").nth(1)
    ).to_be_visible()
    picture = page.get_by_role("group", name=RUNS["lineageDiagram"], exact=True)
    expect(picture).to_contain_text(f"Run {run}")
    digests = page.get_by_role("table", name=RUNS["digests"], exact=True)
    expect(digests.get_by_role("row", name=f"Run {run}")).to_contain_text(RUNS["upToDate"])
    for label, name in (
        ("Data (MCAP)", f"sinew-run-{run}.mcap"),
        ("Bundle", f"sinew-run-{run}.zip"),
        ("Layout", "sinew-foxglove-layout.json"),
    ):
        with page.expect_download(timeout=MOTION_TIMEOUT_MS) as taken:
            page.get_by_role("link", name=label, exact=True).click()
        assert taken.value.suggested_filename == name
        assert taken.value.failure() is None


def test_runs_are_searched_and_tagged_and_the_search_is_saved(operator: Operator) -> None:
    page = operator.page
    operator.go("Runs")
    table = page.get_by_role("table", name=RUNS["table"], exact=True)
    table.get_by_role("link").first.click()
    box = page.get_by_role("textbox", name=RUNS["newTag"], exact=True)
    box.or_(page.get_by_role("combobox", name=RUNS["newTag"])).fill("Paper")
    page.get_by_role("button", name=RUNS["addTag"], exact=True).click()
    expect(page.get_by_role("list", name=RUNS["tags"], exact=True)).to_contain_text("paper")
    operator.go("Runs")
    page.get_by_role("searchbox", name=RUNS["searchRuns"], exact=True).fill("tag = paper")
    expect(table.get_by_role("row")).to_have_count(2)  # the heading and the run
    page.get_by_role("textbox", name=RUNS["searchName"], exact=True).fill("tagged")
    page.get_by_role("button", name=RUNS["saveSearch"], exact=True).click()
    saved = page.get_by_role("combobox", name=RUNS["savedSearches"], exact=True)
    expect(saved).to_have_value("tagged")
    page.get_by_role("button", name=RUNS["clear"], exact=True).click()
    saved.select_option("tagged")
    expect(page.get_by_role("searchbox", name=RUNS["searchRuns"], exact=True)).to_have_value("tag = paper")
    page.get_by_role("link", name=RUNS["metricsOverTime"], exact=True).click()
    expect(page.get_by_role("heading", level=1)).to_contain_text(RUNS["metricsOverTime"])


def test_the_setup_list_shows_completed_steps_and_links_to_the_next(operator: Operator) -> None:
    page = operator.page
    page.get_by_role("button", name="Setup", exact=True).click()
    steps = page.get_by_role("list", name=SHARED["setupSteps"], exact=True)
    expect(
        steps.get_by_role("listitem", name=f"{SHARED['pretension']}: {SHARED['stepDone']}", exact=True)
    ).to_be_visible()
    expect(steps.get_by_role("listitem", name=f"{SHARED['bank']}: {SHARED['stepMissing']}", exact=True)).to_be_visible()
    steps.get_by_role("link", name=SHARED["bankAction"], exact=True).click()
    expect(page.get_by_role("heading", level=1, name="Banks")).to_be_attached()


def test_an_unknown_address_is_reported_without_repeated_requests(browser: Browser, service: Service) -> None:
    page = browser.new_context(viewport=DESKTOP).new_page()  # the console may report refused requests
    operator = Operator(page, service)
    sign_in_at(page, service, "studies")
    operator.settled_mode()  # a later state would repeat the requests
    asked: list[str] = []
    page.on("request", lambda request: asked.append(request.url))
    for name in ("runs", "experiments", "identify"):
        page.goto(f"{service.url}/#/{name}/999999")
        expect(page.get_by_role("main").get_by_text("999999").last).to_contain_text("there is no")
        assert sum(url.endswith("/999999") for url in asked) == 1  # a refused request is not repeated
        asked.clear()
        page.goto(f"{service.url}/#/{name}/nonsense")
        expect(page.get_by_role("heading", level=1, name="Operate")).to_be_attached()
        assert not any("NaN" in url for url in asked)
    page.context.close()
