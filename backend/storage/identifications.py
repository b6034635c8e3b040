"""Identifications: what was estimated from which data, how, and whether it may be used for tuning."""

import math
from collections.abc import Iterable
from contextlib import suppress
from dataclasses import asdict, dataclass
from datetime import UTC, datetime
from functools import cached_property

from sqlalchemy import select
from sqlalchemy.orm import Session

from backend.documents import actuator as of_actuator
from backend.documents import motor as of_motor
from backend.documents import spring as of_spring
from backend.documents.edge import UnreadableDocumentError
from backend.storage.origins import IDENTIFICATION
from backend.storage.records import UnknownRecordError, require, to_record
from backend.storage.schema import Document, IdentificationRow, OriginRow
from backend.storage.stations import station_of


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
    def actuator(self) -> of_actuator.ActuatorFound:
        """What was found of an actuator."""
        model, quality = of_actuator.MODEL.read(self.model, self._of), of_actuator.QUALITY.read(self.quality, self._of)
        return of_actuator.ActuatorFound(model, quality)

    @cached_property
    def actuator_record(self) -> of_actuator.ActuatorRecord:
        """Which samples the models of an actuator came from."""
        return of_actuator.RECORD.read(self.data, self._of)

    @cached_property
    def actuator_options(self) -> of_actuator.ActuatorOptions:
        """What was asked for with an actuator."""
        return of_actuator.OPTIONS.read(self.options, self._of)

    @cached_property
    def early_model(self) -> of_actuator.PartialModel:
        """What is there of an actuator's models, which an early version may have kept in part."""
        return of_actuator.PARTIAL_MODEL.read(self.model, self._of)

    @cached_property
    def early_quality(self) -> of_actuator.PartialQuality:
        """What is there of the quality of an actuator's models."""
        return of_actuator.PARTIAL_QUALITY.read(self.quality, self._of)

    @cached_property
    def motors(self) -> of_motor.MotorsFound:
        """What was found of both motors."""
        models, qualities = of_motor.MODELS.read(self.model, self._of), of_motor.QUALITIES.read(self.quality, self._of)
        return of_motor.MotorsFound(models, qualities)

    @cached_property
    def springs(self) -> dict[str, of_spring.SpringFound]:
        """What was found of the springs, by name: "A" and "B", or "table"."""
        return of_spring.springs_found(
            of_spring.MODELS.read(self.model, self._of), of_spring.QUALITIES.read(self.quality, self._of), self._of
        )

    @cached_property
    def table(self) -> of_spring.TableRecord:
        """The file that a spring's table came from."""
        return of_spring.TABLE.read(self.data, self._of)

    def readable(self) -> None:
        """Raise UnreadableDocumentError for models of a known kind that cannot be read."""
        match self.kind:
            case "actuator":
                _ = self.early_model, self.early_quality
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
    row = IdentificationRow(**asdict(new), created_at=datetime.now(UTC), station=station_of(session))
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


def runs_of(session: Session) -> dict[int, int | None]:
    """Return by the number of each stored estimate that of the run it came from; None for data from elsewhere."""
    found = session.execute(select(IdentificationRow.id, IdentificationRow.run_id))
    return {row.id: row.run_id for row in found}


def joint_positions(session: Session, numbers: Iterable[int]) -> dict[int, float]:
    """Return the joint position [rad] at which each stored estimate of an actuator was made, where it says so."""
    rows = session.scalars(select(IdentificationRow).where(IdentificationRow.id.in_(tuple(numbers))))
    found: dict[int, float] = {}
    for row in rows:
        with suppress(UnreadableDocumentError):  # a bank is shown without what its identification cannot tell
            q = to_record(Identification, row).early_model.q_nominal
            found |= {} if q is None else {row.id: q}
    return found


def fits_of_runs(session: Session, runs: Iterable[int]) -> dict[int, dict[str, float]]:
    """Return by run the fit [%] of each channel of its newest estimate of an actuator, where it says so."""
    of_runs = (IdentificationRow.kind == "actuator", IdentificationRow.run_id.in_(tuple(runs)))
    found: dict[int, dict[str, float]] = {}
    for row in session.scalars(select(IdentificationRow).where(*of_runs).order_by(IdentificationRow.id)):
        with suppress(UnreadableDocumentError):  # a list is shown without what an early one does not tell
            quality = to_record(Identification, row).early_quality
            told = {"G_q": quality.G_q, "G_S": quality.G_S}
            fits = {name: one.fit_percent for name, one in told.items() if one is not None}
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
        query = query.where(IdentificationRow.station == station_of(session))
    if kind is not None:
        query = query.where(IdentificationRow.kind == kind)
    if run_id is not None:
        query = query.where(IdentificationRow.run_id == run_id)
    return [to_record(Identification, row) for row in session.scalars(query)]
