"""Relay of the live stream to Foxglove, in its own read-only process."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
