"""Stored identifications, and the checks of documents taken in as such."""

import math
from collections.abc import Iterable, Mapping
from contextlib import suppress
from dataclasses import asdict, dataclass
from datetime import UTC, datetime
from functools import cached_property
from typing import Any

from sqlalchemy import JSON, Boolean, Float, LargeBinary, String, select
from sqlalchemy.orm import Session
from sqlalchemy.types import Integer

from backend.models import MAX_RECORD_NUMBER, EntryModel, UnreadableDocumentError, identification
from backend.plain_text import PlainTextError, check_single_line
from backend.storage.origins import BANKS, CALIBRATIONS, IDENTIFICATION
from backend.storage.orm import (
    Document,
    IdentificationRow,
    OriginRow,
    UnknownRecordError,
    UtcDateTime,
    require,
    to_record,
)
from backend.storage.runs import EndState, RunKind
from backend.storage.stations import session_station
from plant import ErrorCode, SinewError

# Fit -----------------------------------------------------------------------------------------------
#
# What a document has to be, to be taken in as a record: what its columns hold, and what makes sense
# together.


_OVER = [str(state) for state in EndState if state is not EndState.RUNNING]
_LISTS = ("criteria",)
"""Columns of JSON that hold a list."""
_MODELS = [name for name in EntryModel.__dataclass_fields__ if name != "version"]
_LINES = ("name", "title", "label", "symbol", "unit", "kind", "who", "parameters_name", "plant", "software", "method")
"""Parts of a document that are texts of one line, wherever they are."""
_LARGEST_NUMBER = 1e12
"""As of a bank that comes by a request."""
_CALIBRATION = {"step": str, "fingerprint": str, "calibrations": list}


class UnfitDocumentError(SinewError, ValueError):
    """A document that is no record of its kind; the message says which part of it is wrong."""

    category = ErrorCode.BAD_VALUE


def unfit(name: str, value: Any, needed: str) -> UnfitDocumentError:
    """Return the refusal of a part: what it is, what it would have to be, and what to do."""
    return UnfitDocumentError(f"{name} cannot be {str(value)[:40]!r}: it is {needed}; make the file anew from the run")


def require_fit(kind: str, column: Any, value: Any) -> None:
    """Raise UnfitDocumentError for what the column cannot hold."""
    if value is None and column.nullable:
        return
    assert isinstance(column.type, UtcDateTime | JSON | String | Boolean | Float | Integer | LargeBinary)
    if isinstance(column.type, UtcDateTime):
        fits, needed = _is_instant(value), "a moment with its time zone"
    elif isinstance(column.type, JSON):
        wanted = list if column.name in _LISTS else dict
        fits, needed = isinstance(value, wanted), "a list" if wanted is list else "an object"
    elif isinstance(column.type, String):  # Text too
        length = column.type.length
        fits = isinstance(value, str) and len(value) <= (length or len(value))
        needed = f"a text of {length} characters at most" if length else "a text"
    elif isinstance(column.type, Boolean):
        fits, needed = isinstance(value, bool), "true or false"
    else:
        numbers = int | float if isinstance(column.type, Float) else int
        fits = isinstance(value, numbers) and not isinstance(value, bool) and abs(value) <= MAX_RECORD_NUMBER
        needed = f"a number between -{MAX_RECORD_NUMBER} and {MAX_RECORD_NUMBER}"
    if not fits:
        raise unfit(f"{column.name} of a {kind}", value, needed)


def _is_instant(value: Any) -> bool:
    try:
        moment = datetime.fromisoformat(value)
        return moment.tzinfo is not None and bool(moment.astimezone(UTC))
    except (TypeError, ValueError, OverflowError):
        return False


def require_run(document: Document) -> None:
    """Raise UnfitDocumentError for a run that cannot have been one, or was not over."""
    kinds, bank = [str(kind) for kind in RunKind], document["bank_id"]
    if document["kind"] not in kinds:
        raise unfit("kind of a run", document["kind"], f"one of {', '.join(kinds)}")
    if document["end_state"] == EndState.RUNNING:
        raise UnfitDocumentError("it is of a run that was not over: export it again once it is")
    if document["end_state"] not in _OVER:
        raise unfit("end_state of a run", document["end_state"], f"one of {', '.join(_OVER)}")
    began, ended = document["started_at"], document["ended_at"]
    if ended is None or datetime.fromisoformat(ended) < datetime.fromisoformat(began):
        raise unfit("ended_at of a run", ended, f"a moment after started_at, {began}")
    loop = document["settings"].get("loop")
    named = loop.get("bank") if isinstance(loop, Mapping) else None
    if named is not None and named != (bank or 0):
        raise unfit("settings.loop.bank of a run", named, f"its bank_id, {bank}")


def require_lines(document: Any) -> None:
    """Raise UnfitDocumentError for a name, title, label, symbol or unit in a document that is no text of one line."""
    parts = [document]
    try:
        while parts:
            part = parts.pop()
            if isinstance(part, Mapping):
                for name, value in part.items():
                    check_single_line(name)
                    if name in _LINES and isinstance(value, str):
                        check_single_line(value)
                    parts.append(value)
            elif isinstance(part, list):
                parts.extend(part)
    except PlainTextError as error:
        raise UnfitDocumentError(f"{error}; make the file anew from the run") from None


def require_entry(entry: Mapping[str, Any]) -> None:
    """Raise UnfitDocumentError for an entry of a bank that no loop could be made of."""
    if entry["S_nominal"] <= 0.0:
        raise unfit("S_nominal of a bank entry", entry["S_nominal"], "a stiffness above 0 N·m/rad")
    if not set(_MODELS) & set(entry["model"]):
        raise unfit("model of a bank entry", entry["model"], f"an object with {', '.join(_MODELS)}")
    for name in set(_MODELS) & set(entry["model"]):
        number = entry["model"][name]
        if not isinstance(number, int | float) or isinstance(number, bool) or not 0.0 < number <= _LARGEST_NUMBER:
            raise unfit(f"{name} of a bank entry", number, f"a number above 0, at most {_LARGEST_NUMBER:g}")


def require_identification_document(carried: Mapping[str, Any], *, of_run: bool) -> None:
    """Raise UnfitDocumentError for what goes with no record, or is not what it is called."""
    known = (CALIBRATIONS, BANKS) if of_run else ()
    for name in carried:
        if name not in known:
            raise unfit(
                "a part of what is carried", name, f"one of {', '.join(known)}" if known else "none, but with runs"
            )
    steps, numbers = carried.get(CALIBRATIONS, []), carried.get(BANKS, [])
    if not isinstance(steps, list) or not all(_is_calibration(one) for one in steps):
        raise unfit(f"carried.{CALIBRATIONS}", steps, f"a list of objects with {', '.join(_CALIBRATION)}")
    if not isinstance(numbers, list) or not all(type(one) is int and 0 < one <= MAX_RECORD_NUMBER for one in numbers):
        raise unfit(f"carried.{BANKS}", numbers, f"a list of numbers from 1 to {MAX_RECORD_NUMBER}")


def _is_calibration(one: Any) -> bool:
    return (
        isinstance(one, Mapping)
        and set(one) == set(_CALIBRATION)
        and all(isinstance(one[name], kind) for name, kind in _CALIBRATION.items())
    )


# Identifications -----------------------------------------------------------------------------------
#
# Identifications: what was estimated from which data, how, and whether it may be used for tuning.


@dataclass(frozen=True)
class NewIdentification:
    """An estimate to store.

    ``run_id`` is the run whose samples were used, None for data from elsewhere; ``data`` says which part of them
    (signals, time span, or file name and digest); ``model`` and ``quality`` are the estimator's result, JSON.
    """

    kind: str
    run_id: int | None
    data: Document
    method: str
    options: Document
    model: Document
    quality: Document
    usable: bool
    verdict: str
    who: str
    software: str


@dataclass(frozen=True)
class Identification(NewIdentification):
    """A stored estimate. What its documents say raises UnreadableDocumentError where they cannot be read."""

    id: int
    created_at: datetime

    @cached_property
    def actuator(self) -> identification.ActuatorResult:
        """What was found of an actuator."""
        model, quality = (
            identification.MODEL.read(self.model, self._of),
            identification.QUALITY.read(self.quality, self._of),
        )
        return identification.ActuatorResult(model, quality)

    @cached_property
    def actuator_record(self) -> identification.ActuatorRecord:
        """Which samples the models of an actuator came from."""
        return identification.RECORD.read(self.data, self._of)

    @cached_property
    def actuator_options(self) -> identification.ActuatorOptions:
        """What was asked for with an actuator."""
        return identification.OPTIONS.read(self.options, self._of)

    @cached_property
    def motors(self) -> identification.MotorsResult:
        """What was found of both motors."""
        models, qualities = (
            identification.MOTOR_MODELS.read(self.model, self._of),
            identification.MOTOR_QUALITIES.read(self.quality, self._of),
        )
        return identification.MotorsResult(models, qualities)

    @cached_property
    def springs(self) -> dict[str, identification.SpringResult]:
        """What was found of the springs, by name: "A" and "B", or "table"."""
        return identification.combine_spring_results(
            identification.SPRING_MODELS.read(self.model, self._of),
            identification.SPRING_QUALITIES.read(self.quality, self._of),
            self._of,
        )

    @cached_property
    def table(self) -> identification.TableRecord:
        """The file that a spring's table came from."""
        return identification.TABLE.read(self.data, self._of)

    def readable(self) -> None:
        """Raise UnreadableDocumentError for models of a known kind that cannot be read."""
        match self.kind:
            case "actuator":
                _ = self.actuator
            case "motor":
                _ = self.motors
            case "spring":
                _ = self.springs
            case _:
                pass

    @property
    def _of(self) -> str:
        return f"estimate {self.id}" if self.run_id is None else f"run {self.run_id}"


def add(session: Session, new: NewIdentification) -> Identification:
    """Store an estimate beside all earlier ones."""
    row = IdentificationRow(**asdict(new), created_at=datetime.now(UTC), station=session_station(session))
    session.add(row)
    session.flush()
    return to_record(Identification, row)


def get(session: Session, identification_id: int) -> Identification:
    """Return one estimate. Raises UnknownRecordError."""
    return to_record(Identification, require(session, IdentificationRow, identification_id, "identification"))


def of_run(session: Session, run_id: int) -> Identification:
    """Return the newest estimate made from a run. An identification goes by its run's number wherever people see it.

    Raises UnknownRecordError.
    """
    found = find(session, run_id=run_id)
    if not found:
        raise UnknownRecordError(f"there is no identification {run_id} with a model")
    return found[0]


def find_estimate_runs(session: Session) -> dict[int, int | None]:
    """Return by the number of each stored estimate that of the run it came from; None for data from elsewhere."""
    found = session.execute(select(IdentificationRow.id, IdentificationRow.run_id))
    return {row.id: row.run_id for row in found}


def joint_positions(session: Session, numbers: Iterable[int]) -> dict[int, float]:
    """Return the joint position [rad] at which each stored estimate of an actuator was made, where it says so."""
    rows = session.scalars(select(IdentificationRow).where(IdentificationRow.id.in_(tuple(numbers))))
    found: dict[int, float] = {}
    for row in rows:
        with suppress(UnreadableDocumentError):  # a bank is shown without what its identification cannot tell
            q = to_record(Identification, row).actuator.model.q_nominal
            found |= {} if q is None else {row.id: q}
    return found


def fits_of_runs(session: Session, runs: Iterable[int]) -> dict[int, dict[str, float]]:
    """Return by run the fit [%] of each channel of its newest estimate of an actuator, where it says so."""
    of_runs = (IdentificationRow.kind == "actuator", IdentificationRow.run_id.in_(tuple(runs)))
    found: dict[int, dict[str, float]] = {}
    for row in session.scalars(select(IdentificationRow).where(*of_runs).order_by(IdentificationRow.id)):
        with suppress(UnreadableDocumentError):  # a list is shown without what cannot be read
            quality = to_record(Identification, row).actuator.quality
            fits = {"G_q": quality.G_q.fit_percent, "G_S": quality.G_S.fit_percent}
            found[row.run_id or 0] = {name: fit for name, fit in fits.items() if fit is not None and math.isfinite(fit)}
    return found


def of_kind_after(session: Session, earlier: Identification) -> list[Identification]:
    """Return the estimates of the same kind that the same station has made since, newest first."""
    of_station = select(IdentificationRow.station).where(IdentificationRow.id == earlier.id).scalar_subquery()
    imported = select(OriginRow.number).where(OriginRow.kind == IDENTIFICATION)
    of_here = IdentificationRow.id.not_in(imported)  # an imported one is older than its number
    since = (IdentificationRow.id > earlier.id, IdentificationRow.kind == earlier.kind, of_here)
    query = select(IdentificationRow).where(*since, IdentificationRow.station == of_station)
    return [to_record(Identification, row) for row in session.scalars(query.order_by(IdentificationRow.id.desc()))]


def find(session: Session, *, kind: str | None = None, run_id: int | None = None) -> list[Identification]:
    """Return estimates, newest first: of a run, whoever made it, or all of the station, or those of a kind."""
    query = select(IdentificationRow).order_by(IdentificationRow.id.desc())
    if run_id is None:
        query = query.where(IdentificationRow.station == session_station(session))
    if kind is not None:
        query = query.where(IdentificationRow.kind == kind)
    if run_id is not None:
        query = query.where(IdentificationRow.run_id == run_id)
    return [to_record(Identification, row) for row in session.scalars(query)]
