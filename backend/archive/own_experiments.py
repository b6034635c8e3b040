"""Experiments by name: those that come with Sinew, and own ones, which are kept in versions."""

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any

from backend.archive.recorded_experiment import recorded_experiment
from backend.banks.tuning_settings import TuningChoice
from backend.execution.runner import banks_in, playable
from backend.experiments import library, parser
from backend.experiments.compiler import Played, played_parts
from backend.experiments.library import Entry, entry_of, experiments
from backend.experiments.library import experiment as ready
from backend.experiments.parser import ExperimentError, line_of
from backend.experiments.plans import ComposedPlan, LoopSettings, Plan, split_values
from backend.models.run import with_motion
from backend.models.settings import SettingError
from backend.plain_text import as_folded
from backend.schemas.experiment import (
    CheckedExperiment,
    DryRunView,
    OwnExperiment,
    PartPlayed,
    RecordedExperiment,
    WrittenExperiment,
)
from backend.storage import experiments as stored
from backend.storage.database import Database
from backend.storage.experiments import StoredExperiment
from backend.storage.orm import UnknownRecordError
from plant.parameters import PlantParameters


@dataclass(frozen=True)
class Checked:
    """What can be told of an experiment before it is kept or started; its settings are at their defaults.

    Goes from one process to another, unlike an entry.
    """

    name: str
    title: str
    plan: ComposedPlan
    duration_s: float
    segments: int
    changes_of_tuning: int
    document: dict[str, Any]
    parts: list[Played]

    def view(
        self,
        figures: Mapping[str, float | None],
        not_predicted: str = "",
        *,
        busy: bool = False,
        dry_run: DryRunView | None = None,
    ) -> CheckedExperiment:
        """Return it as the page shows it, with its figures on the simulator, or why it was not played there."""
        return CheckedExperiment(
            name=self.name,
            title=self.title,
            duration_s=self.duration_s,
            segments=self.segments,
            changes_of_tuning=self.changes_of_tuning,
            phases=[phase.title for phase in self.plan.phases()],
            criteria=len(self.plan.experiment.criteria),
            peak_voltage_V=figures.get("peak_voltage_V"),
            min_tension_N=figures.get("min_tension_N"),
            max_tension_N=figures.get("max_tension_N"),
            not_predicted=not_predicted,
            busy=busy,
            document=self.document,
            parts=[PartPlayed(**{**asdict(part), "path": list(part.path)}) for part in self.parts],
            dry_run=dry_run,
        )


class OwnExperiments:
    """Reads, checks and keeps them. Nothing is overwritten: what is kept under a name again is its next version."""

    def __init__(self, database: Database) -> None:
        self._database = database

    def all(self) -> list[Entry]:
        """Return every experiment that can be ordered, own ones in their newest version, after the ready-made."""
        with self._database.reading() as session:
            own = stored.newest(session)
        return [*experiments().values(), *(entry for kept in own if (entry := _readable(kept)) is not None)]

    def views(self) -> list[OwnExperiment]:
        """Return the newest version of each own experiment."""
        with self._database.reading() as session:
            return [view_of(kept) for kept in stored.newest(session)]

    def versions(self, name: str) -> list[OwnExperiment]:
        """Return all versions of an own experiment, the newest first; none where there is no such name."""
        with self._database.reading() as session:
            return [view_of(kept) for kept in stored.versions(session, name)]

    def has_own(self) -> bool:
        """Whether any own experiment is kept."""
        with self._database.reading() as session:
            return bool(stored.newest(session))

    def plan(self, name: str, in_force: LoopSettings, settings: Mapping[str, Any]) -> tuple[str, Plan, LoopSettings]:
        """Return what an order asks for, of an own experiment its version; ``in_force`` where nothing else is said.

        Raises SettingError, OutOfRangeError, ExperimentError.
        """
        entry = self.entry(name)
        return entry.name, *split_values(entry.settings, entry.make, {**asdict(in_force), **with_motion(settings)})

    def written(self, name: str) -> WrittenExperiment:
        """Return an experiment as its text: ready-made, "name" or "name@2". Raises UnknownRecordError."""
        written = library.text_of(name) if name in library.NAMES else self._stored(name).text
        return WrittenExperiment(text=written, document=parser.document_of(written, stored=True)[0])

    def as_run(self, run_id: int) -> RecordedExperiment:
        """Return the recorded references of a run as an experiment. Raises UnknownRecordError, ExperimentError."""
        return recorded_experiment(self._database, run_id)

    def entry(self, name: str) -> Entry:
        """Return the experiment of this name: ready-made, own, or a version of an own one, "name@2".

        Raises SettingError with those there are, ExperimentError for a text that an older Sinew took.
        """
        if name in experiments():
            return ready(name)
        try:
            kept = self._stored(name)
        except UnknownRecordError:
            known = tuple(entry.name for entry in self.all())
            why = f"there is no such experiment; known: {', '.join(known)}"
            raise SettingError("name", name, why, legal=known) from None
        return _entry_of(kept)

    def keep(self, written: str, who: str, parameters: PlantParameters, tuning: TuningChoice) -> StoredExperiment:
        """Keep an experiment that can be played on this plant. Raises ExperimentError."""
        return self.store(self.checked(written, parameters, tuning), written, who)

    def store(self, checked: Checked, written: str, who: str) -> StoredExperiment:
        """Keep an experiment that was looked over, as the next version of its name."""
        with self._database.session() as session:
            return stored.add(session, checked.name, written, who)

    def checked(self, written: str, parameters: PlantParameters, tuning: TuningChoice) -> Checked:
        """Look an experiment over, whole, before anything moves. Raises ExperimentError naming line and bound."""
        experiment, lines = parser.read(written)
        if as_folded(experiment.name) in map(as_folded, experiments()):
            why = f"{experiment.name!r} is the name of a ready-made experiment: give this one another"
            raise ExperimentError(why, ("name",), line_of(("name",), lines))
        entry = entry_of(experiment, lines)
        plan = entry.usual
        assert isinstance(plan, ComposedPlan)
        program = playable(banks_in(self._database), parameters, plan, tuning)
        return Checked(
            entry.name,
            entry.title,
            plan,
            program.duration_s,
            len(program.segments),
            len(program.tunings),
            parser.document_of(written)[0],
            played_parts(plan.laid),
        )

    def _stored(self, name: str) -> StoredExperiment:
        base, at, number = name.partition("@")
        if at and not (number.isdecimal() and len(number) < 10):
            raise UnknownRecordError(f"there is no experiment {name}")
        with self._database.reading() as session:
            return stored.get(session, base, int(number) if at else None)


def view_of(kept: StoredExperiment, title: str | None = None) -> OwnExperiment:
    """Return an own experiment as it is listed; without its ``title`` its text is read."""
    if title is None:
        entry = _readable(kept)
        title = "" if entry is None else entry.title
    return OwnExperiment(name=kept.name, version=kept.version, title=title, who=kept.who, created=kept.created_at)


def _entry_of(kept: StoredExperiment) -> Entry:
    experiment, lines = parser.read(kept.text, stored=True)
    return entry_of(experiment, lines, name=f"{kept.name}@{kept.version}")


def _readable(kept: StoredExperiment) -> Entry | None:
    """Return the entry of an own experiment; one that this version of Sinew does not take any more is not offered."""
    try:
        return _entry_of(kept)
    except ExperimentError:
        return None
