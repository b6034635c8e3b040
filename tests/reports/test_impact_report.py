"""The report of an impact experiment: every hit in a table, drawn over time and speed, and verified by its own text."""

import asyncio
from pathlib import Path

import numpy as np
import pytest

from backend.experiments.plans.loop_settings import LoopSettings
from backend.experiments.plans.stored_plan import ready_plan
from backend.experiments.playing.headless_station import headless_station
from backend.experiments.playing.runner import Order, run_experiment
from backend.experiments.results.impact import hits_of
from backend.reading import Angles
from backend.reports.build import build_report
from backend.reports.differences import Verified
from backend.reports.document import Figure, Table
from backend.reports.html import to_html
from backend.reports.impact import hits_table
from backend.reports.source import Source, load_source
from backend.reports.verification import verify
from backend.storage import open_database
from plant.parameters import load_parameters


@pytest.fixture(scope="module")
def source(tmp_path_factory: pytest.TempPathFactory) -> Source:
    folder: Path = tmp_path_factory.mktemp("impact")
    database = open_database(folder)
    with headless_station(database, load_parameters("lab"), LoopSettings()) as station:
        plan = ready_plan("impact", speeds=2, v_slow=0.3)
        run = asyncio.run(run_experiment(station, Order(plan, LoopSettings(), "A. Operator"))).run
    source = load_source(database, run.id)
    database.close()
    return source


def test_it_passes_shows_every_hit_and_holds(source: Source) -> None:
    report = build_report(source)
    assert (report.title, report.outcome) == ("Impact", "passed")
    blocks = {section.heading: section.blocks for section in report.sections}
    assert [block.name for block in blocks["Figures"] if isinstance(block, Figure)][2:] == ["hits", "tension"]
    (table,) = blocks["Hits"]
    assert isinstance(table, Table)
    assert [row[1] for row in table.rows] == ["8.00", "8.00", "15.0", "15.0"]
    assert verify(to_html(report), source.columns) == Verified((), ())


def test_the_table_is_what_was_recorded_in_the_unit_of_who_reads(source: Source) -> None:
    hits = hits_of(source.columns)
    for angles, factor in ((Angles.RADIANS, 1.0), (Angles.DEGREES, 180.0 / np.pi)):
        table = hits_table(hits, angles)
        for row, hit in zip(table.rows, hits, strict=True):
            seen = [float(cell) for cell in row]
            window = np.abs(source.columns["F_wall"][hit.window])
            expected = [hit.speed * factor, window.max(), window.sum() * 1e-3, 1e3 * np.count_nonzero(window) * 1e-3]
            assert seen[2:] == pytest.approx(expected, rel=6e-3)
    assert [hit.speed for hit in hits] == pytest.approx([0.3, 0.6, 0.3, 0.6], rel=0.05)


def test_a_hit_without_a_speed_says_that_it_was_not_measured(source: Source) -> None:
    table = hits_table([hits_of(source.columns)[0]._replace(speed=float("nan"))], Angles.RADIANS)
    assert table.rows[0][2] == "not measured"
