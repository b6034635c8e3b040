"""Deployment: effects of a reverse proxy, problems between browser and service."""

import ipaddress
from collections.abc import Iterable
from urllib.parse import urlsplit

from starlette.datastructures import Headers
from starlette.types import Scope

from backend.public_url import PublicUrl, parse_public_url
from backend.schemas import ErrorDetail
from backend.server import messages
from plant import Message

# Reverse proxy -------------------------------------------------------------------------------------
# Effects of a reverse proxy on a request: path prefix, client address, cookie path.


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
"""Key of a request's scope: the public URL of the service, None without one."""

COOKIE_PATH = "sinew.cookie_path"
"""Key of a request's scope: the path of its session cookie."""

PEER = "sinew.peer"
"""Key of a request's scope: the address of the connection, which may be a proxy's."""


def apply_forwarded_headers(scope: Scope, public: PublicUrl | None) -> None:
    """Undo the effects of a proxy on a request; ``scope`` is changed in place.

    The prefix of the public URL is removed from the path if the proxy left it there, and the client is the one that a
    trusted proxy names. Other headers of proxies are ignored, as are these from untrusted clients.
    """
    headers = Headers(scope=scope)
    peer = str(scope["client"][0]) if scope.get("client") else ""
    scope[PUBLIC], scope[PEER], scope[COOKIE_PATH] = public, peer, "/"
    if public is None:
        return
    is_prefixed = _take_prefix(scope, public.prefix)
    is_trusted = public.is_trusted_proxy(peer)
    if is_trusted and (asking := _find_client(headers.getlist("x-forwarded-for"), public)):
        scope["client"] = (asking, 0)
    is_forwarded = is_trusted and any(name in headers for name in FORWARDING)
    if is_prefixed or is_forwarded or _is_public_host(headers.get("host", ""), public):
        scope[COOKIE_PATH] = f"{public.prefix}/"


def parse_host_name(host: str) -> str:
    """Return the name in a Host header, without brackets and port; "" if invalid."""
    try:
        return urlsplit(f"//{host}").hostname or ""
    except ValueError:
        return ""


def _is_public_host(host: str, public: PublicUrl) -> bool:
    """Return whether a Host header is that of the public URL, with or without port."""
    return host.lower() in (public.netloc, public.host, f"{public.host}:{public.port}")


def _take_prefix(scope: Scope, prefix: str) -> bool:
    """Remove the prefix from the path; return whether it was there."""
    path: str = scope["path"]
    if not prefix or not path.startswith(f"{prefix}/"):
        return False
    scope["path"] = path[len(prefix) :]
    raw: bytes | None = scope.get("raw_path")
    if raw is not None and raw.startswith(f"{prefix}/".encode()):
        scope["raw_path"] = raw[len(prefix) :]
    return True


def _find_client(forwarded: list[str], public: PublicUrl) -> str | None:
    """Return the last address that is no trusted proxy; each proxy appends its client."""
    found = None
    for name in reversed([part.strip() for line in forwarded for part in line.split(",")]):
        try:
            found = str(ipaddress.ip_address(name.strip("[]")))
        except ValueError:
            return found
        if not public.is_trusted_proxy(found):
            return found
    return found


# Deployment ----------------------------------------------------------------------------------------
# Problems between a browser and the service, and their remedies, as messages for log and page.


_SHOWN = 200


def unknown_host(host: str, public: PublicUrl | None) -> Message:
    """Return the message for a rejected Host header."""
    return messages.unknown_host(host=_cut(host), public_url=None if public is None else str(public))


def foreign_origin(origin: str, host: str, public: PublicUrl | None) -> Message:
    """Return the message for a rejected command or websocket of a page."""
    shown_origin, shown_host = _cut(origin), _cut(host)
    if public is not None:
        return messages.page_of_another_address(origin=shown_origin, host=shown_host, public_url=str(public))
    try:
        proxy = str(parse_public_url(origin))
    except ValueError:
        return messages.page_of_another_site(origin=shown_origin, host=shown_host)
    return messages.page_of_unknown_proxy(origin=shown_origin, host=shown_host, proxy=proxy)


def upgrade_lost(path: str, origin: str | None) -> Message:
    """Return the message for a websocket handshake that arrived as a plain request."""
    return messages.upgrade_missing(path=_cut(path), origin=_cut(origin or "no origin"))


def missing_page_message(path: str) -> Message:
    """Return the message for an address without a page."""
    return messages.page_not_found(path=_cut(path))


def find_deployment_problems(page: str, public: PublicUrl | None, headers: Headers, peer: str) -> list[ErrorDetail]:
    """Return the problems of how a page at the address ``page`` reaches the service.

    ``peer`` is the address of the connection. A page that must not send commands at all is rejected before, by its
    origin.
    """
    try:
        parts = urlsplit(page)
        opened = parse_public_url(f"{parts.scheme}://{parts.netloc}{parts.path.rpartition('/')[0]}/")
    except ValueError:
        return []
    return [ErrorDetail(code=code, message=message) for code, message in _findings(opened, public, headers, peer)]


def _findings(opened: PublicUrl, public: PublicUrl | None, headers: Headers, peer: str) -> Iterable[tuple[str, str]]:
    if public is None:
        if opened.is_secure or opened.prefix:
            exposed = "over http too" if opened.is_secure else f"to all applications of {opened.host}"
            yield (
                "no_public_url",
                f"This page is opened at {opened}/, through a reverse proxy, and the service was started without "
                f"--public-url: browsers would send the session cookie {exposed}. Start the service with "
                f"--public-url {opened}/.",
            )
        return
    if opened.origin == public.origin and opened.prefix != public.prefix:
        yield (
            "other_prefix",
            f"This page is opened at {opened}/, and the service was started with --public-url {public}/: the session "
            f"cookie is valid only for that path. Open {public}/, or start the service with --public-url {opened}/.",
        )
    if not public.is_trusted_proxy(peer) and any(name in headers for name in FORWARDING):
        yield (
            "untrusted_proxy",
            f"The reverse proxy at {peer} is not trusted: its forwarding headers are ignored, and all "
            f"its clients count as one address. If it is yours, start the service with --trusted-proxy {peer}.",
        )


def _cut(text: str) -> str:
    return text if len(text) <= _SHOWN else f"{text[:_SHOWN]}..."
