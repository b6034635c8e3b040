"""Use cases of the service: the actuator and its state, jobs, stored runs, upkeep. Knows no HTTP."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
