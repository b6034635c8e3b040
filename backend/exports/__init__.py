"""Samples as files for other programs and installations: written in streams, read back, bundled with their lineage."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
