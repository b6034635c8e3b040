"""A client of the Foxglove WebSocket protocol, read off its specification: JSON both ways, samples in binary frames."""

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


class Watching:
    """Is connected, and subscribes to all that is advertised until ``topics`` are."""

    def __init__(self, socket: Connection, topics: int) -> None:
        self.socket = socket
        self.info = self._said()
        self.channels: dict[str, dict[str, Any]] = {}
        while len(self.channels) < topics:
            for channel in self._said().get("channels", ()):
                self.channels[channel["topic"]] = channel
        self._topics = dict(enumerate(self.channels))
        asked = [{"id": number, "channelId": self.channels[topic]["id"]} for number, topic in self._topics.items()]
        socket.send(json.dumps({"op": "subscribe", "subscriptions": asked}))

    def _said(self) -> dict[str, Any]:
        return dict(json.loads(self.socket.recv(PATIENCE_S)))

    def heard(self) -> Iterator[Message | dict[str, Any]]:
        """Yield what comes, for ever."""
        while True:
            said = self.socket.recv(PATIENCE_S)
            if isinstance(said, str):
                yield json.loads(said)
                continue
            kind, subscription, time_ns = struct.unpack_from("<BIQ", said)
            assert kind == 1
            yield Message(self._topics[subscription], time_ns, said[13:])

    def messages(self, topic: str) -> Iterator[Message]:
        return (said for said in self.heard() if isinstance(said, Message) and said.topic == topic)


@contextmanager
def watching(address: str, protocol: str = "foxglove.sdk.v1", topics: int = 2) -> Iterator[Watching]:
    with connect(
        address,
        subprotocols=[protocol],  # type: ignore[list-item]  # a plain word
        max_size=None,
        compression=None,
        open_timeout=PATIENCE_S,
        ping_interval=None,  # the command gives way to all else: an answer may take its time
        close_timeout=0.1,
    ) as socket:
        assert socket.subprotocol == protocol
        yield Watching(socket, topics)
