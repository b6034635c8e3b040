"""Compliance metrics of an ideal spring with delayed load cells and an offset."""

import numpy as np
import pytest
from numpy.typing import NDArray

from backend.analysis.disturbance_metrics import compute_compliance_metrics
from backend.analysis.step_metrics import NoSamplesError
from tests.experiments.judging import LEAD_IN_S, compliance_criteria

R_J = 0.075
Array = NDArray[np.float64]


def pushed(*, stiffness: float = 10.0, delay_ms: int = 0, offset_N: float = 0.0) -> dict[str, Array]:
    """A joint of ``stiffness`` under a push of 12 N at 0.5 Hz after the lead-in."""
    t = np.arange(round(1000 * (LEAD_IN_S + 10.0))) * 1e-3
    F_push = np.where(t < LEAD_IN_S, 0.0, 12.0 * np.sin(np.pi * (t - LEAD_IN_S)))
    seen = np.concatenate([np.zeros(delay_ms), F_push[: t.size - delay_ms]])
    ones = np.ones_like(t)
    return {
        "t": t,
        "q": R_J * F_push / stiffness,
        "S": 10.0 * ones,
        "S_ref": 10.0 * ones,
        "F_A": 17.0 - 0.5 * seen + offset_N,
        "F_B": 17.0 + 0.5 * seen,
        "u_A": ones,
        "u_B": -2.0 * ones,
    }


def test_a_spring_of_the_commanded_stiffness_agrees_exactly() -> None:
    figures = compute_compliance_metrics(pushed(), R_J, LEAD_IN_S)
    assert figures.rmse_raw_N == pytest.approx(0.0, abs=1e-9)
    assert figures.rmse_aligned_N == pytest.approx(0.0, abs=1e-9)
    assert figures.delay_s == 0.0
    assert figures.stiffness_felt == pytest.approx(10.0)
    assert figures.largest_push_N == pytest.approx(12.0, rel=1e-4)
    assert figures.min_tension_N == pytest.approx(11.0, rel=1e-4)
    assert figures.peak_voltage_V == 2.0


def test_delay_and_offset_are_in_the_raw_error_and_out_of_the_aligned_one() -> None:
    figures = compute_compliance_metrics(pushed(delay_ms=12, offset_N=0.7), R_J, LEAD_IN_S)
    assert figures.delay_s == pytest.approx(0.012)
    # an offset and the sine's difference over 12 ms, uncorrelated: 12 N · 2 sin(π·0.5·0.012) / √2
    shift = 12.0 * 2.0 * np.sin(np.pi * 0.5 * 0.012) / np.sqrt(2.0)
    assert figures.rmse_raw_N == pytest.approx(np.hypot(0.7, shift), rel=0.01)
    assert figures.rmse_aligned_N is not None
    assert figures.rmse_aligned_N < 1e-6


def test_another_stiffness_is_felt_and_counts_as_error() -> None:
    figures = compute_compliance_metrics(pushed(stiffness=11.0), R_J, LEAD_IN_S)
    assert figures.stiffness_felt == pytest.approx(11.0)
    assert figures.rmse_aligned_N == pytest.approx((1.0 - 10.0 / 11.0) * 12.0 / np.sqrt(2.0), rel=0.01)
    verdicts = {item.name: item.passed for item in compliance_criteria(figures)}
    assert verdicts == {"rmse_aligned": False, "min_tension": True}


def test_a_run_without_pushes_has_no_figures() -> None:
    columns = {name: column[:5_000] for name, column in pushed().items()}
    with pytest.raises(NoSamplesError, match="before the pushes"):
        compute_compliance_metrics(columns, R_J, LEAD_IN_S)


def test_the_estimated_force_is_compared_with_the_reaction_of_the_load_cells() -> None:
    columns = pushed(delay_ms=12)
    F_push = R_J**-1 * 10.0 * columns["q"]
    columns["F_ext_hat"] = F_push + 0.4  # its bias is taken off
    assert compute_compliance_metrics(columns, R_J, LEAD_IN_S).rmse_estimated_N == pytest.approx(0.0, abs=1e-6)
    columns["F_ext_hat"] = 0.9 * F_push
    off = compute_compliance_metrics(columns, R_J, LEAD_IN_S).rmse_estimated_N
    assert off == pytest.approx(1.2 / np.sqrt(2.0), rel=0.01)
    for unknown in (None, np.where(columns["t"] > 5.0, np.nan, F_push)):
        if unknown is None:
            del columns["F_ext_hat"]
        else:
            columns["F_ext_hat"] = unknown
        figures = compute_compliance_metrics(columns, R_J, LEAD_IN_S)
        assert figures.rmse_estimated_N is None
        assert "no estimate" in figures.reasons["rmse_estimated_N"]
