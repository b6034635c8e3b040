"""Samples and events of the live stream as Foxglove's channels ``/sample`` and ``/log``, on the vendor's server.

``/sample`` has every sample as an MCAP export has it, ``t`` since the loop started; the time of a message is that of
its sample, by the clock of this machine.
"""

import json
import logging
import time
from collections.abc import Callable
from typing import Any

import foxglove
import numpy as np
from foxglove import messages
from foxglove.websocket import StatusLevel

from backend import wire
from backend.exports import writers
from backend.exports.base import ORDER, described
from backend.exports.mcap import TOPIC
from backend.foxglove.tickets import Tickets
from backend.messages.live import EventMessage, LayoutMessage, MarkKind, StateMessage
from backend.sample import STORED_NAMES
from plant.interface import T_s

LOG_TOPIC = "/log"
NOTATION = (
    "SI units, angles in rad. t counts from the start of the loop. _ref: a reference, _gov: after governor or plan, "
    "_dot: a derivative, A and B: the two motors with their tendons, lam: lambda. "
    "Equations: docs/notation.md."
)
BACKLOG = 4096
"""Messages that wait for a client before the oldest is dropped: four seconds."""

_PERIOD_NS = round(T_s * 1e9)
_ASTRAY_NS = 50_000_000
"""The clock of this machine was set, or the loop stood still: times are counted anew."""

_AWAY = "service"
_LEVELS = {MarkKind.FAULT: messages.LogLevel.Error, MarkKind.TRIP: messages.LogLevel.Error}


class OtherVersionError(Exception):
    """The service streams other signals than this version knows."""


class Publisher:
    """Publishes what it hears of the live stream. ``clock_ns`` is the time of day; ``tickets`` keep the messages."""

    def __init__(self, name: str, tickets: Tickets, clock_ns: Callable[[], int] = time.time_ns) -> None:
        logging.getLogger("foxglove").setLevel(logging.ERROR)
        self._tickets, self._clock_ns = tickets, clock_ns
        context = self._context = foxglove.Context()  # which knows its channels only while somebody holds it
        self._samples = foxglove.Channel(
            TOPIC,
            schema=foxglove.Schema(
                name=writers.NAME, encoding="jsonschema", data=writers.json_schema(described(ORDER), NOTATION)
            ),
            message_encoding="json",
            context=context,
        )
        self._log = foxglove.Channel(
            LOG_TOPIC, schema=messages.Log.get_schema(), message_encoding="protobuf", context=context
        )
        # No capability: nothing can be sent to the actuator this way.
        self._server = foxglove.start_server(
            name=name, host="127.0.0.1", port=0, context=context, message_backlog_size=BACKLOG
        )
        self.port = self._server.port
        self._began_ns: int | None = None
        self._heard_from = 0
        self._problems: set[str] = set()

    def hear(self, message: str | bytes) -> None:
        """Publish a message of ``/api/live``. Raises OtherVersionError."""
        if isinstance(message, bytes):
            self._publish_samples(message)
            return
        said: dict[str, Any] = json.loads(message)
        match said.get("type"):
            case "layout":
                self._begin(LayoutMessage.model_validate(said))
            case "state":
                self._note(StateMessage.model_validate(said))
            case "event":
                mark = EventMessage.model_validate(said)
                self._tell(mark.text, _LEVELS.get(mark.kind, messages.LogLevel.Info), mark.kind, mark.tick)
            case _:  # an answer to a ping: none is sent
                pass

    def say_away(self, why: str) -> None:
        """Show that nothing is heard of the service."""
        self._server.publish_status(why, StatusLevel.Error, _AWAY)

    def close(self) -> None:
        """End the server, and the connections to it."""
        self._server.stop()

    def _begin(self, layout: LayoutMessage) -> None:
        names = tuple(field.name for field in layout.fields)
        if names != STORED_NAMES or layout.period_s != T_s:
            raise OtherVersionError(
                "the service streams other signals than this version knows: use one version of both"
            )
        self._server.remove_status([_AWAY])
        self._began_ns = None

    def _note(self, state: StateMessage) -> None:
        began_ns = self._clock_ns() - state.tick * _PERIOD_NS
        if self._began_ns is None:
            self._heard_from = state.tick  # what comes of before is for a page that has just been opened
        if self._began_ns is None or abs(began_ns - self._began_ns) > _ASTRAY_NS:
            self._began_ns = began_ns
        now = set(state.problems)
        for problem in state.problems:
            if problem not in self._problems:
                self._tell(problem, messages.LogLevel.Warning, "problem", state.tick)
        self._problems = now

    def _publish_samples(self, packed: bytes) -> None:
        frame = wire.unpack(packed)
        if self._began_ns is None or frame.first_tick < self._heard_from or not self._samples.has_sinks():
            return
        if frame.missed:
            words = f"{frame.missed} samples before this one are missing here; the recording has them"
            self._tell(words, messages.LogLevel.Warning, "stream", frame.first_tick)
        ticks = np.arange(frame.first_tick, frame.first_tick + frame.columns.shape[1])
        batch = {"t": ticks * T_s, **dict(zip(STORED_NAMES, frame.columns, strict=True))}
        for tick, line in zip(ticks.tolist(), writers.lines(ORDER, batch), strict=True):
            self._samples.log(self._tickets.ticket_for(line), log_time=self._began_ns + tick * _PERIOD_NS)

    def _tell(self, words: str, level: messages.LogLevel, name: str, tick: int) -> None:
        if self._began_ns is None or not self._log.has_sinks():
            return
        at_ns = self._began_ns + tick * _PERIOD_NS
        stamp = messages.Timestamp(*divmod(at_ns, 10**9))
        entry = messages.Log(timestamp=stamp, level=level, message=words, name=name)
        self._log.log(self._tickets.ticket_for(entry.encode()), log_time=at_ns)
