"""Execution of experiments, from request to stored result, on the live control loop or a simulator."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
