"""The report of an impact experiment: every hit in a table, drawn over time and speed, and verified by its own text."""

import asyncio
from pathlib import Path

import numpy as np
import pytest

from backend.analysis.disturbance_metrics import find_hits
from backend.execution.runner import RunRequest, run_experiment
from backend.execution.simulation import open_headless_rig
from backend.experiments.library import build_ready_plan
from backend.experiments.plans import LoopSettings
from backend.reports.build import build_report
from backend.reports.model import NO_FIGURE, Figure, Table, to_html
from backend.reports.run_data import RunData, load_source
from backend.reports.sections import hits_table, reaction_tables
from backend.reports.verification import Verified, verify_report
from backend.storage.database import open_database
from backend.units import AngleUnit
from plant.parameters import load_parameters

PLAN = build_ready_plan("impact", speeds=2, v_slow=0.3)


@pytest.fixture(scope="module")
def source(tmp_path_factory: pytest.TempPathFactory) -> RunData:
    folder: Path = tmp_path_factory.mktemp("impact")
    database = open_database(folder)
    with open_headless_rig(database, load_parameters("lab"), LoopSettings()) as station:
        run = asyncio.run(run_experiment(station, RunRequest(PLAN, LoopSettings(), "A. Operator"))).run
    source = load_source(database, run.id)
    database.close()
    return source


def test_it_passes_shows_every_hit_and_holds(source: RunData) -> None:
    report = build_report(source)
    assert (report.title, report.outcome) == ("Impact", "passed")
    blocks = {section.heading: section.blocks for section in report.sections}
    assert [block.name for block in blocks["Figures"] if isinstance(block, Figure)][1:] == ["hits", "tension"]
    table, beside = blocks["Hits"]
    assert isinstance(table, Table)
    assert isinstance(beside, Table)
    assert [row[1] for row in table.rows] == ["8.00"] * 2 + ["15.0"] * 4 + ["8.00"] * 2
    assert [row[0] for row in beside.rows] == ["8.00", "8.00", "15.0", "15.0"]
    assert verify_report(to_html(report), source.columns) == Verified((), ())


def test_the_table_is_what_was_recorded_in_the_unit_of_who_reads(source: RunData) -> None:
    hits = find_hits(source.columns, PLAN.program())
    limits, estimate = source.columns["limits"].astype(int), np.abs(source.columns["F_ext_hat"])
    for angles, factor in ((AngleUnit.RADIANS, 1.0), (AngleUnit.DEGREES, 180.0 / np.pi)):
        table = hits_table(hits, angles)
        for row, hit in zip(table.rows, hits, strict=True):
            seen = [float(cell) for cell in row if cell != NO_FIGURE]
            window = np.abs(source.columns["F_wall"][hit.window])
            expected = [hit.speed * factor, window.max(), window.sum() * 1e-3, 1e3 * np.count_nonzero(window) * 1e-3]
            assert seen[2:6] == pytest.approx(expected, rel=6e-3)
            if not hit.reacts:
                assert row[6:] == (NO_FIGURE,) * 4
                continue
            touch = hit.window.start
            felt, gave = (int(np.argmax(from_touch)) for from_touch in (estimate[touch:] > 1.2, limits[touch:] & 64))
            assert seen[6:] == [1.2, felt, gave - felt, int(np.argmax(window)) - felt]
    assert [hit.speed for hit in hits] == pytest.approx([0.3, 0.6] * 4, rel=0.05)


def test_hits_with_reaction_stand_beside_those_without(source: RunData) -> None:
    hits = find_hits(source.columns, PLAN.program())
    (table,) = reaction_tables(hits, AngleUnit.RADIANS)
    for row, plain, reacted in zip(table.rows, (*hits[:2], *hits[2:4]), (*hits[6:], *hits[4:6]), strict=True):
        expected = [plain.peak_N, reacted.peak_N, reacted.peak_N / plain.peak_N]
        expected += [plain.impulse_Ns, reacted.impulse_Ns, reacted.impulse_Ns / plain.impulse_Ns]
        assert [float(cell) for cell in row[2:]] == pytest.approx(expected, rel=6e-3)
    assert reaction_tables(hits[:4], AngleUnit.RADIANS) == ()


def test_a_hit_that_was_not_felt_says_so(source: RunData) -> None:
    hit = find_hits(source.columns, PLAN.program())[-1]._replace(detection_s=float("nan"), reaction_s=float("nan"))
    assert hits_table([hit], AngleUnit.RADIANS).rows[0][7:9] == ("not felt", "not felt")


def test_a_hit_without_a_speed_says_that_it_was_not_measured(source: RunData) -> None:
    table = hits_table([find_hits(source.columns)[0]._replace(speed=float("nan"))], AngleUnit.RADIANS)
    assert table.rows[0][2] == "not measured"
