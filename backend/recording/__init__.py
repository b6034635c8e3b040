"""Storage of samples from the ring buffer in one-second chunks, and their reading."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
