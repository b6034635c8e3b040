"""Labels of the figures in reports, against where their lines are."""

from datetime import UTC, datetime

import numpy as np
import pytest

from backend.analysis.disturbance_metrics import HoldWindow
from backend.reports.model import Paragraph, Report, ReportSection, to_html
from backend.reports.plotting import figure, frequency_axis, limit_line
from backend.reports.sections import hold_panels
from backend.reports.series import overlay
from backend.units import AngleUnit
from tests.reports.figure_labels import assert_labels_are_true, assert_words_are_legible


@pytest.mark.parametrize(
    ("low", "high"),
    [(0.0, 1.0), (6.2, 7.6), (9.9998, 10.0003), (-2.5, 10.0), (1e-4, 9e-4), (0.0, 2e-5), (1234.5, 1234.9), (0, 3e5)],
)
def test_labels_tell_where_their_lines_are(low: float, high: float) -> None:
    with figure(1, height_in=2.0) as (drawn, axes):
        axes.plot(np.linspace(low, high, 50), np.linspace(low, high, 50))
        drawn.draw_without_rendering()
        assert_labels_are_true(drawn)


@pytest.mark.parametrize("swing", [6e-3, 6e-4, 0.6])
def test_the_swing_of_a_held_stiffness_is_read_beside_its_name(swing: float) -> None:
    """Looked at as it is drawn (conftest): long numbers ran into the name of their axis."""
    t = np.linspace(0.0, 20.0, 20000)
    columns = dict.fromkeys(("q", "q_ref", "S_ref", "u_A", "u_B"), np.zeros_like(t))
    columns |= {"t": t, "S": swing * np.sin(t), "u_A": 0.08 * np.sin(t)}
    held = HoldWindow(0.0, 19.9, *([0.0] * 9))
    assert "<svg" in hold_panels(columns, [held], 1e-3, "holds")


def test_frequencies_are_numbered_as_they_are_spoken_of() -> None:
    with figure(1, height_in=2.0) as (drawn, axes):
        axes.semilogx([0.06, 1.25], [0.0, 1.0])
        frequency_axis(axes)
        drawn.draw_without_rendering()
        low, high = axes.get_xlim()
        seen = [tick.label1.get_text() for tick in axes.xaxis.get_major_ticks() if low <= tick.get_loc() <= high]
    assert seen == ["0.1", "0.2", "0.5", "1"]


def test_what_is_cut_or_covered_is_found() -> None:
    """The look at the words of figures, at figures that are wrong."""
    for spoil in (
        lambda axes: axes[0].legend(loc="lower right", bbox_to_anchor=(1.0, 1.5)),
        lambda axes: axes[1].legend(loc="lower right", bbox_to_anchor=(1.0, 1.3)),
        lambda axes: axes[0].yaxis.set_label_coords(-0.02, 0.5),
        lambda axes: limit_line(axes[1], 0.05, "at the edge"),
    ):
        with figure(2, height_in=3.0) as (drawn, axes):
            for panel in axes:
                panel.plot([0.0, 1.0], [0.0, 1.0], label="a line")
                panel.set(ylabel="its name", ylim=(0.0, 1.0))
            drawn.draw_without_rendering()
            assert_words_are_legible(drawn)
            spoil(axes)
            drawn.draw_without_rendering()
            with pytest.raises(AssertionError):
                assert_words_are_legible(drawn)


@pytest.mark.parametrize("first", [1, 10000])
@pytest.mark.parametrize("runs", [3, 8, 9])
def test_runs_are_named_in_one_line_above_their_curves(first: int, runs: int) -> None:
    """Looked at as it is drawn (conftest): the names of seven runs took two lines and left the figure."""
    t = np.linspace(0.0, 1.0, 50)
    columns = dict.fromkeys(("t", "q", "S", "q_ref", "S_ref"), t)
    assert "<svg" in overlay([(first + place, columns) for place in range(runs)], AngleUnit.DEGREES)


def test_an_estimate_has_its_hat_and_what_is_measured_has_none() -> None:
    section = ReportSection("One", (Paragraph("F_ext_hat against F_ext"),))
    said = Report("Title", "", "passed", "", (), (section,), "", datetime(2026, 1, 1, tzinfo=UTC))
    assert "<i>F\N{COMBINING CIRCUMFLEX ACCENT}</i><sub>ext</sub> against <i>F</i><sub>ext</sub>" in to_html(said)
