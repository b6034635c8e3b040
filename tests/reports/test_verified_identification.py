"""Verification estimates the model of an identification again; a repeated evaluation gives the same report."""

import asyncio
import copy
from dataclasses import replace
from typing import Any

import pytest

from backend.analysis.evaluation import reevaluate_run
from backend.execution.runner import RunRequest, run_experiment
from backend.execution.simulation import open_headless_rig
from backend.experiments.plans import (
    ActuatorIdentificationPlan,
    IdentificationPlan,
    LoopSettings,
    MotorIdentificationPlan,
    SpringIdentificationPlan,
)
from backend.identification.validation import critical_deviation
from backend.reports.build import build_report
from backend.reports.evidence import (
    LAYOUT,
    MANIFEST,
    ReportManifest,
    compute_hashes,
    compute_manifest_hash,
    find_element,
    read_manifest,
    to_element,
)
from backend.reports.model import to_html
from backend.reports.pdf import to_pdf
from backend.reports.run_data import RunData, load_source
from backend.reports.verification import Verified, verify_report
from backend.storage.database import open_database
from plant.parameters import load_parameters

PLANS: dict[str, tuple[IdentificationPlan, tuple[str, ...]]] = {
    "motor": (MotorIdentificationPlan(), ("A", "parameters", "K_m")),
    "spring": (SpringIdentificationPlan(), ("A", "fits", "0", "rms_N")),
    "actuator": (ActuatorIdentificationPlan(tension_N=20.0, bits=6), ("G_q", "first_order", "K")),
}


@pytest.fixture(scope="module", params=PLANS)
def identified(
    request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory
) -> tuple[str, RunData, RunData]:
    """Return a run of each kind, and the same run after a second evaluation."""
    database = open_database(tmp_path_factory.mktemp(request.param))
    plan, _ = PLANS[request.param]
    with open_headless_rig(database, load_parameters("ideal"), LoopSettings()) as station:
        outcome = asyncio.run(run_experiment(station, RunRequest(plan, LoopSettings(), "A. Operator")))
    first = load_source(database, outcome.run.id)
    reevaluate_run(database, outcome.run.id)
    second = load_source(database, outcome.run.id)
    database.close()
    return request.param, first, second


def test_an_unchanged_report_is_verified(identified: tuple[str, RunData, RunData]) -> None:
    _, source, _ = identified
    assert source.identification is not None
    assert verify_report(to_html(build_report(source)), source.columns) == Verified((), ())


def with_another_number(kind: str, source: RunData) -> tuple[str, RunData]:
    """Return the name of one number of the model, and the run with that number 25 % larger."""
    assert source.identification is not None
    model = copy.deepcopy(source.identification.model)
    here: Any = model
    *path, last = PLANS[kind][1]
    for part in path:
        here = here[int(part) if isinstance(here, list) else part]
    here[last] *= 1.25
    return last, replace(source, identification=replace(source.identification, model=model))


def test_a_changed_model_with_correct_hashes_is_reported_with_its_name(
    identified: tuple[str, RunData, RunData],
) -> None:
    kind, source, _ = identified
    assert source.identification is not None
    last, touched = with_another_number(kind, source)
    names = [one.name for one in verify_report(to_html(build_report(touched)), source.columns).differences]
    assert any(name.startswith("identification, model, ") and name.endswith(f", {last}") for name in names)
    verdict = replace(source, identification=replace(source.identification, verdict="Usable for anything."))
    names = [one.name for one in verify_report(to_html(build_report(verdict)), source.columns).differences]
    assert "identification, verdict" in names


def of_another_layout(source: RunData) -> str:
    """Return the page of a run in another layout, with a correct manifest."""
    page = to_html(build_report(source))
    manifest = read_manifest(page)
    assert isinstance(manifest, ReportManifest)
    manifest = replace(manifest, made_with={**manifest.made_with, LAYOUT: "0123456789abcdef"})
    manifest = replace(manifest, hashes={**manifest.hashes, MANIFEST: compute_manifest_hash(manifest)})
    return page.replace(find_element(page), to_element(manifest))


def test_only_the_numbers_of_a_model_in_another_layout_are_compared(
    identified: tuple[str, RunData, RunData],
) -> None:
    kind, source, _ = identified
    assert source.identification is not None
    reworded = replace(source, identification=replace(source.identification, verdict="Usable for anything."))
    found = verify_report(of_another_layout(reworded), source.columns)
    assert (found.holds, found.differences) == (None, ())
    last, touched = with_another_number(kind, source)
    names = [one.name for one in verify_report(of_another_layout(touched), source.columns).differences]
    assert any(name.startswith("identification, model, ") and name.endswith(f", {last}") for name in names)


def test_a_manifest_with_documents_of_an_earlier_form_is_compared(
    identified: tuple[str, RunData, RunData],
) -> None:
    kind, source, _ = identified
    assert source.identification is not None
    page = of_another_layout(source)
    manifest = read_manifest(page)
    assert isinstance(manifest, ReportManifest)
    assert manifest.identification is not None
    quality = copy.deepcopy(manifest.identification.quality)
    for name in {"motor": ("A", "B"), "actuator": ("G_q", "G_S")}.get(kind, ()):
        if kind == "motor":
            del quality[name]["grade"]
            continue
        for test in ("whiteness", "input_correlation"):
            bound = quality[name]["residuals"][test].pop("bound")
            share = critical_deviation(1) / critical_deviation(len(bound))
            quality[name]["residuals"][test]["band"] = [share * one for one in bound]
    loop = {part: value for part, value in manifest.run.settings["loop"].items() if part != "motion"}
    settings = manifest.run.settings | {"loop": loop | {"u_plan": 0.0}}
    estimate = replace(manifest.identification, quality=quality)
    manifest = replace(manifest, run=replace(manifest.run, settings=settings), identification=estimate)
    manifest = replace(manifest, hashes=compute_hashes(manifest, source.columns))
    manifest = replace(manifest, hashes={**manifest.hashes, MANIFEST: compute_manifest_hash(manifest)})
    found = verify_report(page.replace(find_element(page), to_element(manifest)), source.columns)
    assert (found.holds, found.differences) == (None, ())


def test_the_report_of_a_second_evaluation_is_equal_byte_for_byte(identified: tuple[str, RunData, RunData]) -> None:
    _, first, second = identified
    assert first.identification is not None
    assert second.identification is not None
    assert first.identification.id != second.identification.id
    assert to_html(build_report(first)) == to_html(build_report(second))
    assert to_pdf(build_report(first)) == to_pdf(build_report(second))
