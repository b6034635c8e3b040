"""What error panels show: small deviations on their own scale, and curves that lie on each other apart."""

from typing import Any

import numpy as np
import pytest
from matplotlib.figure import Figure as Drawn

from backend.reports.plotting import forget_drawings, largest_error, tension_panel, tracking_panels
from backend.units import AngleUnit
from tests.reports.tracking_run import PLAN, samples


def drawn(monkeypatch: pytest.MonkeyPatch, draw: Any, *args: Any) -> Drawn:
    seen: list[Drawn] = []
    saved = Drawn.savefig

    def looked_at(self: Drawn, *given: Any, **how: Any) -> None:
        seen.append(self)
        saved(self, *given, **how)

    monkeypatch.setattr(Drawn, "savefig", looked_at)
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
    assert [len(panel.lines) - 2 for panel in (u_A, u_B)] == [1, 1]  # each voltage beside its two bounds


def test_tensions_that_are_equal_have_a_panel_each(monkeypatch: pytest.MonkeyPatch) -> None:
    t = np.arange(2000) * 1e-3
    figure = drawn(monkeypatch, tension_panel, {"t": t, "F_A": 20.0 + t, "F_B": 20.0 + t}, 50.0, "tension")
    assert [panel.lines[0].get_label() for panel in figure.axes] == ["$F_A$", "$F_B$"]


def test_the_way_to_a_new_reference_is_none_of_the_error() -> None:
    t = np.arange(4000) * 1e-3
    reference = np.where(t < 1.0, 0.0, 1.0)
    error = np.where(t < 1.0, 0.0, -np.exp(-(t - 1.0) / 0.1))
    error[3000:] = 0.03
    assert largest_error("q", error, reference) == pytest.approx(0.03)
    never = np.where(t < 1.0, 0.004, -1.0)
    assert largest_error("q", never, reference) == pytest.approx(0.004)
    sine = np.sin(t)
    assert largest_error("q", 0.05 * np.cos(2 * t) - 0.05, sine) == pytest.approx(0.1, rel=1e-3)
