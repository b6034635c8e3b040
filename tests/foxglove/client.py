"""A client of the Foxglove WebSocket protocol: JSON and binary frames."""

import json
import struct
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any, NamedTuple

from websockets.sync.client import connect
from websockets.sync.connection import Connection

PATIENCE_S = 180.0


class Message(NamedTuple):
    topic: str
    time_ns: int
    content: bytes


class Subscriber:
    """Subscribes to every advertised channel once ``topics`` channels are advertised."""

    def __init__(self, socket: Connection, topics: int) -> None:
        self.socket = socket
        self.info = self._receive()
        self.channels: dict[str, dict[str, Any]] = {}
        while len(self.channels) < topics:
            for channel in self._receive().get("channels", ()):
                self.channels[channel["topic"]] = channel
        self._topics = dict(enumerate(self.channels))
        subscriptions = [
            {"id": number, "channelId": self.channels[topic]["id"]} for number, topic in self._topics.items()
        ]
        socket.send(json.dumps({"op": "subscribe", "subscriptions": subscriptions}))

    def _receive(self) -> dict[str, Any]:
        return dict(json.loads(self.socket.recv(PATIENCE_S)))

    def receive_all(self) -> Iterator[Message | dict[str, Any]]:
        """Yield every message, without end."""
        while True:
            received = self.socket.recv(PATIENCE_S)
            if isinstance(received, str):
                yield json.loads(received)
                continue
            kind, subscription, time_ns = struct.unpack_from("<BIQ", received)
            assert kind == 1
            yield Message(self._topics[subscription], time_ns, received[13:])

    def messages(self, topic: str) -> Iterator[Message]:
        return (
            received for received in self.receive_all() if isinstance(received, Message) and received.topic == topic
        )


@contextmanager
def subscribe(address: str, protocol: str = "foxglove.sdk.v1", topics: int = 2) -> Iterator[Subscriber]:
    with connect(
        address,
        subprotocols=[protocol],  # type: ignore[list-item]  # a plain string
        max_size=None,
        compression=None,
        open_timeout=PATIENCE_S,
        ping_interval=None,  # the command has a low priority, so its pong may be late
        close_timeout=0.1,
    ) as socket:
        assert socket.subprotocol == protocol
        yield Subscriber(socket, topics)
