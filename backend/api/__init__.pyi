from .app import create_app
from .dependencies import Service, require_signed_in

__all__ = ["Service", "create_app", "require_signed_in"]
