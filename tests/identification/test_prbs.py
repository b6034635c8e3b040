"""The binary sequence that an actuator is identified with."""

import numpy as np
import pytest

from backend.experiments import ActuatorIdentificationPlan


@pytest.mark.parametrize("bits", range(4, 13))
def test_the_sequence_has_nothing_in_common_with_itself_later(bits: int) -> None:
    """What makes it of maximum length: over a period its autocorrelation is -1 at every shift."""
    levels = ActuatorIdentificationPlan(bits=bits, chip_s=0.01).excitation().levels
    sequence = np.array([1.0 if level == "+" else -1.0 for level in levels])
    assert sequence.size == 2**bits - 1
    spectrum = np.abs(np.fft.fft(sequence)) ** 2
    correlation = np.fft.ifft(spectrum).real
    assert correlation[0] == pytest.approx(sequence.size)
    np.testing.assert_allclose(correlation[1:], -1.0, atol=1e-6)
