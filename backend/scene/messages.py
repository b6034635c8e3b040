"""Messages about the 3D view: unavailable views and closed connections."""

from plant import catalogue_entry


@catalogue_entry
def no_view() -> str:
    return "there is no 3D view"


@catalogue_entry
def viewer_thread_ended() -> str:
    return "viser's thread has ended"


@catalogue_entry
def text_not_supported() -> str:
    return "text messages are not supported"


@catalogue_entry
def message_too_large(*, size_bytes: int, maximum_bytes: int) -> str:
    return f"a message has {size_bytes} bytes, but at most {maximum_bytes} are accepted"


@catalogue_entry
def too_many_messages(*, maximum_per_s: float) -> str:
    return f"the browser sent more than {maximum_per_s:g} messages per second"


@catalogue_entry
def too_many_viewers(*, maximum: int) -> str:
    return f"{maximum} browsers already have the 3D view open"


@catalogue_entry
def page_of_another_version() -> str:
    return "the page has another version: reload it"


@catalogue_entry
def no_data_accepted(*, timeout_s: float) -> str:
    return f"the browser accepted no data for {timeout_s:g} s"


@catalogue_entry
def view_ended() -> str:
    return "the 3D view has ended"


@catalogue_entry
def view_failed(*, error: str) -> str:
    return f"the 3D view failed: {error}"


@catalogue_entry
def scene() -> str:
    return "A 3D view"


@catalogue_entry
def view_is_frozen() -> str:
    return "The view does not move until it has restarted."


@catalogue_entry
def viewer_opens_port(*, version: str) -> str:
    return f"viser {version} opens its own port: install the version that pyproject.toml states"


@catalogue_entry
def client_without_head() -> str:
    return "viser's client page has no <head>: this version of viser is not known to work"
