"""Applying identified motors and springs: the controller goes by them from then on, what is simulated stays as it is.

Only while the actuator is off: the loop is started anew with what is in force then. Whoever undoes says which version,
so that two who undo at once do not undo each other.
"""

import asyncio
from collections.abc import Callable
from dataclasses import replace
from typing import NamedTuple

from backend.errors import Because, RefusalError
from backend.experiments import applied_parameters
from backend.experiments.applied_parameters import Change, NotApplicableError, Version, differences
from backend.models.run import AppliedParameters
from backend.operating.actuator import Actuator
from backend.operating.kept_tuning import KeptTuning
from backend.operating.tuning_in_use import TuningInUse
from backend.realtime.program import Mode
from backend.realtime.supervisor import Supervisor
from backend.schemas.tuning import ParameterChange, ParameterProposal, ParametersView, ParameterVersion
from backend.storage import identifications
from backend.storage.database import Database
from backend.tuning.gains import TuningError
from plant.parameters import ParameterError, PlantParameters, load_parameters


class _Wanted(NamedTuple):
    """What is to come into force, and a tuning that is safe on it in place of the one ``before``."""

    applied: AppliedParameters
    parameters: PlantParameters
    before: TuningInUse
    tuning: TuningInUse


class Applied:
    """Versions over ``base``, the parameter file. ``use`` hands what came into force to whoever goes by it."""

    def __init__(
        self,
        actuator: Actuator,
        supervisor: Supervisor,
        database: Database,
        kept: KeptTuning,
        base: PlantParameters,
        use: Callable[[PlantParameters], None],
    ) -> None:
        self._actuator, self._supervisor, self._database = actuator, supervisor, database
        self._kept, self._base, self._use = kept, base, use

    async def view(self, estimate: int | None = None) -> ParametersView:
        """Return what is in force and was, and what applying an estimate would change. Raises UnknownRecordError."""
        return await asyncio.to_thread(self._view, estimate)

    async def apply(self, estimate: int, who: str) -> ParametersView:
        """Put in force what was identified. Raises RefusalError, UnknownRecordError; nothing changes then."""
        async with self._actuator.starting:
            await self._take_up(await asyncio.to_thread(self._wanted, lambda: self._proposal(estimate)), who)
        return await self.view()

    async def undo(self, version: int, who: str) -> ParametersView:
        """Put what was before ``version``, the newest, in force again. Raises RefusalError; nothing changes then.

        That is the way back from parameters that no loop starts with: so it does for a loop that is not there, too.
        """
        async with self._actuator.starting:
            await self._take_up(await asyncio.to_thread(self._wanted, lambda: self._undoing(version)), who)
        return await self.view()

    def _wanted(self, propose: Callable[[], AppliedParameters]) -> _Wanted:
        try:
            if load_parameters(self._supervisor.setup.parameters) != self._base:  # a loop that starts reads it anew
                raise RefusalError(Because.NOT_NOW, "the parameter file has changed: start the service anew first")
            applied, before = propose(), self._actuator.present.operators_tuning
            parameters = self._base.with_identified(applied_parameters.sections_of(applied))
            return _Wanted(applied, parameters, before, self._kept.carried_over(before, parameters))
        except (NotApplicableError, ParameterError, TuningError) as error:
            raise RefusalError(Because.BAD_VALUE, f"it cannot be applied: {error}") from None

    async def _take_up(self, wanted: _Wanted, who: str) -> None:
        applied, parameters, before, tuning = wanted

        def take() -> None:
            self._require_idle(before)
            if not (applied.undone or self._supervisor.alive):
                raise RefusalError(Because.UNAVAILABLE, "the control loop is not running: reset starts it again")
            with self._database.session() as session:
                applied_parameters.keep(session, applied, who)
            self._kept.put(tuning, who)
            present = self._actuator.present
            present.use(parameters, tuning)
            present.earlier, present.undone = self._kept.earlier(tuning), False
            identified = applied_parameters.sections_of(applied)
            self._supervisor.setup = replace(self._supervisor.setup, identified=identified, tuning=tuning.command())
            self._use(parameters)

        self._require_idle(before)  # before it waits for its turn, too: there is nothing to wait for
        undone = "the former parameters, as the last identification was undone"
        run = f"the identification of run {applied.run}" if applied.run else "a spring measured elsewhere"
        moved = ", ".join(tuning.choice.differences(before.choice))
        told = f"{undone if applied.undone else run}{f' (tuning: {moved})' if moved else ''}"
        await self._actuator.take_up(take, told, who)

    def _require_idle(self, tuning: TuningInUse) -> None:
        """Raise RefusalError unless the actuator is off, nothing is under way and this tuning is in force."""
        present = self._actuator.present
        self._actuator.require_unoccupied()
        if present.task is not None or present.own_tuning is not None:
            raise RefusalError(Because.NOT_NOW, "a run is under way: parameters change when it is over")
        if present.trial() is not None:
            raise RefusalError(Because.NOT_NOW, "a tuning is on trial: keep it or revert it first")
        if present.mode is not Mode.OFF:
            raise RefusalError(
                Because.NOT_NOW, f"parameters are applied in off only; the mode is {present.mode}: switch it off first"
            )
        if present.tuning is not tuning:
            raise RefusalError(Because.NOT_NOW, "the tuning was changed meanwhile: look at it, then try again")

    def _undoing(self, version: int) -> AppliedParameters:
        newest = applied_parameters.versions(self._database, self._base)[0].number
        if newest not in (0, version):
            raise NotApplicableError(f"version {newest} is in force by now, not {version}: look at what it changed")
        return applied_parameters.undoing(self._database, self._base)

    def _proposal(self, estimate: int) -> AppliedParameters:
        with self._database.reading() as session:
            found = identifications.get(session, estimate)
        now = applied_parameters.in_force(self._database, self._base)
        return applied_parameters.proposal(self._base, now, found)

    def _view(self, estimate: int | None) -> ParametersView:
        try:
            found = applied_parameters.versions(self._database, self._base)
        except ParameterError as error:
            raise RefusalError(Because.NOT_NOW, f"a version that was applied is not taken any more: {error}") from None
        before = [*found[1:], found[-1]]
        return ParametersView(
            name=self._base.name,
            versions=[_version_view(one, former) for one, former in zip(found, before, strict=True)],
            proposal=None if estimate is None else self._proposal_view(estimate, found[0].parameters),
        )

    def _proposal_view(self, estimate: int, now: PlantParameters) -> ParameterProposal:
        try:
            then = self._base.with_identified(applied_parameters.sections_of(self._proposal(estimate)))
        except (NotApplicableError, ParameterError) as error:
            return ParameterProposal(estimate=estimate, problem=str(error), digest="", changes=[])
        digest = Version(0, then).digest
        return ParameterProposal(
            estimate=estimate, problem="", digest=digest, changes=[_change(one) for one in differences(now, then)]
        )


def _version_view(one: Version, former: Version) -> ParameterVersion:
    applied = one.applied
    return ParameterVersion(
        number=one.number,
        digest=one.digest,
        who=one.who,
        at=one.at,
        estimate=None if applied is None else applied.estimate or None,
        run=None if applied is None else applied.run or None,
        undone=applied is not None and applied.undone,
        changes=[_change(change) for change in differences(former.parameters, one.parameters)],
    )


def _change(one: Change) -> ParameterChange:
    percent = 100.0 * (one.after / one.before - 1.0) if one.before and one.after is not None else None
    return ParameterChange(
        name=one.name, side=one.side, unit=one.unit, before=one.before, after=one.after, percent=percent
    )
