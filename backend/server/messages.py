"""Messages of the web server: rejected hosts, origins and bodies, and why it cannot listen."""

from plant import catalogue_entry

# Security ------------------------------------------------------------------------------------------


@catalogue_entry
def body_too_large(*, maximum_bytes: int) -> str:
    return f"the body is larger than {maximum_bytes} bytes"


@catalogue_entry
def invalid_text_in_body(*, reason: str) -> str:
    return f"body: {reason}"


@catalogue_entry
def body_is_not_json(*, reason: str) -> str:
    return f"body: invalid JSON: {reason}"


@catalogue_entry
def too_many_values(*, maximum_named: int, maximum_listed: int) -> str:
    return (
        f"body: more than {maximum_named} named values, or {maximum_listed} in lists, the maximum of any request: "
        "send fewer values"
    )


@catalogue_entry
def head_too_large(*, maximum_bytes: int, maximum_lines: int) -> str:
    return (
        f"the request headers have more than {maximum_bytes // 1024} kB or {maximum_lines} lines, probably "
        "because other applications under this host name set too many cookies: delete the cookies of "
        "this site, or open it under another host name"
    )


@catalogue_entry
def invalid_text_in_address(*, reason: str) -> str:
    return f"the address: {reason}"


@catalogue_entry
def two_body_lengths() -> str:
    return "send either a Content-Length or a Transfer-Encoding, not both"


@catalogue_entry
def body_length_missing() -> str:
    return "send a Content-Length"


@catalogue_entry
def invalid_body_length() -> str:
    return "the Content-Length must be a whole number"


# Deployment ----------------------------------------------------------------------------------------


@catalogue_entry
def unknown_host(*, host: str, public_url: str | None) -> str:
    known = "" if public_url is None else f" (started with --public-url {public_url}/)"
    return (
        f"this service does not accept the host name {host!r}{known}. If a reverse proxy serves "
        f"it, start it with --public-url and the address that people open; if {host!r} is a name "
        "of this machine, add it to SINEW_ALLOWED_HOSTS"
    )


@catalogue_entry
def page_of_another_address(*, origin: str, host: str, public_url: str) -> str:
    return (
        f"the page is from {origin!r}, but the request names the host {host!r}; this service was started with "
        f"--public-url {public_url}/: open that address, or start the service with another one"
    )


@catalogue_entry
def page_of_another_site(*, origin: str, host: str) -> str:
    return f"the page is from {origin!r}, but the request names the host {host!r}: pages of other sites are refused"


@catalogue_entry
def page_of_unknown_proxy(*, origin: str, host: str, proxy: str) -> str:
    return (
        f"the page is from {origin!r}, but the request names the host {host!r}: pages of other sites are refused. "
        f"If {proxy} is a reverse proxy in front of this service, start it "
        f"with --public-url {proxy}/ (with the path, if there is one), or let the proxy forward the Host header "
        "(nginx: proxy_set_header Host $http_host;)"
    )


@catalogue_entry
def upgrade_missing(*, path: str, origin: str) -> str:
    return (
        f"a WebSocket was requested at {path!r} by a page of {origin!r}, but the header Upgrade is missing: the "
        "reverse proxy does not forward WebSockets. For nginx: proxy_http_version 1.1; "
        'proxy_set_header Upgrade $http_upgrade; proxy_set_header Connection "upgrade";'
    )


@catalogue_entry
def page_not_found(*, path: str) -> str:
    return (
        f"there is no page at {path}. The dashboard is at /. If a reverse proxy serves it below a path, start the "
        "service with --public-url and the whole address, such as https://rig.lab/sinew/"
    )


# Listening -----------------------------------------------------------------------------------------


@catalogue_entry
def cannot_listen(*, host: str, port: int, reason: str) -> str:
    return f"cannot listen on {host} port {port}: {reason}; choose another --host or --port"
