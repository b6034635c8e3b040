"""Files with samples: streamed exports, imports, and bundles with their lineage."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
