"""Labels of the figures in reports, against where their lines are."""

import numpy as np
import pytest

from backend.reports.drawing import figure
from tests.reports.figure_labels import assert_labels_are_true


@pytest.mark.parametrize(
    ("low", "high"),
    [(0.0, 1.0), (6.2, 7.6), (9.9998, 10.0003), (-2.5, 10.0), (1e-4, 9e-4), (0.0, 2e-5), (1234.5, 1234.9), (0, 3e5)],
)
def test_labels_tell_where_their_lines_are(low: float, high: float) -> None:
    with figure(1, height_in=2.0) as (drawn, axes):
        axes.plot(np.linspace(low, high, 50), np.linspace(low, high, 50))
        assert_labels_are_true(drawn)
