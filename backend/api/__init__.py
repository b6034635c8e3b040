"""HTTP and websocket: a route validates, calls one function, returns a schema."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
