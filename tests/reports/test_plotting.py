"""Figures of reports: labels, cached drawings, error panels."""

from collections.abc import Callable, Iterator
from dataclasses import replace
from datetime import UTC, datetime
from typing import Any

import numpy as np
import pytest
from matplotlib.figure import Figure as Drawn

from backend.analysis.disturbance_metrics import HoldWindow
from backend.reports.experiment_report import tracking_report
from backend.reports.model import Paragraph, Report, ReportSection, to_html
from backend.reports.plotting import (
    cached_figure,
    figure,
    forget_drawings,
    frequency_axis,
    largest_error,
    limit_line,
    tension_panel,
    tracking_panels,
)
from backend.reports.run_data import RunData
from backend.reports.sections import hold_panels
from backend.reports.series import overlay
from backend.units import AngleUnit
from tests.reports.figure_labels import assert_labels_match_positions, assert_texts_are_legible
from tests.reports.tracking_run import PLAN, samples

# Labels of the figures in reports, compared with the positions of their lines.


@pytest.mark.parametrize(
    ("low", "high"),
    [(0.0, 1.0), (6.2, 7.6), (9.9998, 10.0003), (-2.5, 10.0), (1e-4, 9e-4), (0.0, 2e-5), (1234.5, 1234.9), (0, 3e5)],
)
def test_axis_labels_match_the_positions_of_their_lines(low: float, high: float) -> None:
    with figure(1, height_in=2.0) as (drawn, axes):
        axes.plot(np.linspace(low, high, 50), np.linspace(low, high, 50))
        drawn.draw_without_rendering()
        assert_labels_match_positions(drawn)


@pytest.mark.parametrize("swing", [6e-3, 6e-4, 0.6])
def test_axis_numbers_of_a_held_stiffness_do_not_overlap_the_axis_name(swing: float) -> None:
    """Checked when drawn (conftest): long numbers used to overlap the name of their axis."""
    t = np.linspace(0.0, 20.0, 20000)
    columns = dict.fromkeys(("q", "q_ref", "S_ref", "u_A", "u_B"), np.zeros_like(t))
    columns |= {"t": t, "S": swing * np.sin(t), "u_A": 0.08 * np.sin(t)}
    held = HoldWindow(0.0, 19.9, *([0.0] * 9))
    assert "<svg" in hold_panels(columns, [held], 1e-3, "holds")


def test_frequency_axes_have_plain_decimal_labels() -> None:
    with figure(1, height_in=2.0) as (drawn, axes):
        axes.semilogx([0.06, 1.25], [0.0, 1.0])
        frequency_axis(axes)
        drawn.draw_without_rendering()
        low, high = axes.get_xlim()
        seen = [tick.label1.get_text() for tick in axes.xaxis.get_major_ticks() if low <= tick.get_loc() <= high]
    assert seen == ["0.1", "0.2", "0.5", "1"]


def test_the_legibility_check_detects_cut_or_covered_words() -> None:
    """The check of texts is applied to faulty figures."""
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
            assert_texts_are_legible(drawn)
            spoil(axes)
            drawn.draw_without_rendering()
            with pytest.raises(AssertionError):
                assert_texts_are_legible(drawn)


@pytest.mark.parametrize("first", [1, 10000])
@pytest.mark.parametrize("runs", [3, 8, 9])
def test_the_legend_of_runs_fits_on_one_line_above_the_curves(first: int, runs: int) -> None:
    """Checked when drawn (conftest): the names of seven runs used to take two lines and leave the figure."""
    t = np.linspace(0.0, 1.0, 50)
    columns = dict.fromkeys(("t", "q", "S", "q_ref", "S_ref"), t)
    assert "<svg" in overlay([(first + place, columns) for place in range(runs)], AngleUnit.DEGREES)


def test_estimates_have_a_hat_and_measured_signals_have_none() -> None:
    section = ReportSection("One", (Paragraph("F_ext_hat against F_ext"),))
    report = Report("Title", "", "passed", "", (), (section,), "", datetime(2026, 1, 1, tzinfo=UTC))
    assert "<i>F\N{COMBINING CIRCUMFLEX ACCENT}</i><sub>ext</sub> against <i>F</i><sub>ext</sub>" in to_html(report)


# Drawings are cached by their arguments.

Given = tuple[tuple[Any, ...], dict[str, Any]]
T = np.arange(5.0)
HELD = HoldWindow(0.0, 1.0, *([0.0] * 9))
OTHERS: dict[str, Given] = {
    "a sample": (({"t": T, "q": np.array([0.0, 1.0, 2.0, 3.0, 4.5])}, [HELD]), {"name": "one"}),
    "the type of samples": (({"t": T, "q": T.astype(np.float32)}, [HELD]), {"name": "one"}),
    "the shape of samples": (({"t": T, "q": T[None]}, [HELD]), {"name": "one"}),
    "the name of samples": (({"t": T, "S": T}, [HELD]), {"name": "one"}),
    "no samples": (({"t": T}, [HELD]), {"name": "one"}),
    "a field": (({"t": T, "q": T}, [replace(HELD, end_s=2.0)]), {"name": "one"}),
    "how many": (({"t": T, "q": T}, [HELD, HELD]), {"name": "one"}),
    "a word": (({"t": T, "q": T}, [HELD]), {"name": "two"}),
    "a choice": (({"t": T, "q": T}, [HELD]), {"name": "one", "angles": AngleUnit.RADIANS}),
    "nothing": (({"t": T, "q": T}, [HELD]), {"name": None}),
}


@pytest.fixture
def counted() -> Iterator[tuple[Callable[..., str], list[Given]]]:
    calls: list[Given] = []

    def draw(*args: Any, **named: Any) -> str:
        calls.append((args, named))
        return f"drawing {len(calls)}"

    forget_drawings()
    yield cached_figure(draw), calls
    forget_drawings()


@pytest.mark.parametrize("other", OTHERS)
def test_equal_arguments_are_drawn_once_and_others_are_drawn_again(
    counted: tuple[Callable[..., str], list[Given]], other: str
) -> None:
    draw, calls = counted
    args, named = OTHERS[other]
    assert draw({"t": T, "q": T}, [HELD], name="one") == "drawing 1"
    assert draw({"t": T.copy(), "q": T.copy()}, [replace(HELD)], name="one") == "drawing 1"
    assert draw(*args, **named) == "drawing 2"
    assert draw({"t": T, "q": T}, [HELD], name="one") == "drawing 1"
    assert len(calls) == 2


def test_only_the_latest_drawings_are_cached(counted: tuple[Callable[..., str], list[Given]]) -> None:
    draw, calls = counted
    for number in range(100):
        draw(number)
        draw("always")
    assert len(calls) == 101
    draw(99)
    assert len(calls) == 101
    draw(0)
    assert len(calls) == 102


def test_an_argument_that_cannot_be_a_cache_key_is_rejected(counted: tuple[Callable[..., str], list[Given]]) -> None:
    draw, _ = counted
    with pytest.raises(TypeError, match="a drawing is made of data: function"):
        draw(lambda: 1)


def test_a_report_from_cached_drawings_equals_one_from_new_drawings(tracking_source: RunData) -> None:
    pages = [to_html(tracking_report(tracking_source)) for _ in range(2)]
    forget_drawings()
    assert {*pages, to_html(tracking_report(tracking_source))} == {pages[0]}


# Error panels show small deviations on their own scale and separate coincident curves.


def drawn(monkeypatch: pytest.MonkeyPatch, draw: Any, *args: Any) -> Drawn:
    seen: list[Drawn] = []
    saved = Drawn.savefig

    def save_checked(self: Drawn, *given: Any, **how: Any) -> None:
        seen.append(self)
        saved(self, *given, **how)

    monkeypatch.setattr(Drawn, "savefig", save_checked)
    forget_drawings()
    draw(*args)
    return seen[0]


@pytest.mark.parametrize(("angles", "factor"), [(AngleUnit.RADIANS, 1.0), (AngleUnit.DEGREES, 180.0 / np.pi)])
def test_a_deviation_of_a_fiftieth_fills_its_panel(
    angles: AngleUnit, factor: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    columns = samples(PLAN)
    t = columns["t"]
    end = 15.9  # q alone steps, by up to 120°
    columns["S"] = columns["S_ref"] + 0.02 * np.sin(t)
    columns["q"] = columns["q"] + np.where((t > 3.5) & (t < 3.9), 0.015, 0.0)
    figure = drawn(monkeypatch, tracking_panels, columns, 0.0, end, "ABCDEF", "panels", 10.0, angles)
    q, e_q, S, e_S, u_A, u_B = figure.axes
    assert e_S.get_ylabel() == "$e_S$ [mN·m/rad]"
    assert e_S.get_ylim() == pytest.approx((-23.0, 23.0), rel=0.02)
    assert e_q.get_ylabel() == f"$e_q$ [{'rad' if angles is AngleUnit.RADIANS else '°'}]"
    assert 0.015 * factor < e_q.get_ylim()[1] < 0.06 * factor
    for panel, signal in ((e_q, "q"), (e_S, "S")):
        error = columns[signal] - columns[f"{signal}_ref"]
        inside = (t < end - 1e-9) & (t > 3.5)
        scale = factor if signal == "q" else 1e3
        line = panel.lines[0]
        x, y = np.asarray(line.get_xdata()), np.asarray(line.get_ydata())
        drawn_peak = np.abs(y[(x > 3.5) & (x < 4.0 - 1e-9)]).max()
        assert drawn_peak == pytest.approx(scale * np.abs(error[inside & (t < 4.0 - 1e-9)]).max(), rel=0.02)
    assert q.get_ylim()[1] > 0.9 * factor
    assert S.get_ylim()[0] < 10.0
    assert [len(panel.lines) - 2 for panel in (u_A, u_B)] == [1, 1]  # each voltage with its two bounds


def test_equal_tensions_have_separate_panels(monkeypatch: pytest.MonkeyPatch) -> None:
    t = np.arange(2000) * 1e-3
    figure = drawn(monkeypatch, tension_panel, {"t": t, "F_A": 20.0 + t, "F_B": 20.0 + t}, 50.0, "tension")
    assert [panel.lines[0].get_label() for panel in figure.axes] == ["$F_A$", "$F_B$"]


def test_the_transition_to_a_new_reference_is_excluded_from_the_error() -> None:
    t = np.arange(4000) * 1e-3
    reference = np.where(t < 1.0, 0.0, 1.0)
    error = np.where(t < 1.0, 0.0, -np.exp(-(t - 1.0) / 0.1))
    error[3000:] = 0.03
    assert largest_error("q", error, reference) == pytest.approx(0.03)
    never = np.where(t < 1.0, 0.004, -1.0)
    assert largest_error("q", never, reference) == pytest.approx(0.004)
    sine = np.sin(t)
    assert largest_error("q", 0.05 * np.cos(2 * t) - 0.05, sine) == pytest.approx(0.1, rel=1e-3)
