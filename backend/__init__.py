"""Sinew's service, control loop and method."""

__version__ = "0.1.0"
