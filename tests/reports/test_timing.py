"""The timing of a run in its report, for samples with known timing."""

from dataclasses import replace

import numpy as np

from backend.models.run import SETTINGS, StoredRealTimeStatus
from backend.reports.model import Table
from backend.reports.run_data import RunData
from backend.reports.timing import timing_section


def rows(source: RunData) -> dict[str, tuple[str, ...]]:
    ((table,),) = [section.blocks for section in timing_section(source)]
    assert isinstance(table, Table)
    return {row[0]: row[1:] for row in table.rows}


def test_lateness_overruns_and_gaps_match_the_samples(tracking_source: RunData) -> None:
    columns = dict(tracking_source.columns)
    size = columns["t"].size
    late = np.full(size, 20e-6)
    late[-1] = 1.5e-3
    overruns = np.arange(size) // 1000 + 4.0
    kept = np.ones(size, bool)
    kept[[100, 101, 102, 2000]] = False  # two gaps
    clocked = {name: column[kept] for name, column in (columns | {"lateness_s": late, "overruns": overruns}).items()}
    found = rows(replace(tracking_source, columns=clocked))
    assert found["Samples"][0] == str(size - 4)
    assert found["Gaps"][0] == "2"
    assert found["Deadlines missed"][0] == f"{overruns[-1] - 4.0:.0f}"
    assert found["Lateness, median"][:2] == ("0.0200", "ms")
    assert found["Lateness, largest"][:2] == ("1.50", "ms")


def test_the_report_states_the_granted_and_refused_real_time_settings(tracking_source: RunData) -> None:
    granted = StoredRealTimeStatus(
        60, memory_locked=False, timer_slack_ns=1, refusals=("locked memory: raise memlock",)
    )
    settings = SETTINGS.write(replace(tracking_source.run.set_to, granted=granted))
    found = rows(replace(tracking_source, run=replace(tracking_source.run, settings=settings)))
    assert found["Scheduling"][0] == "SCHED_FIFO 60"
    assert found["Memory"][0] == "not locked"
    assert found["Timer slack"][:2] == ("1", "ns")
    assert found["Not granted"][-1] == "locked memory: raise memlock"


def test_the_report_of_a_batch_run_has_no_real_time_settings(tracking_source: RunData) -> None:
    assert {"Scheduling", "Memory"} & rows(tracking_source).keys() == set()
    assert rows(tracking_source)["Lateness"][0] == "none"


def test_a_run_without_samples_has_no_timing_section(tracking_source: RunData) -> None:
    empty = {name: column[:0] for name, column in tracking_source.columns.items()}
    assert timing_section(replace(tracking_source, columns=empty)) == ()
