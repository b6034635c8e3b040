"""Offline estimation of the motor, spring and actuator models: pure, no clock, file or socket."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
