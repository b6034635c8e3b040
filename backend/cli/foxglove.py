"""``sinew foxglove``."""

import asyncio
import os
import secrets
from typing import TYPE_CHECKING, Annotated

import typer

from backend.cli.output import fail
from backend.cli.place import DataFolder, settings_with

if TYPE_CHECKING:
    from backend.foxglove.bridge import Source

PORT = 8765
"""Where Foxglove looks first."""


def foxglove(
    data: DataFolder = None,
    port: Annotated[
        int, typer.Option(min=0, max=65535, help="Port of this machine to listen on, 0 for any free one.")
    ] = PORT,
) -> None:
    """Show the live stream of the running service in Foxglove or Lichtblick, until interrupted."""
    from backend.auth.sessions import load_tokens
    from backend.data_folder import address_of_service

    try:
        from backend.foxglove.bridge import OtherVersionError, Source, relay
    except ModuleNotFoundError as error:
        if error.name != "foxglove":
            raise
        fail("this needs the extra foxglove: pip install 'sinew[foxglove]'")
    from backend.workers import POLITE

    os.setpriority(os.PRIO_PROCESS, 0, POLITE)  # the loop and the page come first
    settings = settings_with(data=data)
    if address_of_service(settings.data) is None:
        fail(f"no service works on the folder {settings.data}: start it with `sinew serve`, or choose --data")
    without_token = secrets.token_urlsafe(24)
    """The key where the service asks for none: a page of anybody may open a connection to a port of this machine."""

    def look() -> "Source | None":
        address = address_of_service(settings.data)
        if address is None:
            return None
        return Source(address, load_tokens(settings.data).viewer if settings.require_token else "")

    def say(words: str) -> None:
        print(words, flush=True)

    try:
        asyncio.run(relay(look, lambda source: source.token or without_token, port, say))
    except OSError as error:
        fail(f"port {port} of this machine cannot be listened on: {error.strerror}; choose another with --port")
    except OtherVersionError as error:
        fail(str(error))
