"""A client of the live streams with timeouts that suffice on a busy machine."""

from functools import partial

from websockets.asyncio import client

from tests.api.conftest import PATIENCE_S

connect = partial(client.connect, max_size=None, open_timeout=PATIENCE_S, ping_interval=None)
