"""What a file says of the recording in it: which run it is, and what happened in it."""

import re
from pathlib import Path
from typing import Any

import numpy as np

from backend.archive.history import marks_of
from backend.exports import writers
from backend.exports.base import Facts, ImportRefusedError
from backend.faults import EXPLAINED, FAULTS
from backend.realtime.program import MODES
from backend.schemas.run import PlayedRecording, RunMark
from backend.storage import runs
from backend.storage.database import Database
from backend.storage.events import EventKind
from backend.storage.orm import UnknownRecordError
from plant.interface import T_s
from plant.replay import Recording, Signal, load_recording

_RUN = re.compile(r"run (\d{1,15})")


def played_recording(path: str | Path, database: Database) -> PlayedRecording:
    """Return what a recording is and what happened in it.

    That is told by the log where its run is stored here, else by its columns. Raises PlantError for another file.
    """
    recording = load_recording(path)
    facts = _facts(Path(path))
    named = None if facts is None else _RUN.fullmatch(facts.of)
    number = None if named is None else int(named[1])
    stored = None if facts is None or number is None else _stored_marks(database, number, facts)
    return PlayedRecording(
        title=facts.of if facts is not None and facts.of else Path(path).name,
        run=number,
        duration_s=(len(recording) - 1) * T_s,
        marks=_marks_in(recording) if stored is None else stored,
    )


def _facts(path: Path) -> Facts | None:
    try:
        return writers.read_parquet(path)[0] if path.suffix == ".parquet" else writers.read_csv(path)[0]
    except (ImportRefusedError, UnicodeDecodeError):
        return None  # a file that another program wrote, or one cut to a part: it says of itself nothing that holds


def _stored_marks(database: Database, number: int, facts: Facts) -> list[RunMark] | None:
    """Return what the log tells of the run; None where the run of that number here is another one."""
    try:
        with database.reading() as session:
            if runs.get(session, number).started_at.isoformat() != facts.started_at:
                return None
            return marks_of(session, number).marks
    except UnknownRecordError:
        return None


def _marks_in(recording: Recording) -> list[RunMark]:
    columns = recording.columns
    marks = []
    if "mode" in columns:
        modes = columns["mode"]
        for at in _changes(modes):
            before, after = _named(MODES, modes[at - 1]), _named(MODES, modes[at])
            marks.append(_mark(at, EventKind.MODE, f"{before} → {after}"))
    for at in _changes(columns["fault"]):
        number = columns["fault"][at]
        if 0.0 < number < len(FAULTS):
            marks.append(_mark(at, EventKind.TRIP, EXPLAINED[FAULTS[int(number)]].message))
    return sorted(marks, key=lambda mark: mark.t)


def _changes(codes: Signal) -> list[int]:
    """Return the places of samples with another code than the one before them."""
    found: list[int] = (np.flatnonzero(np.diff(codes) != 0.0) + 1).tolist()
    return found


def _named(names: tuple[Any, ...], code: float) -> str:
    known = np.isfinite(code) and 0 <= code < len(names)
    return str(names[int(code)]) if known else f"mode {code:g}"


def _mark(at: int, kind: EventKind, text: str) -> RunMark:
    return RunMark(t=at * T_s, kind=kind, text=text, who="")
