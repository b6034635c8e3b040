"""The live stream as a Foxglove WebSocket server, for who asks for it: a process of its own that only listens."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
