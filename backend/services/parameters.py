"""Active plant parameters: versions of identified values over the parameter file."""

import asyncio
from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass, replace
from datetime import datetime
from itertools import zip_longest
from typing import Any, NamedTuple

from backend.banks import tuning_settings
from backend.errors import RequestRejectedError
from backend.event_bus import EventBus
from backend.models import APPLIED, AppliedParameters, document_digest
from backend.realtime import Mode, Supervisor
from backend.schemas import ParameterChange, ParameterProposal, ParametersView, ParameterVersion
from backend.services import messages
from backend.services.actuator import ActuatorService
from backend.services.tuning_state import ActiveTuning, TuningStore
from backend.storage import Database, Identification, Session, identifications, settings
from backend.tuning import TuningError
from plant import SIDES, ErrorCode, ParameterError, PlantParameters, Side, SinewError, load_parameters

# Versions ------------------------------------------------------------------------------------------
# Applying an identification stores a new version over the parameter file; the newest one is active.
# Controller and predictions use it. A simulated plant keeps the values of its file.


SETTING_NAME = "active identified"


class NotApplicableError(SinewError, ValueError):
    """An identification that cannot be applied to the parameters."""

    category = ErrorCode.NOT_NOW


@dataclass(frozen=True)
class AppliedVersion:
    """A set of parameters that was activated; number 0 is the unchanged file."""

    number: int
    parameters: PlantParameters
    applied: AppliedParameters | None = None
    who: str = ""
    at: datetime | None = None

    @property
    def digest(self) -> str:
        """Digest of the values with their sources, as the lineage shows it."""
        return document_digest(self.parameters.to_document())


def list_parameter_versions(database: Database, base: PlantParameters) -> list[AppliedVersion]:
    """Return all versions over this parameter file, newest first, the file last.

    Raises UnreadableDocumentError, ParameterError.
    """
    with database.reading() as session:
        stored = [
            (APPLIED.read(one.value, f"version of {one.who}"), one) for one in settings.history(session, SETTING_NAME)
        ]
    own_digest = tuning_settings.compute_parameters_digest(base)
    made = [(applied, one) for applied, one in reversed(stored) if applied.base == own_digest]
    found = [
        AppliedVersion(number, _apply_to(base, applied), applied, one.who, one.at)
        for number, (applied, one) in enumerate(made, start=1)
    ]
    return [*reversed(found), AppliedVersion(0, base)]


def load_active_parameters(database: Database, base: PlantParameters) -> PlantParameters:
    """Return the parameters of the newest version.

    Raises UnreadableDocumentError, ParameterError.
    """
    return list_parameter_versions(database, base)[0].parameters


def find_last_applicant(database: Database) -> str:
    """Return who applied parameters last, to whichever file; "" for nobody."""
    with database.reading() as session:
        last = settings.newest(session, SETTING_NAME)
    return "" if last is None else last.who


def build_proposal(base: PlantParameters, active: PlantParameters, found: Identification) -> AppliedParameters:
    """Return the values that applying an identification would activate.

    ``base`` are the parameters of the file, ``active`` the present ones. Raises NotApplicableError, and ParameterError
    for a value outside its range.
    """
    named = f"run {found.run_id}" if found.run_id is not None else f"estimate {found.id}"
    if found.kind not in ("motor", "spring"):
        raise NotApplicableError(messages.actuator_identification(identification=named, kind=found.kind))
    if not found.usable:
        raise NotApplicableError(messages.identification_not_usable(identification=named, verdict=found.verdict))
    source = messages.source_of_values(kind=found.kind, identification=named)
    sections = select_identified_sections(active)
    for side in SIDES:
        entries = dict(
            _iterate_motor_values(found, side) if found.kind == "motor" else _iterate_spring_values(found, side)
        )
        section = sections.setdefault(f"identified_{side}", {})
        if "k" in entries:
            section.pop("points", None)
        section |= {name: {"value": value, "unit": unit, "source": source} for name, (value, unit) in entries.items()}
    document = {
        "base": tuning_settings.compute_parameters_digest(base),
        "identified": sections,
        "estimate": found.id,
        "run": found.run_id or 0,
    }
    applied = APPLIED.read(document, source)
    if not find_changes(active, _apply_to(base, applied)):
        raise NotApplicableError(messages.values_are_active_already(identification=named))
    return applied


def build_undo(database: Database, base: PlantParameters) -> AppliedParameters:
    """Return the values that restore the previous version.

    Raises NotApplicableError if there is none.
    """
    found = list_parameter_versions(database, base)
    if len(found) == 1:
        raise NotApplicableError(messages.no_parameters_to_undo())
    former = found[1].applied
    sections = {} if former is None else former.identified
    return AppliedParameters(
        base=tuning_settings.compute_parameters_digest(base),
        identified=sections,
        estimate=0 if former is None else former.estimate,
        run=0 if former is None else former.run,
        undone=True,
    )


def store_parameters(session: Session, applied: AppliedParameters, who: str) -> None:
    """Store a new version, which becomes the active one."""
    settings.save(session, SETTING_NAME, APPLIED.write(applied), who)


def build_identified_sections(applied: AppliedParameters) -> dict[str, dict[str, dict[str, Any]]]:
    """Return the applied values as sections of a parameter document."""
    return {
        section: {name: asdict(one) for name, one in entries.items()} for section, entries in applied.identified.items()
    }


def select_identified_sections(parameters: PlantParameters) -> dict[str, dict[str, dict[str, Any]]]:
    """Return the sections of a parameter document with identified values."""
    entries = parameters.to_document().items()
    return {section: entries for section, entries in entries if section.startswith("identified")}


def find_changes(before: PlantParameters, after: PlantParameters) -> list[ParameterChange]:
    """Return the identified values that differ, with both values."""
    return [change for side in SIDES for change in _compare_side(before, after, side) if change.before != change.after]


def _compare_side(before: PlantParameters, after: PlantParameters, side: Side) -> Iterator[ParameterChange]:
    old, new = before.select_identified(side), after.select_identified(side)
    yield _build_change("K_m", side, "rad/(V·s)", old.K_m, new.K_m)
    yield _build_change("T_m", side, "s", old.T_m, new.T_m)
    for power, (old_k, new_k) in enumerate(zip_longest(old.k, new.k)):
        yield _build_change(f"k{power}", side, ("N", "N/m", "N/m²", "N/m³", "N/m⁴", "N/m⁵")[power], old_k, new_k)


def _build_change(name: str, side: Side, unit: str, before: float | None, after: float | None) -> ParameterChange:
    percent = 100.0 * (after / before - 1.0) if before and after is not None else None
    return ParameterChange(name=name, side=side, unit=unit, before=before, after=after, percent=percent)


def _apply_to(base: PlantParameters, applied: AppliedParameters) -> PlantParameters:
    return base.with_identified(build_identified_sections(applied))


def _iterate_motor_values(found: Identification, side: Side) -> Iterator[tuple[str, tuple[Any, str]]]:
    known = found.motors.side(side).model.parameters
    if known.K_m is None or known.T_m is None:
        raise NotApplicableError(messages.identification_without_motor(run=found.run_id, side=side))
    yield "K_m", (known.K_m, "rad/(V·s)")
    yield "T_m", (known.T_m, "s")


def _iterate_spring_values(found: Identification, side: Side) -> Iterator[tuple[str, tuple[Any, str]]]:
    """Yield the polynomial of a spring; a table gives both springs the same."""
    spring = found.springs.get(side) or found.springs.get("table")
    if spring is None:
        raise NotApplicableError(messages.estimate_without_spring(estimate=found.id, side=side))
    yield "k", (list(next(fit.k for fit in spring.model.fits if fit.order == spring.model.recommended)), "N/m^i")


# Service -------------------------------------------------------------------------------------------
# Parameters change only in mode off, because the loop restarts with them. An undo names its
# version, so that two simultaneous requests do not undo two versions.


class _PreparedChange(NamedTuple):
    """New parameters, the present tuning ``before``, and a safe tuning for them."""

    applied: AppliedParameters
    parameters: PlantParameters
    before: ActiveTuning
    tuning: ActiveTuning


@dataclass(frozen=True)
class ParametersApplied:
    """Other plant parameters became active."""

    parameters: PlantParameters


class ParameterService:
    """Applies and undoes versions over the parameter file ``base``.

    Publishes ParametersApplied.
    """

    def __init__(
        self,
        actuator: ActuatorService,
        supervisor: Supervisor,
        database: Database,
        tuning_store: TuningStore,
        base: PlantParameters,
        events: EventBus,
    ) -> None:
        self._actuator, self._supervisor, self._database = actuator, supervisor, database
        self._tuning_store, self._base, self._events = tuning_store, base, events

    def build_view(self, estimate: int | None = None) -> ParametersView:
        """Return all versions, and the effect of applying an estimate.

        Raises UnknownRecordError.
        """
        try:
            found = list_parameter_versions(self._database, self._base)
        except ParameterError as error:
            raise RequestRejectedError(
                ErrorCode.NOT_NOW, messages.applied_version_not_accepted(reason=error.message)
            ) from None
        before = [*found[1:], found[-1]]
        return ParametersView(
            name=self._base.name,
            versions=[_build_version_view(one, former) for one, former in zip(found, before, strict=True)],
            proposal=None if estimate is None else self._build_proposal_view(estimate, found[0].parameters),
        )

    async def apply(self, estimate: int, who: str) -> ParametersView:
        """Activate identified values.

        Raises RequestRejectedError, UnknownRecordError; nothing changes then.
        """
        async with self._actuator.start_lock:
            await self._apply_change(
                await asyncio.to_thread(self._prepare_change, lambda: self._build_proposal(estimate)), who
            )
        return await asyncio.to_thread(self.build_view)

    async def undo(self, version: int, who: str) -> ParametersView:
        """Restore the version before ``version``, which must be the newest.

        Works without a running loop too, to recover from parameters with which no loop starts. Raises
        RequestRejectedError; nothing changes then.
        """
        async with self._actuator.start_lock:
            await self._apply_change(
                await asyncio.to_thread(self._prepare_change, lambda: self._build_undo(version)), who
            )
        return await asyncio.to_thread(self.build_view)

    def _prepare_change(self, propose: Callable[[], AppliedParameters]) -> _PreparedChange:
        try:
            if load_parameters(self._supervisor.setup.parameters) != self._base:  # a loop reads it at its start
                raise RequestRejectedError(ErrorCode.NOT_NOW, messages.parameter_file_has_changed())
            applied, before = propose(), self._actuator.live_state.operator_tuning
            parameters = self._base.with_identified(build_identified_sections(applied))
            return _PreparedChange(
                applied, parameters, before, self._tuning_store.choose_for_parameters(before, parameters)
            )
        except (NotApplicableError, ParameterError, TuningError) as error:
            message = messages.parameters_not_applicable(reason=error.message)
            raise RequestRejectedError(ErrorCode.BAD_VALUE, message) from None

    async def _apply_change(self, change: _PreparedChange, who: str) -> None:
        applied, parameters, before, tuning = change

        def store_and_publish() -> None:
            self._require_idle(before)
            if not (applied.undone or self._supervisor.is_alive):
                raise RequestRejectedError(ErrorCode.UNAVAILABLE, messages.loop_is_not_running())
            with self._database.session() as session:
                store_parameters(session, applied, who)
            self._tuning_store.save(tuning, who)
            live_state = self._actuator.live_state
            live_state.set_parameters(parameters, tuning)
            live_state.reset_undo(self._tuning_store.load_previous(tuning))
            identified = build_identified_sections(applied)
            self._supervisor.setup = replace(
                self._supervisor.setup, identified=identified, tuning=tuning.build_command()
            )
            self._events.publish(ParametersApplied(parameters))

        self._require_idle(before)  # also before it waits for the restart
        description = messages.applied_parameters(
            undone=applied.undone,
            run=applied.run,
            tuning=", ".join(tuning.settings.list_differences(before.settings)),
        )
        await self._actuator.restart_loop_with(store_and_publish, description, who)

    def _require_idle(self, tuning: ActiveTuning) -> None:
        """Raise RequestRejectedError unless the actuator is off and nothing is running.

        ``tuning`` must still be the active one.
        """
        live_state = self._actuator.live_state
        self._actuator.require_unoccupied()
        if live_state.task is not None or live_state.overridden_tuning is not None:
            raise RequestRejectedError(ErrorCode.NOT_NOW, messages.run_prevents_change_of_parameters())
        if self._actuator.tuning_service.view_trial() is not None:
            raise RequestRejectedError(ErrorCode.NOT_NOW, messages.trial_in_progress())
        if live_state.mode is not Mode.OFF:
            raise RequestRejectedError(ErrorCode.NOT_NOW, messages.parameters_need_mode_off(mode=live_state.mode))
        if live_state.tuning is not tuning:
            raise RequestRejectedError(ErrorCode.NOT_NOW, messages.tuning_changed_meanwhile())

    def _build_undo(self, version: int) -> AppliedParameters:
        newest = list_parameter_versions(self._database, self._base)[0].number
        if newest not in (0, version):
            raise NotApplicableError(messages.other_version_is_active(active=newest, version=version))
        return build_undo(self._database, self._base)

    def _build_proposal(self, estimate: int) -> AppliedParameters:
        with self._database.reading() as session:
            found = identifications.get(session, estimate)
        active = load_active_parameters(self._database, self._base)
        return build_proposal(self._base, active, found)

    def _build_proposal_view(self, estimate: int, active: PlantParameters) -> ParameterProposal:
        try:
            proposed = self._base.with_identified(build_identified_sections(self._build_proposal(estimate)))
        except (NotApplicableError, ParameterError) as error:
            return ParameterProposal(estimate=estimate, problem=str(error), digest="", changes=[])
        digest = AppliedVersion(0, proposed).digest
        return ParameterProposal(estimate=estimate, problem="", digest=digest, changes=find_changes(active, proposed))


def _build_version_view(one: AppliedVersion, former: AppliedVersion) -> ParameterVersion:
    applied = one.applied
    return ParameterVersion(
        number=one.number,
        digest=one.digest,
        who=one.who,
        at=one.at,
        estimate=None if applied is None else applied.estimate or None,
        run=None if applied is None else applied.run or None,
        undone=applied is not None and applied.undone,
        changes=find_changes(former.parameters, one.parameters),
    )
