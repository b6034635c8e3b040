import pytest

from backend.reports.document import Report
from backend.reports.source import Source
from backend.reports.tracking import tracking_report
from tests.reports.tracking_run import PLAN, samples, source_of


@pytest.fixture(scope="session")
def tracking_source() -> Source:
    return source_of(samples(PLAN), bank=True, note="<b>first</b> & last; #eval(1)")


@pytest.fixture(scope="session")
def report(tracking_source: Source) -> Report:
    return tracking_report(tracking_source)
