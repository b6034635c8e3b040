"""Controller banks: built from identifications, and the tuning settings that choose among their gains."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
