from .authentication import AUTHENTICATION_PART, BEARER, OPEN, AccessChanged, Authentication, Shown, User
from .control_lease import CONTROL_LEASE_PART, HEADER, ControlLease, ControlReleased, HolderChanged, read_stamp
from .handover import HANDOVER_PART, ControlHandover
from .sessions import FILES, Sessions, TokenFiles, Tokens, load_tokens, replace_tokens

__all__ = [
    "AUTHENTICATION_PART",
    "BEARER",
    "CONTROL_LEASE_PART",
    "FILES",
    "HANDOVER_PART",
    "HEADER",
    "OPEN",
    "AccessChanged",
    "Authentication",
    "ControlHandover",
    "ControlLease",
    "ControlReleased",
    "HolderChanged",
    "Sessions",
    "Shown",
    "TokenFiles",
    "Tokens",
    "User",
    "load_tokens",
    "read_stamp",
    "replace_tokens",
]
