"""The thing being controlled: physics, wires and safety module; knows nothing of controllers, web or database."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
