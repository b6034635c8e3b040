"""What a station may be called: a rig with a service of its own, among several on one database. Pure."""

import re

STATION_MAX = 40
_NAME = re.compile(rf"[A-Za-z0-9][A-Za-z0-9._-]{{0,{STATION_MAX - 1}}}", re.ASCII)


def require_station_name(name: str) -> str:
    """Return a station's name as it is; "" is the only station of a database. Raises ValueError."""
    if name and not _NAME.fullmatch(name):
        raise ValueError(
            f"{name[:60]!r} is no name of a station: 1 to {STATION_MAX} letters, digits, dots, dashes or underscores, "
            "the first a letter or a digit; for example rig-2"
        )
    return name
