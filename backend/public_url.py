"""The address of the service behind a reverse proxy, and the trusted proxies."""

import ipaddress
import re
from collections.abc import Iterable
from dataclasses import dataclass, field
from urllib.parse import urlsplit

Network = ipaddress.IPv4Network | ipaddress.IPv6Network

LOOPBACK: tuple[Network, ...] = (ipaddress.ip_network("127.0.0.0/8"), ipaddress.ip_network("::1/128"))
"""Networks of the proxies that are trusted by default: those of this machine."""

_PORTS = {"http": 80, "https": 443}
_HOST = re.compile(r"[a-z0-9]([a-z0-9._-]{0,251}[a-z0-9])?|\[[0-9a-f:.]+\]")
_PREFIX = re.compile(r"(/[A-Za-z0-9._~-]{1,64}){0,8}/?")
_FORM = "give scheme, host and path, such as https://rig.lab/sinew/"


@dataclass(frozen=True)
class PublicUrl:
    """Address of the service as browsers see it.

    ``host`` is in lower case (an IPv6 address in brackets); ``prefix`` is the path without its last slash.
    """

    scheme: str
    host: str
    port: int
    prefix: str = ""
    proxies: tuple[Network, ...] = field(default=LOOPBACK)

    @property
    def netloc(self) -> str:
        """Host header of a browser: host, and port unless it is the scheme's default."""
        return self.host if self.port == _PORTS[self.scheme] else f"{self.host}:{self.port}"

    @property
    def origin(self) -> str:
        """Origin header of a browser."""
        return f"{self.scheme}://{self.netloc}"

    @property
    def is_secure(self) -> bool:
        """Whether browsers reach it over https."""
        return self.scheme == "https"

    def is_trusted_proxy(self, address: str) -> bool:
        """Return whether an IP address belongs to a trusted proxy."""
        try:
            found = ipaddress.ip_address(address)
        except ValueError:
            return False
        if isinstance(found, ipaddress.IPv6Address) and found.ipv4_mapped is not None:
            found = found.ipv4_mapped
        return any(found in network for network in self.proxies)

    def __str__(self) -> str:
        return f"{self.origin}{self.prefix}"


def parse_public_url(text: str) -> PublicUrl:
    """Parse the address of the service behind a proxy.

    Raises ValueError with the mistake and the expected form.
    """
    try:
        parts = urlsplit(text.strip())
        port = parts.port
    except ValueError as error:
        raise ValueError(f"{text!r} is not an address: {error}; {_FORM}") from None
    if parts.scheme not in _PORTS:
        raise ValueError(f"{text!r} does not begin with http:// or https://: {_FORM}")
    if "@" in parts.netloc or parts.query or parts.fragment or "?" in text or "#" in text:
        raise ValueError(f"{text!r} has more than scheme, host, port and path: {_FORM}")
    host = parts.netloc.lower().removesuffix(f":{port}") if port is not None else parts.netloc.lower().rstrip(":")
    if not _HOST.fullmatch(host) or port == 0:
        raise ValueError(f"{text!r} has no valid host: {_FORM}")
    if not _PREFIX.fullmatch(parts.path) or any(part in (".", "..") for part in parts.path.split("/")):
        raise ValueError(f"{text!r}: the path may contain only letters, digits and . _ ~ - between slashes: {_FORM}")
    return PublicUrl(parts.scheme, host, _PORTS[parts.scheme] if port is None else port, parts.path.rstrip("/"))


def parse_networks(names: Iterable[str]) -> tuple[Network, ...]:
    """Parse addresses and networks such as 10.0.0.5 or 10.0.0.0/24.

    Raises ValueError.
    """
    found: list[Network] = []
    for name in names:
        try:
            found.append(ipaddress.ip_network(name))
        except ValueError as error:
            raise ValueError(
                f"{name!r} is not an IP address or network ({error}): give 10.0.0.5 or 10.0.0.0/24"
            ) from None
    return tuple(found)
