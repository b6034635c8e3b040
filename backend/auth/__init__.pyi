from .authentication import AUTHENTICATION_PART, BEARER, OPEN, AccessChanged, Authentication, Credentials, User
from .control_lease import (
    CONTROL_HEADER,
    CONTROL_LEASE_PART,
    ControlLease,
    ControlReleased,
    HolderChanged,
    parse_command_token,
)
from .handover import HANDOVER_PART, ControlHandover
from .sessions import TOKEN_FILES, Sessions, TokenFiles, Tokens, load_tokens, replace_tokens

__all__ = [
    "AUTHENTICATION_PART",
    "BEARER",
    "CONTROL_HEADER",
    "CONTROL_LEASE_PART",
    "HANDOVER_PART",
    "OPEN",
    "TOKEN_FILES",
    "AccessChanged",
    "Authentication",
    "ControlHandover",
    "ControlLease",
    "ControlReleased",
    "Credentials",
    "HolderChanged",
    "Sessions",
    "TokenFiles",
    "Tokens",
    "User",
    "load_tokens",
    "parse_command_token",
    "replace_tokens",
]
