"""What a search finds among many runs is what somebody finds who looks at each of them."""

from collections.abc import Callable
from contextlib import closing
from datetime import UTC, datetime
from pathlib import Path

from backend.services.runs import RunQuery, StoredRuns
from backend.storage.database import open_database
from backend.storage.runs import EndState, RunKind
from tests.bench.many_runs import Made, make_runs

COUNT = 600
FITS: dict[str, Callable[[Made], bool]] = {
    "": lambda run: True,
    "worn": lambda run: "worn" in run.note,
    "kind = tracking": lambda run: run.kind is RunKind.TRACKING,
    "overshoot_q_percent < 5": lambda run: run.overshoot is not None and run.overshoot < 5,
    "not overshoot_q_percent < 5": lambda run: run.overshoot is None or run.overshoot >= 5,
    "overshoot_q_percent = none": lambda run: run.overshoot is None,
    "geometry.r_j > 0.0725": lambda run: run.r_j > 0.0725,
    "tag = paper": lambda run: run.number % 13 == 0,
    "verdict = failed": lambda run: run.overshoot is not None and run.overshoot >= 5,
    "who ~ öz or end = tripped": lambda run: "Öz" in run.who or run.end is EndState.TRIPPED,
    "lam_q >= 0.5 date >= 2026-01-03": lambda run: run.lam_q >= 0.5 and run.started >= datetime(2026, 1, 3, tzinfo=UTC),
    "figure_7 = 3 not kind = compliance": lambda run: (
        run.kind not in (RunKind.SESSION, RunKind.COMPLIANCE) and run.number % 9 == 3
    ),
}


def test_each_search_finds_what_fits_page_by_page(tmp_path: Path) -> None:
    with closing(open_database(tmp_path)) as database:
        made = make_runs(database, COUNT)
        stored = StoredRuns(database, lambda: None, lambda _run: False)
        for where, fits in FITS.items():
            expected = [number for number in sorted(made, reverse=True) if fits(made[number])]
            assert 0 < len(expected) <= COUNT
            found: list[int] = []
            while True:
                page = stored.find_runs(RunQuery(where=(where,), limit=130, offset=len(found)))
                assert page.total == len(expected)
                found += [run.id for run in page.runs]
                if not page.runs:
                    break
            assert found == expected, where
            first = stored.find_runs(RunQuery(where=(where,), limit=1)).runs[0]
            assert (first.note, first.who) == (made[first.id].note, made[first.id].who)
