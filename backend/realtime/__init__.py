"""The 1 kHz loop process and the service's side of it: the only real-time code of the project."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
