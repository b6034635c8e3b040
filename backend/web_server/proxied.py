"""What a reverse proxy changes in a request: the path prefix, who asks, the path of the cookie."""

import ipaddress
from urllib.parse import urlsplit

from starlette.datastructures import Headers
from starlette.types import Scope

from backend.public_url import PublicUrl

FORWARDING = (
    "forwarded",
    "via",
    "x-forwarded-for",
    "x-forwarded-host",
    "x-forwarded-port",
    "x-forwarded-proto",
    "x-forwarded-prefix",
    "x-real-ip",
)
"""Headers that a reverse proxy adds."""

PUBLIC = "sinew.public"
"""Key of a request's scope: the public URL that the service was started with, None without one."""

COOKIE_PATH = "sinew.cookie_path"
"""Key of a request's scope: the path that its session cookie is for."""

PEER = "sinew.peer"
"""Key of a request's scope: the address that the connection comes from, a proxy's where there is one."""


def take_in(scope: Scope, public: PublicUrl | None) -> None:
    """Make of a request that came through a proxy what it would be without: ``scope`` is changed in place.

    The prefix of the public URL is taken off the path, where the proxy has left it there, and the client is whom a
    trusted proxy names. Nothing else of what a proxy adds counts, and nothing of what others send under these names.
    """
    headers = Headers(scope=scope)
    peer = str(scope["client"][0]) if scope.get("client") else ""
    scope[PUBLIC], scope[PEER], scope[COOKIE_PATH] = public, peer, "/"
    if public is None:
        return
    is_prefixed = _take_prefix(scope, public.prefix)
    is_trusted = public.trusts(peer)
    if is_trusted and (asking := _named(headers.getlist("x-forwarded-for"), public)):
        scope["client"] = (asking, 0)
    is_forwarded = is_trusted and any(name in headers for name in FORWARDING)
    if is_prefixed or is_forwarded or _is_host_of(headers.get("host", ""), public):
        scope[COOKIE_PATH] = f"{public.prefix}/"


def name_of(host: str) -> str:
    """Return the name in a Host header, without brackets and port; "" for what is none."""
    try:
        return urlsplit(f"//{host}").hostname or ""
    except ValueError:
        return ""


def _is_host_of(host: str, public: PublicUrl) -> bool:
    """Return whether a Host header is that of the public URL, with its port or without any."""
    return host.lower() in (public.netloc, public.host, f"{public.host}:{public.port}")


def _take_prefix(scope: Scope, prefix: str) -> bool:
    """Take the prefix off the path; return whether it was there."""
    path: str = scope["path"]
    if not prefix or not path.startswith(f"{prefix}/"):
        return False
    scope["path"] = path[len(prefix) :]
    raw: bytes | None = scope.get("raw_path")
    if raw is not None and raw.startswith(f"{prefix}/".encode()):
        scope["raw_path"] = raw[len(prefix) :]
    return True


def _named(forwarded: list[str], public: PublicUrl) -> str | None:
    """Return who asked the first proxy that is trusted: those after it have put one address each behind the other."""
    found = None
    for name in reversed([part.strip() for line in forwarded for part in line.split(",")]):
        try:
            found = str(ipaddress.ip_address(name.strip("[]")))
        except ValueError:
            return found
        if not public.trusts(found):
            return found
    return found
