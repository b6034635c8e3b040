"""The control laws and the control step: pure functions of gains, state and measurement, compiled once."""
