"""Physics, drivers, wiring and safety module; imports nothing from the back end."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
