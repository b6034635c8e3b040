"""From identified models and one parameter λ to gains, margins and previews: pure and offline."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
