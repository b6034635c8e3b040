"""Frequency responses of signals filtered by known systems."""

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.signal import lfilter

from backend.analysis.frequency_metrics import (
    LOW_GAIN_MIN,
    Response,
    compute_bandwidth,
    compute_lag,
    compute_resonance,
    compute_response_metrics,
    compute_responses,
)
from backend.analysis.step_metrics import NoSamplesError, list_excitations
from backend.control.motion_types import Setpoint
from backend.control.setpoint_player import step_setpoint_player
from backend.realtime.motions import make_segment_player
from backend.realtime.program import Program
from plant.interface import T_s
from tests.experiments.composing.written import plan_of, with_parts

Array = NDArray[np.float64]
LEAD_IN = "{do: step, q_ref: 0.0, S_ref: 11.0, duration_s: 4.0}"
MULTISINE = "{do: multisine, q_amplitude: 0.1, period_s: 10, lines: 30, periods: 3}"
LAG_S = 0.4


def references(program: Program) -> tuple[Array, Array]:
    """What the loop's own player gives, tick by tick."""
    player, target = make_segment_player(program.segments, Setpoint(0.0, 10.0, 0.0)), Setpoint(0.0, 10.0, 0.0)
    rows = []
    done = False
    while not done:
        done, target, player = step_setpoint_player(player, target)
        if not done:
            rows.append((target.q_ref, target.S_ref))
    both = np.array(rows)
    return both[:, 0], both[:, 1]


def behind(u: Array, lag_s: float) -> Array:
    """A first-order lag, exact for an input that is held between samples."""
    pole = np.exp(-T_s / lag_s)
    return np.asarray(lfilter([0.0, 1.0 - pole], [1.0, -pole], u - u[0]) + u[0])


def columns_of(program: Program, lag_q: float = LAG_S, lag_S: float = LAG_S) -> dict[str, Array]:
    q_ref, S_ref = references(program)
    ones = np.ones_like(q_ref)
    return {
        "q_ref": q_ref,
        "S_ref": S_ref,
        "q": behind(q_ref, lag_q),
        "S": behind(S_ref, lag_S),
        "F_A": 20.0 * ones,
        "F_B": 18.0 * ones,
        "u_A": ones,
        "u_B": -3.0 * ones,
    }


def lag(f: Array, lag_s: float) -> NDArray[np.complex128]:
    """Response of the sampled lag: what a held input gives at the samples."""
    pole, z = np.exp(-T_s / lag_s), np.exp(2j * np.pi * f * T_s)
    return np.asarray((1.0 - pole) / (z - pole))


def test_a_first_order_lag_is_found_line_by_line() -> None:
    program = plan_of(with_parts(LEAD_IN, MULTISINE)).program()
    (found,) = compute_responses(columns_of(program), program)
    np.testing.assert_allclose(found.f, np.arange(1, 31) / 10.0, rtol=1e-12)
    np.testing.assert_allclose(found.H, lag(found.f, LAG_S), rtol=1e-6)


@pytest.mark.parametrize("lag_s", [0.15, 0.4, 1.0])
def test_the_bandwidth_of_a_lag_is_one_over_its_time(lag_s: float) -> None:
    program = plan_of(with_parts(LEAD_IN, MULTISINE)).program()
    figures = compute_response_metrics(columns_of(program, lag_q=lag_s), program)
    assert figures.bandwidth_q_Hz == pytest.approx(1.0 / (2.0 * np.pi * lag_s), rel=0.003)
    assert figures.lag_q_deg == pytest.approx(45.0, abs=0.3)
    assert figures.resonance_q_dB == 0.0
    assert (figures.min_tension_N, figures.peak_voltage_V) == (18.0, 3.0)
    assert figures.bandwidth_S_Hz is None
    assert figures.reasons["bandwidth_S_Hz"] == "the reference of S alone was not excited to the end"


@pytest.mark.parametrize(
    "part",
    [
        "{do: sweep, S_amplitude: 0.5, from_Hz: 0.05, to_Hz: 5, duration_s: 200}",
        "{do: prbs, S_amplitude: 0.5, chip_s: 0.1, bits: 10, periods: 2}",
    ],
)
def test_a_sweep_and_a_sequence_estimate_the_same(part: str) -> None:
    program = plan_of(with_parts(LEAD_IN, part, "{do: hold, duration_s: 4}")).program()
    (found,) = compute_responses(columns_of(program), program)
    inner = (found.f > 0.1) & (found.f < 3.0)
    assert inner.sum() > 10
    np.testing.assert_allclose(np.abs(found.H[inner]), np.abs(lag(found.f[inner], LAG_S)), rtol=0.06)


def test_a_bandwidth_above_the_highest_line_has_a_reason() -> None:
    program = plan_of(with_parts(LEAD_IN, MULTISINE)).program()
    figures = compute_response_metrics(columns_of(program, lag_q=0.01), program)
    assert figures.bandwidth_q_Hz is None
    assert "still above −3 dB at 3 Hz, the highest line" in figures.reasons["bandwidth_q_Hz"]


def test_a_response_that_was_not_played_to_its_end_is_not_measured() -> None:
    program = plan_of(with_parts(LEAD_IN, MULTISINE)).program()
    early = {name: column[:-10] for name, column in columns_of(program).items()}
    with pytest.raises(NoSamplesError, match="no excitation of one reference alone was played to its end"):
        compute_response_metrics(early, program)


def test_both_references_at_once_are_no_response_of_one() -> None:
    program = plan_of(with_parts(LEAD_IN, MULTISINE.replace("q_amplitude: 0.1", "q_amplitude: 0.1, S_amplitude: 0.5")))
    assert list_excitations(program.program()) == ()


@pytest.mark.parametrize(
    ("q", "reason"),
    [(np.nan, "a sample of it holds no number"), (0.02, "q did not follow its reference at the lowest")],
)
def test_a_joint_without_motion_or_samples_has_no_response(q: float, reason: str) -> None:
    program = plan_of(with_parts(LEAD_IN, MULTISINE)).program()
    columns = columns_of(program)
    columns["q"] = np.full_like(columns["q"], q)
    figures = compute_response_metrics(columns, program)
    assert (figures.bandwidth_q_Hz, figures.resonance_q_dB, figures.lag_q_deg) == (None, None, None)
    assert all(reason in figures.reasons[name] for name in ("bandwidth_q_Hz", "resonance_q_dB", "lag_q_deg"))


def test_an_excitation_right_after_a_sine_is_one_of_its_own_reference() -> None:
    sine = "{do: sine, q_amplitude: 0.2, period_s: 2, duration_s: 4}"
    program = plan_of(with_parts(LEAD_IN, sine, MULTISINE.replace("q_amplitude: 0.1", "S_amplitude: 0.5"))).program()
    assert [one.signal for one in list_excitations(program)] == ["S"]


def lags(f: Array, lag_s: float, count: int) -> NDArray[np.complex128]:
    return np.asarray(1.0 / (1.0 + 2j * np.pi * f * lag_s) ** count)


@pytest.mark.parametrize(("count", "within"), [(1, 0.001), (2, 0.011), (4, 0.02)])
def test_the_bandwidth_does_not_hang_on_where_the_lines_are(count: int, within: float) -> None:
    """From lines far below the bandwidth to a lowest one at which the gain is 0.6: equal lags, in closed form."""
    lag_s = 0.5
    exact = np.sqrt(2.0 ** (1.0 / count) - 1.0) / (2.0 * np.pi * lag_s)
    highest = np.sqrt(LOW_GAIN_MIN ** (-2.0 / count) - 1.0) / (2.0 * np.pi * lag_s)
    for lowest in np.geomspace(0.02 * exact, 0.999 * highest, 40):
        f = lowest * np.arange(1, 81)
        found, reason = compute_bandwidth(Response("q", f, lags(f, lag_s, count)))
        assert reason == ""
        assert found == pytest.approx(exact, rel=within)
        two_thirds = 0.6 * exact
        phase = -np.degrees(count * np.arctan(2.0 * np.pi * two_thirds * lag_s))
        assert -compute_lag(Response("q", f, lags(f, lag_s, count)), two_thirds) == pytest.approx(phase, rel=0.05)


def test_a_bandwidth_far_below_the_lowest_line_is_not_measured() -> None:
    f = np.array([0.5, 1.0, 1.5])
    found, reason = compute_bandwidth(Response("q", f, lags(f, 0.5, 2)))
    assert found is None
    assert reason.startswith("its gain is 0.29 already at 0.5 Hz, the lowest line")


def test_the_resonance_is_that_over_the_gain_at_rest() -> None:
    f = np.linspace(0.05, 3.0, 400)
    s = 2j * np.pi * f
    peaked = Response("q", f, np.asarray(1.0 / ((s / 6.0) ** 2 + 0.4 * s / 6.0 + 1.0)))
    assert compute_resonance(peaked) == pytest.approx(-20.0 * np.log10(0.4 * np.sqrt(1.0 - 0.2**2)), abs=0.001)
    assert compute_resonance(Response("q", f, lags(f, 0.5, 2))) == 0.0
    # The lowest line lies above the resonance already: it is the largest of all lines, not 0 dB by definition.
    assert compute_resonance(Response("q", f[150:], peaked.H[150:])) == pytest.approx(
        20.0 * np.log10(abs(peaked.H[150]))
    )
