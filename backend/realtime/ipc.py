"""IPC protocol: JSON messages in packets between service and loop process."""

import re
from dataclasses import dataclass, field, replace
from typing import Annotated, Any, Literal, Union, get_args

from pydantic import BaseModel, ConfigDict, Field, TypeAdapter, ValidationError, create_model

from backend.realtime import messages
from backend.realtime.channel import MAX_BYTES
from backend.realtime.commands import Command, Event, RunProgram
from backend.realtime.modes import CommandRejectedError
from backend.realtime.program import MAX_SEGMENTS, MAX_TUNINGS, Segment, SetTuning, require_few
from backend.realtime.timing import RealTimeStatus
from plant import NO_COMMISSIONING, CommissioningResults, ErrorCode, PlantChoice, SinewError

# Channel -------------------------------------------------------------------------------------------
# One JSON message per packet of ``channel_pair``, strictly validated.
#
# Both ends reject unknown fields, wrong types, NaN and infinities; a packet arrives whole or not at all.


PART_SEGMENTS = 24
"""Most segments in one packet, 10 kB with all digits of every number; a longer program is sent in parts."""

Entry = str | float | list[float] | list[list[float]]
"""Unit, source or value of an entry of a parameter file; a value may be a polynomial or points."""


@dataclass(frozen=True)
class Setup:
    """First message to the loop process: plant, parameters, tuning.

    ``commissioning_results`` are those of the rig. ``drives_off``: people may be working at the rig, so the drives stay
    off until they are switched on. ``identified``: sections of identified parameters, as in a parameter file, that
    replace those of the file.
    """

    plant: PlantChoice
    parameters: str
    seed: int
    tuning: SetTuning
    commissioning_results: CommissioningResults = NO_COMMISSIONING
    drives_off: bool = False
    identified: dict[str, dict[str, dict[str, Entry]]] = field(default_factory=dict)


@dataclass(frozen=True)
class Ready:
    """First message of the loop process: it runs and drives ``driven``.

    ``granted`` is what the machine granted; ``wired`` the fingerprint of the loaded wiring file, empty without one.
    """

    granted: RealTimeStatus
    driven: str
    wired: str = ""


@dataclass(frozen=True)
class Failed:
    """The loop process cannot work, for this reason, and ends."""

    reason: str


@dataclass(frozen=True)
class ProgramPart:
    """Segments or tunings of a program too long for one packet.

    All its packets have the same sequence number.
    """

    segments: tuple[Segment, ...] = ()
    tunings: tuple[SetTuning, ...] = ()


@dataclass(frozen=True)
class LongProgram:
    """Rest of a program whose segments and tunings were sent before, in order.

    ``segments`` and ``tunings`` are their numbers.
    """

    command: RunProgram
    segments: int
    tunings: int = 0


ToLoop = Setup | Command | ProgramPart | LongProgram
FromLoop = Ready | Failed | Event


class ChannelError(SinewError):
    """A message that cannot be sent or decoded.

    ``sequence`` is its number, 0 if that cannot be decoded either.
    """

    category = ErrorCode.BAD_VALUE

    def __init__(self, reason: str, sequence: int = 0) -> None:
        super().__init__(reason)
        self.sequence = sequence


def _envelope(member: type) -> type[BaseModel]:
    kind: Any = Literal[member.__name__]
    # Plain dataclasses in an envelope inherit its strictness. NaN and infinities are written as constants and rejected:
    # as null they would arrive as None, which some fields accept.
    return create_model(
        member.__name__,
        __config__=ConfigDict(strict=True, extra="forbid", allow_inf_nan=False, ser_json_inf_nan="constants"),
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
    """Encode a message as one packet. Raises ChannelError if it is too long."""
    packet = _ENVELOPES[type(message)].model_construct(sequence=sequence, body=message).model_dump_json().encode()
    if len(packet) > MAX_BYTES:
        raise ChannelError(
            messages.packet_too_long(
                message_type=type(message).__name__, size_bytes=len(packet), maximum_bytes=MAX_BYTES
            ),
            sequence,
        )
    return packet


def packets(command: Command, sequence: int) -> list[bytes]:
    """Encode a command as consecutive packets. Raises OutOfRangeError, ChannelError."""
    if not isinstance(command, RunProgram):
        return [encode(command, sequence)]
    segments, tunings = command.program.segments, command.program.tunings
    if len(segments) <= PART_SEGMENTS and not tunings:
        return [encode(command, sequence)]
    require_few(segments)
    starts = range(0, len(segments), PART_SEGMENTS)
    parts = [ProgramPart(segments[start : start + PART_SEGMENTS]) for start in starts]
    parts += [ProgramPart(tunings=(tuning,)) for tuning in tunings]
    bare = replace(command.program, segments=(), tunings=())
    rest = LongProgram(replace(command, program=bare), len(segments), len(tunings))
    return [*(encode(part, sequence) for part in parts), encode(rest, sequence)]


def decode_to_loop(packet: bytes) -> tuple[int, ToLoop]:
    """Decode a message of the service: (sequence, message). Raises ChannelError."""
    return _decode(_TO_LOOP, packet)


def decode_from_loop(packet: bytes) -> tuple[int, FromLoop]:
    """Decode a message of the loop process: (sequence, message). Raises ChannelError."""
    return _decode(_FROM_LOOP, packet)


def _decode(adapter: TypeAdapter[Any], packet: bytes) -> tuple[int, Any]:
    try:
        envelope = adapter.validate_json(packet)
    except ValidationError as error:
        # Without the sequence number the sender would wait for a reply in vain.
        number = re.search(rb'"sequence":\s*(\d{1,15})\b', packet)
        problems = "; ".join(f"{'.'.join(map(str, detail['loc']))}: {detail['msg']}" for detail in error.errors())
        raise ChannelError(
            messages.packet_not_valid(problems=problems), int(number.group(1)) if number else 0
        ) from None
    return envelope.sequence, envelope.body


# Program parts -------------------------------------------------------------------------------------
# Assembles a program that was sent in parts.


class ProgramParts:
    """Parts of one program.

    Parts of another program whose rest never arrived are discarded.
    """

    def __init__(self) -> None:
        self._sequence = 0
        self._segments: list[Segment] = []
        self._tunings: list[SetTuning] = []

    def add(self, sequence: int, part: ProgramPart) -> None:
        """Add a part of a program; parts beyond the largest program are discarded."""
        if sequence != self._sequence:
            self._sequence, self._segments, self._tunings = sequence, [], []
        if len(self._segments) <= MAX_SEGMENTS:
            self._segments += part.segments
        if len(self._tunings) <= MAX_TUNINGS:
            self._tunings += part.tunings

    def whole(self, sequence: int, rest: LongProgram) -> RunProgram:
        """Return the complete program. Raises CommandRejectedError if a part is missing."""
        self.add(sequence, ProgramPart())
        segments, tunings = tuple(self._segments), tuple(self._tunings)
        self._segments, self._tunings = [], []
        for arrived, expected, parts in (
            (len(segments), rest.segments, "segments"),
            (len(tunings), rest.tunings, "tunings"),
        ):
            if arrived != expected:
                raise CommandRejectedError(
                    messages.program_parts_missing(parts=parts, arrived=arrived, expected=expected)
                )
        return replace(rest.command, program=replace(rest.command.program, segments=segments, tunings=tunings))
