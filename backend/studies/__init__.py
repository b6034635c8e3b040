"""Many simulated runs of one experiment: which they are, one of them, who computes them, what they come to."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
