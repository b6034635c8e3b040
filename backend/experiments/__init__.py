"""Experiments and identifications, the same for browser and command line: plans, forecasts, playing, results, banks."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
