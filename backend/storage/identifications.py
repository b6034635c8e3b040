"""Stored identifications, and checks of imported documents."""

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
from backend.storage import messages
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
# Checks of an imported document: contents of its columns, and consistency.


_OVER = [str(state) for state in EndState if state is not EndState.RUNNING]
_LISTS = ("criteria",)
"""JSON columns that hold a list."""
_MODELS = [name for name in EntryModel.__dataclass_fields__ if name != "version"]
_LINES = ("name", "title", "label", "symbol", "unit", "kind", "who", "parameters_name", "plant", "software", "method")
"""Single-line texts in a document, in any place."""
_LARGEST_NUMBER = 1e12
"""The limit of a bank in a request."""
_CALIBRATION = {"step": str, "fingerprint": str, "calibrations": list}


class UnfitDocumentError(SinewError, ValueError):
    """A document that is no valid record of its kind; the message names the part."""

    category = ErrorCode.BAD_VALUE


def require_fit(kind: str, column: Any, value: Any) -> None:
    """Raise UnfitDocumentError for a value that the column cannot hold."""
    if value is None and column.nullable:
        return
    assert isinstance(column.type, UtcDateTime | JSON | String | Boolean | Float | Integer | LargeBinary)
    if isinstance(column.type, UtcDateTime):
        fits, needed = _is_instant(value), "a time with its time zone"
    elif isinstance(column.type, JSON):
        wanted = list if column.name in _LISTS else dict
        fits, needed = isinstance(value, wanted), "a list" if wanted is list else "an object"
    elif isinstance(column.type, String):  # Text too
        length = column.type.length
        fits = isinstance(value, str) and len(value) <= (length or len(value))
        needed = f"text of at most {length} characters" if length else "text"
    elif isinstance(column.type, Boolean):
        fits, needed = isinstance(value, bool), "true or false"
    else:
        numbers = int | float if isinstance(column.type, Float) else int
        fits = isinstance(value, numbers) and not isinstance(value, bool) and abs(value) <= MAX_RECORD_NUMBER
        needed = f"a number between -{MAX_RECORD_NUMBER} and {MAX_RECORD_NUMBER}"
    if not fits:
        raise UnfitDocumentError(messages.part_unfit(part=f"{column.name} of the {kind}", value=value, needed=needed))


def _is_instant(value: Any) -> bool:
    try:
        moment = datetime.fromisoformat(value)
        return moment.tzinfo is not None and bool(moment.astimezone(UTC))
    except (TypeError, ValueError, OverflowError):
        return False


def require_run(document: Document) -> None:
    """Raise UnfitDocumentError for a run that is implausible or was not over."""
    kinds, bank = [str(kind) for kind in RunKind], document["bank_id"]
    if document["kind"] not in kinds:
        needed = f"one of {', '.join(kinds)}"
        raise UnfitDocumentError(messages.part_unfit(part="kind of the run", value=document["kind"], needed=needed))
    if document["end_state"] == EndState.RUNNING:
        raise UnfitDocumentError(messages.exported_run_not_over())
    if document["end_state"] not in _OVER:
        needed = f"one of {', '.join(_OVER)}"
        raise UnfitDocumentError(
            messages.part_unfit(part="end_state of the run", value=document["end_state"], needed=needed)
        )
    began, ended = document["started_at"], document["ended_at"]
    if ended is None or datetime.fromisoformat(ended) < datetime.fromisoformat(began):
        needed = f"a time after started_at, {began}"
        raise UnfitDocumentError(messages.part_unfit(part="ended_at of the run", value=ended, needed=needed))
    loop = document["settings"].get("loop")
    named = loop.get("bank") if isinstance(loop, Mapping) else None
    if named is not None and named != (bank or 0):
        needed = f"its bank_id, {bank}"
        raise UnfitDocumentError(messages.part_unfit(part="settings.loop.bank of the run", value=named, needed=needed))


def require_lines(document: Any) -> None:
    """Raise UnfitDocumentError for a name, label or unit that is not one plain line."""
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
        raise UnfitDocumentError(messages.invalid_line_in_record(reason=error.message)) from None


def require_entry(entry: Mapping[str, Any]) -> None:
    """Raise UnfitDocumentError for a bank entry that yields no gains."""
    if entry["S_nominal"] <= 0.0:
        needed = "a stiffness above 0 N·m/rad"
        raise UnfitDocumentError(
            messages.part_unfit(part="S_nominal of the bank entry", value=entry["S_nominal"], needed=needed)
        )
    if not set(_MODELS) & set(entry["model"]):
        needed = f"an object with {', '.join(_MODELS)}"
        raise UnfitDocumentError(
            messages.part_unfit(part="model of the bank entry", value=entry["model"], needed=needed)
        )
    for name in set(_MODELS) & set(entry["model"]):
        number = entry["model"][name]
        if not isinstance(number, int | float) or isinstance(number, bool) or not 0.0 < number <= _LARGEST_NUMBER:
            needed = f"a number above 0, at most {_LARGEST_NUMBER:g}"
            raise UnfitDocumentError(messages.part_unfit(part=f"{name} of the bank entry", value=number, needed=needed))


def require_identification_document(carried: Mapping[str, Any], *, of_run: bool) -> None:
    """Raise UnfitDocumentError for invalid data that accompany a record."""
    known = (CALIBRATIONS, BANKS) if of_run else ()
    for name in carried:
        if name not in known:
            needed = f"one of {', '.join(known)}" if known else "left out for this kind of record"
            raise UnfitDocumentError(messages.part_unfit(part="a part of the document", value=name, needed=needed))
    steps, numbers = carried.get(CALIBRATIONS, []), carried.get(BANKS, [])
    if not isinstance(steps, list) or not all(_is_calibration(one) for one in steps):
        needed = f"a list of objects with {', '.join(_CALIBRATION)}"
        raise UnfitDocumentError(messages.part_unfit(part=f"carried.{CALIBRATIONS}", value=steps, needed=needed))
    if not isinstance(numbers, list) or not all(type(one) is int and 0 < one <= MAX_RECORD_NUMBER for one in numbers):
        needed = f"a list of numbers from 1 to {MAX_RECORD_NUMBER}"
        raise UnfitDocumentError(messages.part_unfit(part=f"carried.{BANKS}", value=numbers, needed=needed))


def _is_calibration(one: Any) -> bool:
    return (
        isinstance(one, Mapping)
        and set(one) == set(_CALIBRATION)
        and all(isinstance(one[name], kind) for name, kind in _CALIBRATION.items())
    )


# Identifications -----------------------------------------------------------------------------------
# Identifications: estimates with their data and method, and their verdict for tuning.


@dataclass(frozen=True)
class NewIdentification:
    """An estimate to store.

    ``run_id`` is the run whose samples were used, None for external data; ``data`` describes the part used (signals,
    time span, or file name and digest); ``model`` and ``quality`` are the estimator's result as JSON.
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
    """A stored estimate; its documents raise UnreadableDocumentError if unreadable."""

    id: int
    created_at: datetime

    @cached_property
    def actuator(self) -> identification.ActuatorResult:
        """Identified models of an actuator."""
        model, quality = (
            identification.ACTUATOR_MODEL.read(self.model, self._of),
            identification.ACTUATOR_QUALITY.read(self.quality, self._of),
        )
        return identification.ActuatorResult(model, quality)

    @cached_property
    def actuator_record(self) -> identification.ActuatorRecord:
        """Samples from which the models of an actuator were identified."""
        return identification.ACTUATOR_RECORD.read(self.data, self._of)

    @cached_property
    def actuator_options(self) -> identification.ActuatorOptions:
        """Options of an actuator's identification."""
        return identification.ACTUATOR_OPTIONS.read(self.options, self._of)

    @cached_property
    def motors(self) -> identification.MotorsResult:
        """Identified models of both motors."""
        models, qualities = (
            identification.MOTOR_MODELS.read(self.model, self._of),
            identification.MOTOR_QUALITIES.read(self.quality, self._of),
        )
        return identification.MotorsResult(models, qualities)

    @cached_property
    def springs(self) -> dict[str, identification.SpringResult]:
        """Identified springs by name: "A" and "B", or "table"."""
        return identification.combine_spring_results(
            identification.SPRING_MODELS.read(self.model, self._of),
            identification.SPRING_QUALITIES.read(self.quality, self._of),
            self._of,
        )

    @cached_property
    def table(self) -> identification.TableRecord:
        """File of a spring's table."""
        return identification.TABLE.read(self.data, self._of)

    def readable(self) -> None:
        """Raise UnreadableDocumentError for unreadable models of a known kind."""
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
    """Store an estimate; earlier ones remain."""
    row = IdentificationRow(**asdict(new), created_at=datetime.now(UTC), station=session_station(session))
    session.add(row)
    session.flush()
    return to_record(Identification, row)


def get(session: Session, identification_id: int) -> Identification:
    """Return one estimate. Raises UnknownRecordError."""
    return to_record(Identification, require(session, IdentificationRow, identification_id, "identification"))


def of_run(session: Session, run_id: int) -> Identification:
    """Return the newest estimate of a run, whose number people use for it.

    Raises UnknownRecordError.
    """
    found = find(session, run_id=run_id)
    if not found:
        raise UnknownRecordError(messages.identification_without_model(run_id=run_id))
    return found[0]


def find_estimate_runs(session: Session) -> dict[int, int | None]:
    """Return the run of each stored estimate by its number; None for external data."""
    found = session.execute(select(IdentificationRow.id, IdentificationRow.run_id))
    return {row.id: row.run_id for row in found}


def joint_positions(session: Session, numbers: Iterable[int]) -> dict[int, float]:
    """Return the joint position [rad] of stored estimates of an actuator, if known."""
    rows = session.scalars(select(IdentificationRow).where(IdentificationRow.id.in_(tuple(numbers))))
    found: dict[int, float] = {}
    for row in rows:
        with suppress(UnreadableDocumentError):  # a bank is shown without the values of an unreadable identification
            q = to_record(Identification, row).actuator.model.q_nominal
            found |= {} if q is None else {row.id: q}
    return found


def fits_of_runs(session: Session, runs: Iterable[int]) -> dict[int, dict[str, float]]:
    """Return the fits [%] of a run's newest actuator estimate, by channel, if known."""
    of_runs = (IdentificationRow.kind == "actuator", IdentificationRow.run_id.in_(tuple(runs)))
    found: dict[int, dict[str, float]] = {}
    for row in session.scalars(select(IdentificationRow).where(*of_runs).order_by(IdentificationRow.id)):
        with suppress(UnreadableDocumentError):  # a list is shown without unreadable values
            quality = to_record(Identification, row).actuator.quality
            fits = {"G_q": quality.G_q.fit_percent, "G_S": quality.G_S.fit_percent}
            found[row.run_id or 0] = {name: fit for name, fit in fits.items() if fit is not None and math.isfinite(fit)}
    return found


def of_kind_after(session: Session, earlier: Identification) -> list[Identification]:
    """Return later estimates of the same kind and station, newest first."""
    of_station = select(IdentificationRow.station).where(IdentificationRow.id == earlier.id).scalar_subquery()
    imported = select(OriginRow.number).where(OriginRow.kind == IDENTIFICATION)
    of_here = IdentificationRow.id.not_in(imported)  # imported estimates are older than their number
    since = (IdentificationRow.id > earlier.id, IdentificationRow.kind == earlier.kind, of_here)
    query = select(IdentificationRow).where(*since, IdentificationRow.station == of_station)
    return [to_record(Identification, row) for row in session.scalars(query.order_by(IdentificationRow.id.desc()))]


def find(session: Session, *, kind: str | None = None, run_id: int | None = None) -> list[Identification]:
    """Return estimates, newest first: of a run of any station, or of this station.

    ``kind`` selects those of a kind.
    """
    query = select(IdentificationRow).order_by(IdentificationRow.id.desc())
    if run_id is None:
        query = query.where(IdentificationRow.station == session_station(session))
    if kind is not None:
        query = query.where(IdentificationRow.kind == kind)
    if run_id is not None:
        query = query.where(IdentificationRow.run_id == run_id)
    return [to_record(Identification, row) for row in session.scalars(query)]
