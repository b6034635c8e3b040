"""Offline estimation of motor, spring and actuator models: pure functions.

They use no clock, files or sockets, except for the import of data.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
