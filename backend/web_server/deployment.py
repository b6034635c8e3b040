"""What is wrong with the way from a browser to the service, and how to set it right. Sentences for log and page."""

from collections.abc import Iterable
from urllib.parse import urlsplit

from starlette.datastructures import Headers

from backend.messages.base import Problem
from backend.public_url import PublicUrl, read_public_url
from backend.web_server.proxied import FORWARDING

NGINX_UPGRADE = 'proxy_http_version 1.1; proxy_set_header Upgrade $http_upgrade; proxy_set_header Connection "upgrade";'
"""What nginx needs for websockets."""

_SHOWN = 200


def unknown_host(host: str, public: PublicUrl | None) -> str:
    """Say why a Host header is refused."""
    known = "" if public is None else f" (started with --public-url {public}/)"
    return (
        f"this service is not known as {_cut(host)!r}{known}. If people reach it through a reverse proxy, start it "
        f"with --public-url and the address that they open; if {_cut(host)!r} is a name of this machine, put it into "
        "SINEW_ALLOWED_HOSTS"
    )


def foreign_origin(origin: str, host: str, public: PublicUrl | None) -> str:
    """Say why a page's command or websocket is refused."""
    said = f"the page comes from {_cut(origin)!r}, and the request asks for the host {_cut(host)!r}"
    if public is not None:
        return (
            f"{said}; this service was started with --public-url {public}/: open that address, or start it with another"
        )
    try:
        proxy = str(read_public_url(origin))
    except ValueError:
        return f"{said}: pages of other sites are refused"
    return (
        f"{said}: pages of other sites are refused. If {proxy} is a reverse proxy in front of this service, start it "
        f"with --public-url {proxy}/ (with the path, where there is one), or let the proxy pass the Host header on "
        "(nginx: proxy_set_header Host $http_host;)"
    )


def upgrade_lost(path: str, origin: str | None) -> str:
    """Say why a websocket's handshake that has become a plain request is refused."""
    return (
        f"a websocket was asked for at {_cut(path)!r} by a page of {_cut(origin or 'no origin')!r}, and the header "
        f"Upgrade was lost on the way: the reverse proxy does not pass websockets on. For nginx: {NGINX_UPGRADE}"
    )


def no_such_page(path: str) -> str:
    """Say what an address without a page may come from."""
    return (
        f"There is no page at {_cut(path)}. The dashboard is at /. If a reverse proxy serves it below a path, start "
        "the service with --public-url and the whole address, such as https://rig.lab/sinew/."
    )


def findings(page: str, public: PublicUrl | None, headers: Headers, peer: str) -> list[Problem]:
    """Return what is wrong with how a page at the address ``page`` has reached the service.

    ``peer`` is the address of the connection. A page that may not command at all is refused before, by its origin.
    """
    try:
        parts = urlsplit(page)
        opened = read_public_url(f"{parts.scheme}://{parts.netloc}{parts.path.rpartition('/')[0]}/")
    except ValueError:
        return []
    return [Problem(code=code, message=message) for code, message in _findings(opened, public, headers, peer)]


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
            f"cookie is for that path only. Open {public}/, or start the service with --public-url {opened}/.",
        )
    if not public.trusts(peer) and any(name in headers for name in FORWARDING):
        yield (
            "untrusted_proxy",
            f"The reverse proxy at {peer} is not trusted: what it says of who asks is not believed, and all people "
            f"behind it count as one address. If it is yours, start the service with --trusted-proxy {peer} too.",
        )


def _cut(text: str) -> str:
    return text if len(text) <= _SHOWN else f"{text[:_SHOWN]}..."
