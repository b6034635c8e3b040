"""Excitations against their definitions: spectrum, autocorrelation, frequency over time."""

import numpy as np
import pytest
from scipy.signal import chirp

from backend.control import setpoint_player
from backend.control.motion_types import NO_REFERENCE, output_voltages
from backend.faults import Limit


@pytest.mark.parametrize("bits", setpoint_player.TAPS)
def test_a_register_passes_through_all_its_states_and_repeats(bits: int) -> None:
    seen, register = [], setpoint_player.INITIAL_REGISTER
    for _ in range(2**bits - 1):
        seen.append(register)
        register = setpoint_player.next_register(register, bits)
    assert register == setpoint_player.INITIAL_REGISTER
    assert sorted(seen) == list(range(1, 2**bits))
    levels = np.array([setpoint_player.chip_level(state) for state in seen])
    # what tells a maximum-length sequence: one mean, and one autocorrelation but at no shift
    assert abs(levels.sum()) == 1.0
    shifted = {round(float(levels @ np.roll(levels, shift))) for shift in range(1, levels.size)}
    assert shifted == {-1}


def test_a_chip_is_the_lowest_bit_of_its_register() -> None:
    assert [setpoint_player.chip_level(int(bits, 2)) for bits in ("0001", "0010", "0111", "1110")] == [1, -1, 1, -1]


def test_a_sweep_is_the_logarithmic_chirp() -> None:
    t = np.arange(0.0, 8.0, 0.001)
    ours = np.array([setpoint_player.sweep(float(at), 4.0, 0.2, 8.0) for at in t])
    # scipy's chirp is a cosine; a quarter turn back it is a sine
    theirs = chirp(t, f0=0.25, f1=5.0, t1=8.0, method="logarithmic", phi=-90)
    np.testing.assert_allclose(ours, theirs, atol=1e-9)


def test_a_sweep_between_equal_periods_is_a_sine() -> None:
    assert setpoint_player.sweep(0.3, 1.7, 1.7, 5.0) == setpoint_player.sine(0.3, 1.7)


def test_a_multisine_has_equal_lines_and_no_others() -> None:
    t, lines = np.arange(0.0, 4.0, 0.001), 7
    y = np.array([setpoint_player.multisine(float(at), 4.0, lines, 100.0) for at in t])
    spectrum = 2.0 * np.abs(np.fft.rfft(y)) / t.size
    np.testing.assert_allclose(spectrum[1 : lines + 1], 0.01, rtol=1e-9)
    assert spectrum[0] < 1e-12
    assert spectrum[lines + 1 :].max() < 1e-12
    assert np.abs(y).max() < 0.01 * 2.0 * np.sqrt(lines)  # Schroeder's phases: far below the sum of all, 7


def test_a_multisine_never_exceeds_its_amplitude_for_any_peak() -> None:
    assert setpoint_player.multisine(0.0, 1.0, 5, 0.001) in (-1.0, 1.0)


@pytest.mark.parametrize(
    ("u_A", "u_B", "clipped"),
    [
        (12.0, 1.0, Limit.VOLTAGE_A),
        (-12.0, 11.9, Limit.VOLTAGE_A),
        (1.0, 12.0, Limit.VOLTAGE_B),
        (11.9, -12.0, Limit.VOLTAGE_B),
        (12.0, -12.0, Limit.VOLTAGE_A | Limit.VOLTAGE_B),
        (11.9, -11.9, Limit(0)),
    ],
)
def test_voltages_at_the_limit_are_flagged_by_motor(u_A: float, u_B: float, clipped: Limit) -> None:
    assert Limit(output_voltages(12.0, NO_REFERENCE, u_A, u_B, False).limits) == clipped
