"""A tracking run with a plan, beside what the paper's law would have made of its references."""

import re
from dataclasses import replace

import numpy as np
import pytest

from backend.models.run import StepFigures
from backend.reports.experiment_report import PaperLawResponse, make_law_comparison, simulate_paper_law, tracking_report
from backend.reports.model import Fact, Figure, Report, Table, to_html
from backend.reports.provenance import tuning_facts
from backend.reports.run_data import RunData
from backend.tuning.gains import TuningParameters, make_cascade_tuning
from backend.tuning.simulation import simulate_cascade
from backend.units import AngleUnit
from plant.parameters import load_parameters
from tests.reports.tracking_run import PLAN, samples, source_of


def planned(**changed: object) -> RunData:
    """A run with a plan; its samples are those of closed forms, as nothing here looks at what was measured."""
    source = source_of(samples(PLAN))
    settings = source.run.settings
    kept = {**settings["loop"], "motion": "time-optimal", "u_plan": 8.5, "b": 0.0, **changed}
    return replace(source, run=replace(source.run, settings={**settings, "loop": kept}))


@pytest.fixture(scope="module")
def law() -> PaperLawResponse:
    found = simulate_paper_law(planned())
    assert found is not None
    return found


@pytest.fixture(scope="module")
def report() -> Report:
    return tracking_report(planned())


def tables(report: Report) -> list[Table]:
    return [block for section in report.sections for block in section.blocks if isinstance(block, Table)]


def compared(report: Report) -> Table:
    return next(table for table in tables(report) if "paper's governor" in table.caption)


def number(cell: str) -> float:
    return float(cell.replace("\N{MINUS SIGN}", "-"))


def controller(source: RunData) -> Fact:
    return next(fact for fact in tuning_facts(source) if fact.label == "Controller")


def test_a_report_says_by_what_references_were_followed() -> None:
    assert controller(planned()).text.endswith("motion time-optimal within U_plan = 8.5 V")
    assert controller(planned(k_ext=0.7)).text.endswith("U_plan = 8.5 V; pushes rejected by feed-forward, k_ext = 0.7")
    assert controller(planned(motion="lambda")).text.endswith("motion lambda: the paper's law with the governor")
    assert controller(source_of(samples(PLAN))).text.endswith("motion lambda: the paper's law with the governor")


def test_what_the_paper_s_law_would_take_is_a_simulation_of_its_own(report: Report) -> None:
    """The largest step of q in the table, against the same step from rest and counted here."""
    tuning = make_cascade_tuning(load_parameters("ideal"), TuningParameters(lam_q=0.5, lam_S=0.42))
    high = float(PLAN.values["q_amplitude"])
    q = simulate_cascade(load_parameters("ideal"), tuning, np.repeat([-high, high], (500, 4000)), np.full(4500, 10.0)).q
    took = float(np.argmax(q[500:] >= 0.8 * high)) / 1000.0
    table = compared(report)
    largest = [row for row in table.rows if abs(number(row[2]) - number(row[1])) > 115.0]
    assert largest
    assert float(largest[0][4]) == pytest.approx(took, abs=0.02)
    assert float(largest[0][5]) == pytest.approx(float(largest[0][4]) / float(largest[0][3]), rel=0.01)


def test_the_figures_show_it_and_say_what_it_is(report: Report) -> None:
    figures = {f.name: f for section in report.sections for f in section.blocks if isinstance(f, Figure)}
    for name in ("separate", "together"):
        assert "In grey the paper's law" in figures[name].caption
        assert "governor and no plan" in figures[name].caption
    assert "governor" not in figures["steps"].caption
    plain = {
        f.name: f
        for section in tracking_report(source_of(samples(PLAN))).sections
        for f in section.blocks
        if isinstance(f, Figure)
    }
    assert "grey" not in plain["separate"].caption
    assert len(re.findall("<path", figures["separate"].svg)) > len(re.findall("<path", plain["separate"].svg))


def test_nothing_is_beside_a_run_that_had_the_governor_or_another_law() -> None:
    assert simulate_paper_law(source_of(samples(PLAN))) is None
    assert simulate_paper_law(planned(motion="lambda")) is None
    other = planned()
    plan = {**other.run.settings["plan"], "controller": "single-loop"}
    settings = {**other.run.settings, "plan": plan}
    assert simulate_paper_law(replace(other, run=replace(other.run, settings=settings))) is None


def test_what_cannot_be_computed_says_why() -> None:
    source = planned()
    changed = {**source.columns, "lam_q": np.linspace(0.5, 0.6, source.columns["t"].size)}
    gaps = {name: np.delete(column, 500) for name, column in source.columns.items()}
    for columns, reason in ((changed, "λ was changed during the run"), (gaps, "samples are missing")):
        found = simulate_paper_law(replace(source, columns=columns))
        assert found == PaperLawResponse(reason=reason)
        assert make_law_comparison([], PaperLawResponse(reason=reason), AngleUnit.DEGREES) == ()
    report = tracking_report(replace(source, columns=changed))
    assert "would have made of these references was not computed" in to_html(report)


def test_a_step_that_does_not_get_there_is_not_measured(law: PaperLawResponse) -> None:
    step = StepFigures(
        signal="q", phase="q", start_s=0.0, end_s=0.1, before=0.0, after=9.0, alone=True, rise_s=None, reach_s=None,
        settling_s=None, overshoot_percent=None, steady_error=None, cross_coupling=None,
    )  # fmt: skip
    (table,) = make_law_comparison([step], law, AngleUnit.RADIANS)
    assert table.rows[0][3:] == ("not measured", "not measured", "not measured")
