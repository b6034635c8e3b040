"""Pseudo-random binary sequences of maximum length."""

import numpy as np
import pytest

from backend.identification.excitation import chips
from backend.identification.records import RecordError


@pytest.mark.parametrize("bits", range(3, 17))
def test_a_sequence_has_nothing_in_common_with_itself_later(bits: int) -> None:
    """What makes it of maximum length: over a period its autocorrelation is -1 at every shift."""
    sequence = chips(bits)
    assert sequence.size == 2**bits - 1
    assert set(sequence.tolist()) == {-1.0, 1.0}
    spectrum = np.abs(np.fft.fft(sequence)) ** 2
    correlation = np.fft.ifft(spectrum).real
    assert correlation[0] == pytest.approx(sequence.size)
    np.testing.assert_allclose(correlation[1:], -1.0, atol=1e-6)


@pytest.mark.parametrize("bits", [2, 17])
def test_a_register_outside_the_bounds_is_refused_with_them(bits: int) -> None:
    with pytest.raises(RecordError) as refusal:
        chips(bits)
    assert str(refusal.value) == (
        f"length of the shift register is {bits} bits, must be at least 3 and at most 16 bits: choose within these"
    )
