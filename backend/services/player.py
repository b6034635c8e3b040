"""Replay of a recording: its description and the commands of its player."""

import math
import re
from collections.abc import Awaitable, Callable
from pathlib import Path
from typing import Any

import numpy as np

from backend.errors import RequestRejectedError, check_range
from backend.exports import Facts, ImportRefusedError, writers
from backend.faults import EXPLANATIONS, FAULTS
from backend.realtime import MODES, SPEED_MAX, SPEED_MIN, Accepted, Command, PlayerMoved, PlayRecording
from backend.schemas import PlayedRecording, PlayerOrder, PlayerView, RunMark
from backend.services import messages
from backend.services.lineage import load_marks
from backend.storage import Database, EventKind, UnknownRecordError, runs
from plant import ErrorCode, RecordedSamples, Signal, T_s, load_replay

# Recording -----------------------------------------------------------------------------------------
# Title, run and events of a recording file.


_RUN = re.compile(r"run (\d{1,15})")


def describe_recording(path: str | Path, database: Database) -> PlayedRecording:
    """Return title, run, duration and event marks of a recording.

    The marks come from the event log if the run is stored in ``database``, else from the columns for mode and fault.
    Raises PlantError for an invalid file.
    """
    recording = load_replay(path)
    facts = _read_facts(Path(path))
    match = None if facts is None else _RUN.fullmatch(facts.of)
    number = None if match is None else int(match[1])
    stored = None if facts is None or number is None else _load_marks(database, number, facts)
    return PlayedRecording(
        title=facts.of if facts is not None and facts.of else Path(path).name,
        run=number,
        duration_s=(len(recording) - 1) * T_s,
        marks=_derive_marks(recording) if stored is None else stored,
    )


def _read_facts(path: Path) -> Facts | None:
    try:
        return writers.read_parquet(path)[0] if path.suffix == ".parquet" else writers.read_csv(path)[0]
    except (ImportRefusedError, UnicodeDecodeError):
        return None  # a file of another program, or a truncated one: it has no valid facts


def _load_marks(database: Database, number: int, facts: Facts) -> list[RunMark] | None:
    """Return the marks of the stored run.

    None if the run of this number in the database is another one.
    """
    try:
        with database.reading() as session:
            if runs.get(session, number).started_at.isoformat() != facts.started_at:
                return None
            return load_marks(session, number).marks
    except UnknownRecordError:
        return None


def _derive_marks(recording: RecordedSamples) -> list[RunMark]:
    """Return marks at the changes of mode and fault, sorted by time."""
    columns = recording.columns
    marks = []
    if "mode" in columns:
        modes = columns["mode"]
        for at in _find_changes(modes):
            before, after = _look_up_name(MODES, modes[at - 1]), _look_up_name(MODES, modes[at])
            marks.append(_build_mark(at, EventKind.MODE, messages.mode_changed(before=before, after=after)))
    for at in _find_changes(columns["fault"]):
        number = columns["fault"][at]
        if 0.0 < number < len(FAULTS):
            marks.append(_build_mark(at, EventKind.TRIP, EXPLANATIONS[FAULTS[int(number)]].message))
    return sorted(marks, key=lambda mark: mark.t)


def _find_changes(codes: Signal) -> list[int]:
    """Return the indices of samples whose code differs from the one before."""
    indices: list[int] = (np.flatnonzero(np.diff(codes) != 0.0) + 1).tolist()
    return indices


def _look_up_name(names: tuple[Any, ...], code: float) -> str:
    is_known = np.isfinite(code) and 0 <= code < len(names)
    return str(names[int(code)]) if is_known else messages.unknown_mode(code=code)


def _build_mark(at: int, kind: EventKind, text: str) -> RunMark:
    return RunMark(t=at * T_s, kind=kind, text=text, who="")


# Player --------------------------------------------------------------------------------------------
# Position and commands of the player. The player itself runs in the control loop, which reports each
# change of its motion.


class RecordingPlayer:
    """Commands the player of a recording and shows its position."""

    def __init__(
        self,
        recording: PlayedRecording | None,
        send: Callable[[Command], Awaitable[Accepted]],
        on_change: Callable[[], None],
    ) -> None:
        """Send commands to the control loop with ``send``.

        ``recording`` is None for another plant.
        """
        self._recording, self._send, self._on_change = recording, send, on_change
        self._last_move: PlayerMoved | None = None

    @property
    def has_recording(self) -> bool:
        """Whether a recording is replayed in place of a plant."""
        return self._recording is not None

    @property
    def recording(self) -> PlayedRecording:
        """The replayed recording. Raises RequestRejectedError for another plant."""
        if self._recording is None:
            raise RequestRejectedError(ErrorCode.NOT_NOW, messages.plant_is_not_a_replay(), code="no_recording")
        return self._recording

    def handle_event(self, event: PlayerMoved) -> None:
        """Store the position and playback speed from a tick on."""
        self._last_move = event
        self._on_change()

    def view(self, tick: int) -> PlayerView | None:
        """Return the position at ``tick``.

        None for another plant, or before the first report of the control loop.
        """
        move, recording = self._last_move, self._recording
        if move is None or recording is None:
            return None
        played = max(0, tick - move.tick) * move.speed if move.playing else 0.0
        last = move.samples - 1
        sample = min(move.sample + played, last)
        return PlayerView(
            title=recording.title,
            t=math.floor(sample) * T_s,
            tick=tick,
            duration_s=last * T_s,
            playing=move.playing and sample < last,
            ended=sample >= last,
            speed=move.speed,
            speed_min=SPEED_MIN,
            speed_max=SPEED_MAX,
        )

    async def apply(self, order: PlayerOrder) -> None:
        """Play or pause, set the speed, or go to a time.

        Raises RequestRejectedError, OutOfRangeError.
        """
        duration_s = self.recording.duration_s
        sample = None
        if order.speed is not None:
            check_range("speed", order.speed, SPEED_MIN, SPEED_MAX, "", label="playback speed")
        if order.t is not None:
            check_range("t", order.t, 0.0, duration_s, "s", label="time in the recording")
            sample = round(order.t / T_s)
        await self._send(PlayRecording(order.playing, order.speed, sample))

    def require_no_recording(self) -> None:
        """Raise RequestRejectedError for a replayed recording.

        It takes no commands except those of its player.
        """
        if self.has_recording:
            raise RequestRejectedError(ErrorCode.NOT_NOW, messages.replay_takes_no_commands(), code="recording_played")
