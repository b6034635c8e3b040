"""Metrics of runs, and the evaluation that stores them; all but the evaluation is pure."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
