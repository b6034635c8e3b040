"""Messages of the Foxglove bridge: rejected or closed clients, and a service of another version."""

from plant import catalogue_entry


@catalogue_entry
def token_replaced() -> str:
    return "the token was replaced: use the new address"


@catalogue_entry
def token_missing() -> str:
    return "the address needs ?token= with the viewer's token, as sinew foxglove prints it"


@catalogue_entry
def too_many_clients(*, maximum: int) -> str:
    return f"{maximum} clients are already connected"


@catalogue_entry
def vendor_server_ended() -> str:
    return "the vendor's server has ended: start sinew foxglove again"


@catalogue_entry
def request_is_not_json() -> str:
    return "the request is not JSON"


@catalogue_entry
def service_of_another_version() -> str:
    return "the service streams signals that this version does not support: use the same version of both"
