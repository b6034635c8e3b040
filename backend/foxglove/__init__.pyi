from .bridge import LiveSource, OtherVersionError, serve_foxglove

__all__ = [
    "LiveSource",
    "OtherVersionError",
    "serve_foxglove",
]
