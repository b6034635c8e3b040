"""The control laws and the control step: pure functions of gains, state and measurement, compiled once."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
