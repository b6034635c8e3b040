"""Experiments and identifications, for page and command line: documents, library, plans, forecasts and predictions."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
