"""Who may do what: sign-in, tokens, sessions, and the control lease.

Knows no HTTP.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
