"""Offline estimation of the motor, spring and actuator models: pure, no clock, file or socket."""
