"""Gains, margins and previews from identified models and the tuning parameters λ.

Pure functions, independent of the running loop.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
