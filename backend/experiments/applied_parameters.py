"""Identified motors and springs put in force: versions over the parameter file, each kept, the newest counts.

What is applied is what the controller knows of the plant. What a simulated plant really is stays as its file says.
"""

from collections.abc import Iterator
from dataclasses import asdict, dataclass
from datetime import datetime
from itertools import zip_longest
from typing import Any

from backend.banks import tuning_settings
from backend.models.document import digest_of
from backend.models.run import APPLIED, AppliedParameters
from backend.storage import settings
from backend.storage.database import Database, Session
from backend.storage.identifications import Identification
from plant.parameters import SIDES, PlantParameters, Side

NAME = "identified in force"


class NotApplicableError(ValueError):
    """An identification that cannot be applied to the parameters; the message says why."""


@dataclass(frozen=True)
class Version:
    """A set of parameters that came into force; number 0 is the file as it is, which nobody applied."""

    number: int
    parameters: PlantParameters
    applied: AppliedParameters | None = None
    who: str = ""
    at: datetime | None = None

    @property
    def digest(self) -> str:
        """The same for the same numbers with the same sources, as lineage shows it."""
        return digest_of(self.parameters.document())


@dataclass(frozen=True)
class Change:
    """An entry of what the controller knows of one side; None where one of the two has no such entry."""

    name: str
    side: Side
    unit: str
    before: float | None
    after: float | None


def versions(database: Database, base: PlantParameters) -> list[Version]:
    """Return all versions over this file's numbers, newest first, the file itself last.

    Raises UnreadableDocumentError, ParameterError.
    """
    with database.reading() as session:
        stored = [(APPLIED.read(one.value, f"version of {one.who}"), one) for one in settings.history(session, NAME)]
    mine = tuning_settings.tuning_digest(base)
    made = [(applied, one) for applied, one in reversed(stored) if applied.base == mine]
    found = [
        Version(number, _over(base, applied), applied, one.who, one.at)
        for number, (applied, one) in enumerate(made, start=1)
    ]
    return [*reversed(found), Version(0, base)]


def in_force(database: Database, base: PlantParameters) -> PlantParameters:
    """Return the parameters of the file with what was applied last. Raises UnreadableDocumentError, ParameterError."""
    return versions(database, base)[0].parameters


def last_applied_by(database: Database) -> str:
    """Return who applied something last, to whatever file; empty for nobody."""
    with database.reading() as session:
        last = settings.newest(session, NAME)
    return "" if last is None else last.who


def proposal(base: PlantParameters, now: PlantParameters, found: Identification) -> AppliedParameters:
    """Return what applying an identification would put in force, over what is ``now``.

    Raises NotApplicableError, and ParameterError for a value outside its bounds.
    """
    named = f"run {found.run_id}" if found.run_id is not None else f"estimate {found.id}"
    if found.kind not in ("motor", "spring"):
        raise NotApplicableError(f"{named} is an {found.kind} identification: build a bank from it")
    if not found.usable:
        raise NotApplicableError(f"{named} is not usable: {found.verdict}")
    source = f"{found.kind} identification of {named}"
    sections = identified_sections(now)
    for side in SIDES:
        entries = dict(_motor(found, side) if found.kind == "motor" else _spring(found, side))
        own = sections.setdefault(f"identified_{side}", {})
        if "k" in entries:
            own.pop("points", None)
        own |= {name: {"value": value, "unit": unit, "source": source} for name, (value, unit) in entries.items()}
    document = {
        "base": tuning_settings.tuning_digest(base),
        "identified": sections,
        "estimate": found.id,
        "run": found.run_id or 0,
    }
    applied = APPLIED.read(document, source)
    if not differences(now, _over(base, applied)):
        raise NotApplicableError(f"{named} says what is in force already: nothing would change")
    return applied


def undoing(database: Database, base: PlantParameters) -> AppliedParameters:
    """Return what puts the former version in force again. Raises NotApplicableError where there is none."""
    found = versions(database, base)
    if len(found) == 1:
        raise NotApplicableError("nothing was applied to the parameter file: there is nothing to undo")
    former = found[1].applied
    sections = {} if former is None else former.identified
    return AppliedParameters(
        base=tuning_settings.tuning_digest(base),
        identified=sections,
        estimate=0 if former is None else former.estimate,
        run=0 if former is None else former.run,
        undone=True,
    )


def keep(session: Session, applied: AppliedParameters, who: str) -> None:
    """Store a new version: it is the one in force from now on."""
    settings.put(session, NAME, APPLIED.write(applied), who)


def sections_of(applied: AppliedParameters) -> dict[str, dict[str, dict[str, Any]]]:
    """Return what is put over the file, as its document says it."""
    return {section: {name: asdict(one) for name, one in held.items()} for section, held in applied.identified.items()}


def identified_sections(parameters: PlantParameters) -> dict[str, dict[str, dict[str, Any]]]:
    """Return the sections of what the controller knows."""
    held = parameters.document().items()
    return {section: entries for section, entries in held if section.startswith("identified")}


def differences(before: PlantParameters, after: PlantParameters) -> list[Change]:
    """Return the entries that differ, side by side."""
    return [change for side in SIDES for change in _compared(before, after, side) if change.before != change.after]


def _compared(before: PlantParameters, after: PlantParameters, side: Side) -> Iterator[Change]:
    was, now = before.identified_of(side), after.identified_of(side)
    yield Change("K_m", side, "rad/(V·s)", was.K_m, now.K_m)
    yield Change("T_m", side, "s", was.T_m, now.T_m)
    for power, (old, new) in enumerate(zip_longest(was.k, now.k)):
        yield Change(f"k{power}", side, ("N", "N/m", "N/m²", "N/m³", "N/m⁴", "N/m⁵")[power], old, new)


def _over(base: PlantParameters, applied: AppliedParameters) -> PlantParameters:
    return base.with_identified(sections_of(applied))


def _motor(found: Identification, side: Side) -> Iterator[tuple[str, tuple[Any, str]]]:
    known = found.motors.side(side).model.parameters
    if known.K_m is None or known.T_m is None:
        raise NotApplicableError(f"run {found.run_id} has no K_m and T_m of motor {side}: evaluate it again")
    yield "K_m", (known.K_m, "rad/(V·s)")
    yield "T_m", (known.T_m, "s")


def _spring(found: Identification, side: Side) -> Iterator[tuple[str, tuple[Any, str]]]:
    """Give each spring its own polynomial, and both that of a table."""
    spring = found.springs.get(side) or found.springs.get("table")
    if spring is None:
        raise NotApplicableError(f"estimate {found.id} has no spring {side}")
    yield "k", (list(next(fit.k for fit in spring.model.fits if fit.order == spring.model.recommended)), "N/m^i")
