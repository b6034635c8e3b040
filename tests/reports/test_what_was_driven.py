"""A report names the plant that was driven; only what was simulated had a seed."""

from dataclasses import replace

import pytest

from backend.reports.experiment_report import tracking_report
from plant.interface import PlantChoice, PlantKind
from tests.reports.tracking_run import PLAN, samples, source_of

SEEDED = {"simulator", "virtual card"}
CHOICES = [PlantChoice(kind, package="servo-bench") for kind in PlantKind]


@pytest.mark.parametrize("choice", CHOICES, ids=lambda choice: str(choice.kind))
def test_a_report_names_what_was_driven(choice: PlantChoice) -> None:
    source = source_of(samples(PLAN))
    report = tracking_report(replace(source, run=replace(source.run, plant=choice.name)))
    facts = {fact.label: fact.text for fact in report.facts}
    assert f" · {choice.name}, parameters “ideal”" in report.subtitle
    assert facts["Plant"] == f"{choice.name}, parameters “ideal”"
    assert ("Seed" in facts) == (choice.name in SEEDED)
