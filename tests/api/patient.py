"""A client of the live streams that waits as long as these tests do: on a busy machine an answer takes its time."""

from functools import partial

from websockets.asyncio import client

from tests.api.conftest import PATIENCE_S

connect = partial(client.connect, max_size=None, open_timeout=PATIENCE_S, ping_interval=None)
