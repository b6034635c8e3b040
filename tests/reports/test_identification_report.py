"""The report of an actuator identification, from a record made with known transfer functions."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from matplotlib.figure import Figure as Drawn

from backend.experiments.plans import ActuatorIdentificationPlan
from backend.identification.models import Model
from backend.models.run import MeasuredFigure as Measured
from backend.models.run import Metrics
from backend.reports import messages
from backend.reports.build import build_report
from backend.reports.model import Figure, Report, Table, to_html
from backend.reports.pdf import to_pdf
from backend.reports.plotting import forget_drawings, simulated_from_rest
from backend.reports.run_data import RunData
from backend.sample import STORED_NAMES
from backend.storage.identifications import Identification
from backend.units import AngleUnit
from plant.interface import T_s
from tests.reports.tracking_run import BEGAN, PLAN, samples, source_of

DEG, RAD = AngleUnit.DEGREES, AngleUnit.RADIANS
REST = 1_000
PLAYED = Metrics(complete=True, played_s=3.48, planned_s=3.48)


def record() -> dict[str, np.ndarray]:
    excitation = ActuatorIdentificationPlan(bits=5, periods=1).excitation()
    levels = np.array([1.0 if level == "+" else -1.0 for level in excitation.levels])
    u = np.concatenate([np.zeros(REST), np.repeat(levels, 80)])
    y, pole = u, np.exp(-T_s / 0.0854)
    for _ in range(4):
        y = np.array([state := 0.0] + [state := pole * state + (1 - pole) * value for value in y[:-1]])
    columns = {name: np.zeros_like(u) for name in STORED_NAMES}
    return columns | {"t": np.arange(u.size) * T_s, "theta_A_ref": 9.0 + u, "q": 0.47 + 0.05 * y, "S": 10.5 + 0.72 * y}


def identification() -> Identification:
    test = {"lags_s": [0.1, 0.2], "correlation": [0.01, 0.3], "bound": [0.1, 0.1], "passed": False}
    model, quality = {}, {}
    for key, gain, geometry in (("G_q", 0.05, 0.05), ("G_S", 0.72, 0.7209)):
        reduced = {"K": gain, "T": 0.3416, "K_std": 1e-4, "T_std": 2e-4}
        model[key] = {"structure": "lags4", "parameters": {"K": gain, "tau": 0.0854}, "first_order": reduced}
        quality[key] = {
            "fit_percent": 97.0,
            "gain_geometry": geometry,
            "gain_error_percent": 100 * (gain / geometry - 1),
            "grade": "usable with caution",
            "candidates": [
                {
                    "structure": "lags4",
                    "K": gain,
                    "T": 0.34,
                    "fit_percent": 97.0,
                    "BIC": -1234.5,
                    "grade": "usable",
                    "problem": "",
                },
                {"structure": "third", "problem": "not converged"},
            ],
            "residuals": {"whiteness": test, "input_correlation": {**test, "passed": True}},
        }
    quality["G_q"]["arx"] = {"K": 0.048, "T": 0.31, "problem": ""}
    return Identification(
        id=5,
        kind="actuator",
        run_id=12,
        data={"first_sample": REST, "samples": 2_480, "period_s": T_s},
        method="output error",
        options={"tension_N": 20.0},
        model={"S_nominal": 10.55, "q_nominal": 0.474, **model},
        quality=quality,
        usable=True,
        verdict="Usable with caution for tuning: friction.",
        who="A. Operator",
        software="0.1.0",
        created_at=BEGAN,
    )


def source(found: Identification | None, metrics: Metrics) -> RunData:
    tracked = source_of({name: column[:100] for name, column in samples(PLAN).items()})
    assert tracked.result is not None
    settings = {**tracked.run.settings, "plan": {"tension_N": 20.0}}
    run = replace(tracked.run, kind="actuator_identification", settings=settings)
    return RunData(run, replace(tracked.result, metrics=metrics, criteria=()), record(), None, found)


@pytest.fixture(scope="module")
def report() -> Report:
    motion = Measured("motion_counts", "1", "Joint motion", "peak to peak", 57.0)
    return build_report(source(identification(), replace(PLAYED, figures=(motion,))))


def test_the_report_contains_models_geometry_and_table_1(report: Report) -> None:
    assert report.title == messages.actuator_identification_at(tension_N=20.0)
    assert (report.outcome, report.verdict) == ("incomplete", "Usable with caution for tuning: friction.")
    tables = [block for section in report.sections for block in section.blocks if isinstance(block, Table)]
    assert all(len(row) == len(table.columns) for table in tables for row in table.rows)
    models, candidates, comparison = tables[0].rows, tables[1].rows, tables[2].rows
    assert models[0][:4] == ("G_q", "K/(τs+1)⁴", "0.05000", "0.00010")
    assert models[1][5] == "−0.12"
    assert models[0][-1] == messages.residual_tests(
        is_white=False, white=8.4, white_max=2.8, is_independent=True, cross=8.4, cross_max=2.8
    )
    assert candidates[0] == ("G_q", "K/(τs+1)⁴", "0.05000", "0.340", "97.0", "−1234", "usable")
    assert candidates[1] == ("G_q", "third order", "–", "–", "–", "–", "not converged")
    assert comparison[0] == ("G_q", "0.05000", "0.05000", "0.04800", "0.04840", "0.342", "0.310", "0.780")
    assert comparison[1] == ("G_S", "0.7200", "0.7209", "–", "2.826", "0.342", "–", "1.19")
    assert tables[2].caption.startswith(messages.compared_with_table_1(tension_N=20.0, missing={"G_S": None}))
    assert [table.caption.endswith(messages.dash_means_no_value()) for table in tables[:3]] == [
        False,
        True,
        True,
    ]


def test_the_report_is_rendered_with_its_four_figures(report: Report) -> None:
    figures = [block.name for section in report.sections for block in section.blocks if isinstance(block, Figure)]
    assert figures == ["record", "bode", "step", "residuals"]
    assert to_html(report).count("<svg") == 4
    assert to_pdf(report).startswith(b"%PDF-")


@pytest.mark.parametrize(
    ("angles", "step_rad", "words", "ends"),
    [(DEG, np.radians(10.0), "10°", (0.5, 0.1256)), (RAD, 1.0, "1 rad", (0.05, 0.72))],
)
def test_the_drawn_step_has_a_round_size_in_the_unit_of_the_axis(
    angles: AngleUnit, step_rad: float, words: str, ends: tuple[float, float], monkeypatch: pytest.MonkeyPatch
) -> None:
    """The caption states the step; the first-order models end at K times the step, in the unit of the axis."""
    seen: dict[str, float] = {}
    saved = Drawn.savefig

    def save_checked(self: Drawn, *args: Any, **how: Any) -> None:
        ends = {axis.get_ylabel(): np.asarray(axis.lines[1].get_ydata())[-1] for axis in self.axes if axis.lines[1:]}
        seen.update({label: float(end) for label, end in ends.items()})
        saved(self, *args, **how)

    monkeypatch.setattr(Drawn, "savefig", save_checked)
    forget_drawings()
    made = build_report(replace(source(identification(), PLAYED), angles=angles))
    captions = [block.caption for section in made.sections for block in section.blocks if isinstance(block, Figure)]
    caption = messages.step_response_figure(step_rad=step_rad, angles=angles)
    assert words in caption.replace("\N{NARROW NO-BREAK SPACE}", " ")
    assert caption in captions
    to_html(made)
    assert seen[f"q [{'°' if angles is DEG else 'rad'}]"] == pytest.approx(ends[0], rel=5e-3)
    assert seen["S [N·m/rad]"] == pytest.approx(ends[1], rel=5e-3)


def test_the_report_of_a_run_without_a_model_has_a_reason() -> None:
    report = build_report(source(None, replace(PLAYED, complete=False, problem="somebody stopped it")))
    assert report.outcome == "incomplete"
    assert report.verdict == "somebody stopped it"
    assert to_pdf(report).startswith(b"%PDF-")


def test_the_simulation_in_the_record_figure_is_that_of_the_model() -> None:
    columns = record()
    right = simulated_from_rest(columns, REST, "q", Model("lags4", {"K": 0.05, "tau": 0.0854}), T_s)
    wrong = simulated_from_rest(columns, REST, "q", Model("lags4", {"K": 0.05, "tau": 0.2}), T_s)
    assert np.abs(right - columns["q"][REST:]).max() < 5e-4
    assert np.abs(wrong - columns["q"][REST:]).max() > 1e-2
