"""Pseudo-random binary sequences of maximum length, held for a chip at a time."""

import numpy as np

from backend.identification.errors import RecordError
from backend.identification.record import Signal

MIN_BITS, MAX_BITS = 3, 16


def chips(bits: int) -> Signal:
    """One period of the sequence of a register of that length, +1 and -1, shape (2^bits - 1,). Raises RecordError."""
    from scipy.signal import max_len_seq

    if not MIN_BITS <= bits <= MAX_BITS:
        raise RecordError("length of the shift register", bits, MIN_BITS, MAX_BITS, "bits", "choose within these")
    return np.asarray(2.0 * max_len_seq(bits)[0] - 1.0)
