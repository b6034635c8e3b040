"""The command road: one JSON message per packet over a local socket pair, decoded strictly.

Unknown fields, wrong types, nan and infinities are refused, on both ends; a packet arrives whole or not at all.
"""

import re
import socket
from dataclasses import dataclass
from typing import Annotated, Any, Literal, Union, get_args

from pydantic import BaseModel, ConfigDict, Field, TypeAdapter, ValidationError, create_model

from backend.loop.commands import Command, Event, SetTuning
from backend.loop.pacer import Granted

MAX_BYTES = 180_000
"""Longest packet: what a local socket takes under the kernel's default buffer limits, some 1500 program segments."""


@dataclass(frozen=True)
class Setup:
    """First message to the loop process: the plant to open, with what parameters and tuning."""

    plant: Literal["simulator", "rig"]
    parameters: str
    seed: int
    tuning: SetTuning


@dataclass(frozen=True)
class Ready:
    """First message of the loop process: it ticks now, with what the machine granted."""

    granted: Granted


@dataclass(frozen=True)
class Failed:
    """The loop process cannot work, for this reason, and ends."""

    reason: str


ToLoop = Setup | Command
FromLoop = Ready | Failed | Event


class ChannelError(Exception):
    """A message that cannot be sent or understood; ``sequence`` is its number, 0 when even that is not legible."""

    def __init__(self, reason: str, sequence: int = 0) -> None:
        super().__init__(reason)
        self.sequence = sequence


class ChannelClosedError(Exception):
    """The other end is gone."""


def _envelope(member: type) -> type[BaseModel]:
    kind: Any = Literal[member.__name__]
    # Plain dataclasses inside an envelope take over its strictness.
    return create_model(
        member.__name__,
        __config__=ConfigDict(strict=True, extra="forbid", allow_inf_nan=False),
        kind=(kind, member.__name__),
        sequence=(int, ...),
        body=(member, ...),
    )


_ENVELOPES = {member: _envelope(member) for member in get_args(ToLoop) + get_args(FromLoop)}


def _adapter(union: Any) -> TypeAdapter[Any]:
    envelopes = tuple(_ENVELOPES[member] for member in get_args(union))
    one_of: Any = Union[envelopes]  # noqa: UP007  # the operator needs them spelled out
    return TypeAdapter(Annotated[one_of, Field(discriminator="kind")])


_TO_LOOP = _adapter(ToLoop)
_FROM_LOOP = _adapter(FromLoop)


def encode(message: ToLoop | FromLoop, sequence: int = 0) -> bytes:
    """Write a message as one packet. Raises ChannelError when it is too long for one."""
    packet = _ENVELOPES[type(message)].model_construct(sequence=sequence, body=message).model_dump_json().encode()
    if len(packet) > MAX_BYTES:
        raise ChannelError(
            f"{type(message).__name__} takes {len(packet)} bytes, at most {MAX_BYTES} can be sent: use fewer segments",
            sequence,
        )
    return packet


def decode_to_loop(packet: bytes) -> tuple[int, ToLoop]:
    """Read what the service sent: (sequence, message). Raises ChannelError."""
    return _decode(_TO_LOOP, packet)


def decode_from_loop(packet: bytes) -> tuple[int, FromLoop]:
    """Read what the loop process sent: (sequence, message). Raises ChannelError."""
    return _decode(_FROM_LOOP, packet)


def _decode(adapter: TypeAdapter[Any], packet: bytes) -> tuple[int, Any]:
    try:
        envelope = adapter.validate_json(packet)
    except ValidationError as error:
        # Without its number the sender would wait for an answer in vain.
        number = re.search(rb'"sequence":\s*(\d{1,15})\b', packet)
        problems = (f"{'.'.join(map(str, detail['loc']))}: {detail['msg']}" for detail in error.errors())
        raise ChannelError("; ".join(problems), int(number.group(1)) if number else 0) from None
    return envelope.sequence, envelope.body


class Channel:
    """One end of a SOCK_SEQPACKET pair; neither sending nor receiving ever waits."""

    def __init__(self, end: socket.socket) -> None:
        end.setblocking(False)
        self._socket = end
        self._buffer = bytearray(MAX_BYTES)

    def fileno(self) -> int:
        """File descriptor, to wait on for packets."""
        return self._socket.fileno()

    def send(self, packet: bytes) -> bool:
        """Send one packet; False when the other end does not read and its queue is full. Raises ChannelClosedError."""
        try:
            self._socket.send(packet)
        except BlockingIOError:
            return False
        except (BrokenPipeError, ConnectionResetError) as error:
            raise ChannelClosedError from error
        return True

    def receive(self) -> bytes | None:
        """Take the next packet, None when there is none. Raises ChannelClosedError at the end of all packets."""
        try:
            length = self._socket.recv_into(self._buffer)
        except BlockingIOError:
            return None
        except ConnectionResetError as error:
            raise ChannelClosedError from error
        if length == 0:
            raise ChannelClosedError
        return bytes(memoryview(self._buffer)[:length])

    def close(self) -> None:
        """Close this end; the other one notices."""
        self._socket.close()


def channel_pair() -> tuple[Channel, socket.socket]:
    """Return this side's channel and the socket to hand to the other process."""
    ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    return Channel(ours), theirs
