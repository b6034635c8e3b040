"""Sinew's service, control loop and method."""
