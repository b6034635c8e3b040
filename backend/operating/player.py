"""The player of a recording: where it stands, by what the loop told of it last, and what it is asked for."""

import math
from collections.abc import Awaitable, Callable

from backend.errors import Because, RefusalError, require_within
from backend.realtime.commands import SPEED_MAX, SPEED_MIN, Accepted, Command, PlayerMoved, PlayRecording
from backend.schemas.run import PlayedRecording, PlayerOrder, PlayerView
from plant.interface import T_s

NO_COMMANDS = (
    "a recording is played: nothing real moves, so it takes no commands; the player on Operate has play, pause, speed "
    "and position"
)


class Player:
    """Plays ``recording`` by what ``command`` has the loop do; None where what is driven is no recording."""

    def __init__(
        self,
        recording: PlayedRecording | None,
        command: Callable[[Command], Awaitable[Accepted]],
        changed: Callable[[], None],
    ) -> None:
        self._recording, self._command, self._changed = recording, command, changed
        self._told: PlayerMoved | None = None

    @property
    def plays(self) -> bool:
        """Whether a recording is in the place of a plant."""
        return self._recording is not None

    @property
    def recording(self) -> PlayedRecording:
        """What is played. Raises RefusalError where nothing is."""
        if self._recording is None:
            message = "no recording is played: sinew serve --plant replay --recording FILE plays one"
            raise RefusalError(Because.NOT_NOW, message, code="no_recording")
        return self._recording

    def hear(self, event: PlayerMoved) -> None:
        """Take in where the player is from a tick on."""
        self._told = event
        self._changed()

    def view(self, tick: int) -> PlayerView | None:
        """Return where it stands in ``tick``; None where nothing is played, or the loop has not told yet."""
        told, recording = self._told, self._recording
        if told is None or recording is None:
            return None
        gone = max(0, tick - told.tick) * told.speed if told.playing else 0.0
        last = told.samples - 1
        sample = min(told.sample + gone, last)
        return PlayerView(
            title=recording.title,
            t=math.floor(sample) * T_s,
            tick=tick,
            duration_s=last * T_s,
            playing=told.playing and sample < last,
            ended=sample >= last,
            speed=told.speed,
            speed_min=SPEED_MIN,
            speed_max=SPEED_MAX,
        )

    async def order(self, order: PlayerOrder) -> None:
        """Play, pause, set the speed, go to a time. Raises RefusalError, OutOfRangeError."""
        duration_s = self.recording.duration_s
        sample = None
        if order.speed is not None:
            require_within("speed", order.speed, SPEED_MIN, SPEED_MAX, "", words="speed of the player")
        if order.t is not None:
            require_within("t", order.t, 0.0, duration_s, "s", words="time in the recording")
            sample = round(order.t / T_s)
        await self._command(PlayRecording(order.playing, order.speed, sample))

    def require_none(self) -> None:
        """Raise RefusalError while a recording is played: it takes no other commands."""
        if self.plays:
            raise RefusalError(Because.NOT_NOW, NO_COMMANDS, code="recording_played")
