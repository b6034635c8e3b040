"""Comparison of runs: the page agrees with the HTTP interface and the recordings."""

import asyncio
import csv
import io
import json
import math
import re
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from datetime import timedelta
from itertools import pairwise
from typing import Any

import pytest
from playwright.sync_api import Browser, Locator, Page, expect

from backend.banks.tuning_settings import compute_default_tuning
from backend.execution.runner import RunRequest, run_experiment
from backend.execution.simulation import open_headless_rig
from backend.experiments.library import find_experiment
from backend.experiments.plans import split_values
from backend.exports import writers
from backend.exports.base import export_run
from backend.services import record_messages
from backend.storage import events, recordings, runs
from backend.storage.database import Database, open_database
from plant.parameters import load_parameters
from tests.e2e.operator import Operator
from tests.e2e.page_texts import load_texts
from tests.e2e.service import Service, running_service
from tests.e2e.sharing import SharedPage, shared_page
from tests.e2e.test_accessibility import violations

RUNS = load_texts("pages/runs")
NO_STEP = str(record_messages.too_few_steps(run=4, signal="q_ref", count=0, minimum=1))

STEPS: tuple[tuple[float, float], ...] = ((1.0, 0.2), (1.6, 0.2), (1.3, 0.3))
"""Of three runs: when q_ref steps in the program [s], and to what [rad]. A fourth has no step."""
FAULT_AT_S = {1: 0.8, 2: 1.5}
"""When the journal tells of a fault [s from the first sample]."""
DEG = 180.0 / math.pi

Columns = dict[str, list[float]]


@pytest.fixture(scope="module")
def service(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Service]:
    data = tmp_path_factory.mktemp("compared")
    database = open_database(data)
    with ThreadPoolExecutor(1) as beside:  # Playwright keeps an event loop running in this thread
        for at_s, q_ref in STEPS:
            lam_q = 0.5 if at_s != 1.6 else 0.6
            beside.submit(play, database, [segment(at_s, 0.0), segment(1.5, q_ref)], lam_q).result()
        beside.submit(play, database, [segment(2.0, 0.0)], 0.5).result()
    with database.session() as session:
        for run_id, at_s in FAULT_AT_S.items():
            run, span = runs.get(session, run_id), recordings.span(session, run_id)
            tick, at = span.first_tick + round(1e3 * at_s), run.started_at + timedelta(microseconds=1)
            events.add(session, "trip", "put here by a test", run_id=run_id, tick=tick, at=at)
    database.close()
    with running_service(data) as running:
        yield running


def segment(duration_s: float, q_ref: float) -> dict[str, float]:
    return {"duration_s": duration_s, "q_ref": q_ref, "S_ref": 10.0}


def play(database: Database, segments: list[dict[str, float]], lam_q: float) -> None:
    """Execute a sequence headless in this process; a new process would take longer than the run."""
    lab, kind = load_parameters("lab"), find_experiment("sequence")
    values = {**compute_default_tuning(lab).tuning.to_document(), "segments": json.dumps(segments), "lam_q": lam_q}
    plan, settings = split_values(kind.settings, kind.make_plan, values)
    with open_headless_rig(database, lab, settings) as station:
        outcome = asyncio.run(run_experiment(station, RunRequest(plan, settings, "A. Operator")))
    assert outcome.run.end_state == "completed"


@pytest.fixture(scope="module")
def shared(browser: Browser, service: Service) -> Iterator[SharedPage]:
    with shared_page(browser, service, "runs") as shared:
        yield shared


@pytest.fixture
def operator(shared: SharedPage, request: pytest.FixtureRequest) -> Iterator[Operator]:
    with shared.turn_of(request) as operator:
        yield operator


@pytest.fixture(scope="module")
def recorded(service: Service) -> dict[int, Columns]:
    """Return all samples of each run as exported, in one process for all files."""
    database = open_database(service.data)
    files = {run: b"".join(writers.write_csv(export_run(database, run))) for run in range(1, 5)}
    database.close()
    return {run: columns(file.decode()) for run, file in files.items()}


def columns(text: str) -> Columns:
    rows = list(csv.DictReader(line for line in text.splitlines() if not line.startswith("#")))
    return {name: [float(row[name]) for row in rows] for name in rows[0]}


def first_step(samples: Columns) -> int:
    return next(k + 1 for k, (before, after) in enumerate(pairwise(samples["q_ref"])) if before == 0.0 != after)


def show(operator: Operator, address: str) -> Page:
    operator.page.goto(f"{operator.service.url}/#{address}")
    expect(operator.page.get_by_role("heading", level=1)).to_contain_text(RUNS["severalRuns"].replace("{runs}", "1"))
    return operator.page


def offset_of(run: int, offset_s: str) -> str:
    """Return the text that states the offset of a run in seconds."""
    return RUNS["offset"].strip("; ").replace("{run}", str(run)).replace("{offset}", offset_s.replace("-", "\u2212"))


def number(text: str) -> float:
    return float(text.replace("\u2212", "-").replace("+", ""))


def cells(row: Locator) -> list[str]:
    return [text.strip() for text in row.get_by_role("cell").all_inner_texts()]


def rows_of(page: Page, table: str) -> list[list[str]]:
    body = page.get_by_role("table", name=table, exact=True).locator("tbody tr")
    return [cells(row) for row in body.all()]


def ask(page: Page, path: str) -> Any:
    return page.evaluate("path => fetch(path).then(answer => answer.json())", path)


def test_metrics_are_shown_with_their_differences_to_the_reference_run(operator: Operator) -> None:
    page = show(operator, "/runs/1/2,3,4")
    expect(page.get_by_role("table", name=RUNS["comparison"], exact=True)).to_be_visible()
    check_metrics(page, 1)
    page.get_by_role("combobox", name=RUNS["reference"], exact=True).select_option("3")
    expect(page.get_by_text(RUNS["differenceBelow"].replace("{run}", "3"))).to_be_visible()
    page.locator('[aria-busy="false"]').get_by_role("table", name=RUNS["comparison"], exact=True).wait_for()
    check_metrics(page, 3)
    assert page.url.endswith("/runs/1/2,3,4/reference=3")
    page.reload()  # the address contains the reference run
    expect(page.get_by_role("combobox", name=RUNS["reference"], exact=True)).to_have_value("3")
    expect(page.get_by_text(RUNS["differenceBelow"].replace("{run}", "3"))).to_be_visible()
    check_metrics(page, 3)

    lam_q = next(row for row in rows_of(page, RUNS["differentSettings"]) if "λ_q" in row[0])
    shown = [ask(page, f"./api/runs/{run}")["settings"] for run in range(1, 5)]
    told = [next(one["value"] for one in settings if one["name"] == "lam_q") for settings in shown]
    assert [number(cell) for cell in lam_q[1:5]] == told == [0.5, 0.6, 0.5, 0.5]
    assert not any("λ_S" in row[0] for row in rows_of(page, RUNS["differentSettings"]))


def check_metrics(page: Page, reference: int) -> None:
    """Compare each metric with the result of its run, and each difference with their difference."""
    results = [{one["label"]: one for one in ask(page, f"./api/experiments/{run}")["metrics"]} for run in range(1, 5)]
    shown = rows_of(page, RUNS["comparison"])
    assert {row[0] for row in shown} == set().union(*results)
    checked = 0
    for row in shown:
        own = results[reference - 1].get(row[0], {"value": None})["value"]
        for cell, result in zip(row[1:5], results, strict=True):
            found = result.get(row[0])
            lines = cell.split("\n")
            if found is None or found["value"] is None:
                assert lines[0] == "not measured"
                continue
            factor = DEG if found["unit"] == "rad" else 1.0
            assert number(lines[0]) == pytest.approx(found["value"] * factor, rel=1e-3, abs=1e-12)
            if own is None or abs(found["value"] - own) <= 1e-11 * abs(own):
                assert len([line for line in lines if line and "(" in line]) == 0
                continue
            said = re.match(r"([+\u2212][\d.e+\u2212]+)(?: \(([+\u2212][\d.e+\u2212]+) %\))?$", lines[1])
            assert said is not None, cell
            assert number(said[1]) == pytest.approx((found["value"] - own) * factor, rel=1e-3)
            if own:
                assert number(said[2]) == pytest.approx(100.0 * (found["value"] - own) / abs(own), rel=1e-2)
            checked += 1
    assert checked > 10


def test_runs_are_aligned_by_a_step_and_a_run_without_a_step_is_excluded(
    operator: Operator, recorded: dict[int, Columns]
) -> None:
    page = show(operator, "/runs/1/2,3,4")
    expect(page.get_by_text(offset_of(2, "0"))).to_be_visible()
    page.get_by_role("combobox", name=RUNS["alignment"], exact=True).select_option("step")
    steps = {run: first_step(recorded[run]) for run in (1, 2, 3)}
    for run in (2, 3):
        shift_s = (steps[1] - steps[run]) / 1e3
        expect(page.get_by_text(offset_of(run, f"{shift_s:.3f}"))).to_be_visible()
    expect(page.get_by_role("alert").filter(has_text=RUNS["notAligned"].split("{")[0].strip("; "))).to_contain_text(
        NO_STEP
    )
    expect(operator.legend("Joint position", "q′′")).to_be_visible()
    expect(operator.legend("Joint position", "q′′′")).to_have_count(0)

    # after alignment, runs 1 and 2 have the same reference
    page.get_by_role("combobox", name=RUNS["signal"], exact=True).select_option("q_ref")
    second = page.get_by_role("table", name=RUNS["deviations"]).get_by_role("row").filter(has_text="Run 2")
    expect(second.get_by_role("cell").nth(4)).to_have_text("0")

    box = page.get_by_role("textbox", name=RUNS["stepNumber"])
    box.fill("2")
    expect(
        page.get_by_role("alert").filter(
            has_text=str(record_messages.too_few_steps(run=2, signal="q_ref", count=1, minimum=2))
        )
    ).to_be_visible()
    box.fill("x")
    expect(page.get_by_text("“x” is not a number")).to_be_visible()
    assert "number=2" in page.url  # invalid input changes nothing


def test_deviations_beyond_the_tolerance_agree_with_the_samples(
    operator: Operator, recorded: dict[int, Columns]
) -> None:
    page = show(operator, "/runs/1/2,3,4/by=step")
    table = page.get_by_role("table", name=RUNS["deviations"], exact=True)
    expect(table.get_by_role("img", name=RUNS["noTolerance"])).to_have_count(6)
    page.get_by_role("textbox", name=f"{RUNS['tolerance']} [°]").fill("1.5")
    expect(table.get_by_role("img", name=RUNS["noTolerance"])).to_have_count(0)
    expect(page.get_by_text(RUNS["toleranceNote"].replace("{tolerance}", "1.5°"))).to_be_visible()
    shown = {row[0]: row[1:] for row in rows_of(page, RUNS["deviations"])}
    assert shown["Run 4"] == [RUNS["notMeasured"].replace("{reason}", NO_STEP)]
    for run in (2, 3):
        told = deviations_of_samples(recorded[1], recorded[run], 1.5 / DEG)
        left, outside, longest, largest, at, compared = shown[f"Run {run}"]
        assert (left == "–") == (told["left_at"] is None)
        if told["left_at"] is not None:
            assert number(left) == pytest.approx(told["left_at"] / 1e3, abs=6e-4)
        assert number(outside) == pytest.approx(told["outside"] / 1e3, abs=6e-4)
        assert number(longest) == pytest.approx(told["longest"] / 1e3, abs=6e-4)
        assert number(largest) == pytest.approx(told["largest"] * DEG, rel=1e-3, abs=1e-6)
        # quantized angles have equal differences at many samples
        assert abs(told["apart"][round(1e3 * number(at))]) == pytest.approx(abs(told["largest"]), rel=1e-6)
        assert number(compared.split(" of ")[0]) == pytest.approx(told["compared"] / 1e3, abs=6e-4)
    assert deviations_of_samples(recorded[1], recorded[3], 1.5 / DEG)["left_at"] is not None
    expect(operator.legend(RUNS["differenceIn"].replace("{signal}", "q"), "Δq′′")).to_be_visible()
    assert page.get_by_role("region", name=RUNS["differences"].replace("{run}", "1")).locator("canvas").count() == 1


def deviations_of_samples(own: Columns, other: Columns, band: float) -> dict[str, Any]:
    """Compute the same values in samples from exported files alone."""
    shift = first_step(own) - first_step(other)
    apart = {k: other["q"][k - shift] - value for k, value in enumerate(own["q"]) if 0 <= k - shift < len(other["q"])}
    outside = [k for k, value in apart.items() if abs(value) > band]
    longest = run = 0
    for k in apart:
        run = run + 1 if abs(apart[k]) > band else 0
        longest = max(longest, run)
    worst = max(apart, key=lambda k: (abs(apart[k]), -k))
    return {
        "left_at": outside[0] if outside else None,
        "outside": len(outside),
        "longest": longest,
        "largest": apart[worst],
        "apart": apart,
        "compared": len(apart),
    }


def test_runs_are_aligned_by_an_event_of_the_log(operator: Operator) -> None:
    page = show(operator, "/runs/1/2")
    page.get_by_role("combobox", name=RUNS["alignment"], exact=True).select_option("event")
    shift_s = FAULT_AT_S[1] - FAULT_AT_S[2]
    expect(page.get_by_text(offset_of(2, f"{shift_s:.3f}"))).to_be_visible()
    page.get_by_role("combobox", name=RUNS["eventKind"], exact=True).select_option("tuning")
    expect(page.get_by_role("alert").filter(has_text="run 2 has no event of the kind tuning")).to_be_visible()


def test_downloaded_files_contain_the_compared_runs(operator: Operator, recorded: dict[int, Columns]) -> None:
    page = show(operator, "/runs/1/2,3/reference=2;by=step")
    expect(page.get_by_role("table", name=RUNS["deviations"], exact=True)).to_be_visible()
    text = operator.download(RUNS["curvesFile"].replace("{signal}", "q")).read_text(encoding="utf-8")
    assert "aligned by step 1 of q_ref" in text.splitlines()[0]
    rows = list(csv.DictReader(io.StringIO("\n".join(line for line in text.splitlines() if line[0] != "#"))))
    assert len(rows) == len(recorded[2]["t"])
    steps = {run: first_step(recorded[run]) for run in (1, 2, 3)}
    for k, row in enumerate(rows):
        own = recorded[2]["q"][k]
        assert float(row["q_run_2"]) == own
        for run in (1, 3):
            place = k - steps[2] + steps[run]
            there = 0 <= place < len(recorded[run]["q"])
            found, apart = float(row[f"q_run_{run}"]), float(row[f"d_q_run_{run}"])
            if there:
                assert found == recorded[run]["q"][place]
                assert apart == pytest.approx(found - own, abs=1e-6)
            else:
                assert math.isnan(found)
                assert math.isnan(apart)
    table = operator.download(RUNS["tableFile"]).read_text(encoding="utf-8")
    lines = list(csv.DictReader(io.StringIO("\n".join(line for line in table.splitlines() if line[0] != "#"))))
    peak = [line for line in lines if line["name"] == "peak_voltage_V"]
    told = ask(page, "./api/run-comparison?run=1&run=2&run=3&reference=2")["metrics"]
    values = next(one["values"] for one in told if one["name"] == "peak_voltage_V")
    assert [float(line["value"]) for line in peak] == [one["value"] for one in values]
    assert [float(line["difference"]) for line in peak] == [one["difference"] for one in values]
    assert {line["what"] for line in lines} == {"metric", "setting"}


def test_the_comparison_page_is_accessible_and_fits_small_windows(operator: Operator) -> None:
    page = show(operator, "/runs/1/2,3,4/by=step;band=0.02;odd")
    expect(page.get_by_role("alert").filter(has_text="odd")).to_contain_text(
        RUNS["invalidSettings"].replace("{parts}", "odd")
    )
    expect(page.get_by_role("table", name=RUNS["deviations"], exact=True)).to_be_visible()
    for size in ({"width": 390, "height": 844}, {"width": 1440, "height": 900}):
        page.set_viewport_size(size)  # type: ignore[arg-type]
        wide = page.evaluate("document.documentElement.scrollWidth - document.documentElement.clientWidth")
        assert wide <= 0
    assert violations(page) == []
