"""The control laws: pure functions of gains, state and measurement, compiled once for live and offline use."""
