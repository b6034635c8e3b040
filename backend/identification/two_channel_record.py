"""Record of one run that excites two inputs at once, and checks of it."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from backend.identification import messages
from backend.identification.records import MIN_SAMPLES, RecordError, Signal, check_moves, check_period, read_signal
from backend.identification.two_channel_excitation import InputCorrelation, correlate_inputs

MEMORY_S = 2.5
"""Time [s] after which a response has decayed: five times the sum of lags of a loop of 0.5 s."""
MAX_CORRELATION = 0.9
"""Correlation of the inputs beyond which the variance of a parameter grows at least fivefold, 1 / (1 - r²)."""


@dataclass(frozen=True)
class TwoChannelRecord:
    """A record of two inputs and two outputs; RecordError if it is unsuitable.

    ``u`` and ``y``, shape (n, 2), are deviations from the operating point in any units: sample k of ``y`` is taken at
    the time at which sample k of ``u`` is applied, and ``u`` is held until sample k + 1. ``r``, shape (n, 2), are
    signals of a closed loop that are free of measurement noise, setpoints or excitation; without them ``u`` must be.
    ``memory_s`` [s] is a bound of the time after which a response has decayed: up to this lag the inputs must not
    repeat each other, and the record must be at least twice as long.
    """

    period_s: float
    u: Signal
    y: Signal
    r: Signal | None = None
    inputs: tuple[str, str] = ("q_c", "S_c")
    outputs: tuple[str, str] = ("q", "S")
    memory_s: float = MEMORY_S

    def __post_init__(self) -> None:
        check_period(self.period_s)
        externals = f"r of {self.inputs[0]}", f"r of {self.inputs[1]}"
        names = {"u": self.inputs, "y": self.outputs, "r": externals}
        for field, columns in names.items():
            values = getattr(self, field)
            if values is not None:
                object.__setattr__(self, field, _read_columns(field, columns, values))
        for field in ("y", "r"):
            values = getattr(self, field)
            if values is not None and values.shape[0] != self.size:
                raise RecordError(
                    messages.columns_of_unequal_length(name=field, length=values.shape[0], expected=self.size)
                )
        minimum = max(MIN_SAMPLES, round(2.0 * self.memory_s / self.period_s))
        if self.size < minimum:
            raise RecordError(messages.record_too_short(length=self.size, minimum=minimum))
        for field in ("u", "y"):
            for name, column in zip(names[field], getattr(self, field).T, strict=True):
                check_moves(name, column)
        found = self.input_correlation()
        if abs(found.largest) > MAX_CORRELATION:
            raise RecordError(
                messages.inputs_correlated(
                    first=self.inputs[0],
                    second=self.inputs[1],
                    correlation=found.largest,
                    lag_s=found.largest_lag_s,
                    maximum=MAX_CORRELATION,
                )
            )

    @property
    def size(self) -> int:
        """Number of samples n."""
        return int(self.u.shape[0])

    def input_correlation(self) -> InputCorrelation:
        """Return the correlation of both inputs over the memory."""
        return correlate_inputs(self.u, self.period_s, self.memory_s)


def _read_columns(field: str, names: tuple[str, str], values: ArrayLike) -> Signal:
    array = np.asarray(values, dtype=np.float64)
    if array.ndim != 2 or array.shape[1] != 2:
        raise RecordError(messages.signal_is_not_two_columns(name=field, shape=array.shape))
    columns = [read_signal(name, column) for name, column in zip(names, array.T, strict=True)]
    result = np.column_stack(columns)
    result.setflags(write=False)
    return result
