from collections.abc import Iterator
from typing import Any

import pytest
from matplotlib.figure import Figure

from backend.reports.experiment_report import tracking_report
from backend.reports.model import Report
from backend.reports.plotting import forget_drawings
from backend.reports.run_data import RunData
from tests.reports.figure_labels import assert_figure_is_readable
from tests.reports.tracking_run import PLAN, samples, source_of


@pytest.fixture(scope="package", autouse=True)
def check_figures() -> Iterator[None]:
    """Check the labels and texts of every figure that a report draws in these tests, when it is saved."""
    drawn = Figure.savefig

    def save_checked(self: Figure, *args: Any, **how: Any) -> None:
        assert_figure_is_readable(self)
        drawn(self, *args, **how)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Figure, "savefig", save_checked)
        forget_drawings()
        yield


@pytest.fixture(scope="session")
def tracking_source() -> RunData:
    return source_of(samples(PLAN), bank=True, note="<b>first</b> & last; #eval(1)")


@pytest.fixture(scope="session")
def report(tracking_source: RunData) -> Report:
    return tracking_report(tracking_source)
