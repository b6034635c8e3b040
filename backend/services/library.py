"""The libraries of the station: own experiments, preferences, searches, tags."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any

from backend.auth import User
from backend.banks import TuningSettings
from backend.errors import RequestRejectedError
from backend.execution import compile_program, make_bank_loader
from backend.experiments import (
    ExperimentDefinition,
    ExperimentError,
    ExperimentPlan,
    LoopSettings,
    Plan,
    PlayedPart,
    build_experiment_definition,
    experiments_by_name,
    find_line,
    library,
    list_played_parts,
    parser,
    split_values,
)
from backend.experiments import find_experiment as ready
from backend.models import SettingError, complete_motion
from backend.plain_text import STORED_CONTEXT, PlainTextError, check_single_line, fold_name
from backend.schemas import (
    DEFAULT_PREFERENCES,
    SEARCH_NAME_MAX,
    CheckedExperiment,
    ComparisonRequest,
    DryRunView,
    MetricHistory,
    OwnExperiment,
    Preferences,
    RecordedExperiment,
    Role,
    RunComparison,
    SavedSearch,
    SavedSearchList,
    SearchWords,
    WrittenExperiment,
    check_preferences,
)
from backend.services import comparison
from backend.services.runs import build_recorded_experiment
from backend.storage import (
    ENDS,
    VERDICTS,
    Database,
    StoredExperiment,
    StoredSetting,
    UnknownRecordError,
    formulas,
    parse_query,
    require_distinct_name,
    search,
    settings,
    tags,
)
from backend.storage import experiments as stored
from plant import ErrorCode, PlantParameters

# Own experiments -----------------------------------------------------------------------------------
#
# Experiments by name: those that come with Sinew, and own ones, which are kept in versions.


@dataclass(frozen=True)
class ExperimentCheck:
    """What can be told of an experiment before it is kept or started; its settings are at their defaults.

    Goes from one process to another, unlike an entry.
    """

    name: str
    title: str
    plan: ExperimentPlan
    duration_s: float
    segments: int
    changes_of_tuning: int
    document: dict[str, Any]
    parts: list[PlayedPart]

    def build_view(
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
            parts=self.parts,
            dry_run=dry_run,
        )


class OwnExperiments:
    """Reads, checks and keeps them. Nothing is overwritten: what is kept under a name again is its next version."""

    def __init__(self, database: Database) -> None:
        self._database = database

    def list_definitions(self) -> list[ExperimentDefinition]:
        """Return every experiment that is offered, own ones in their newest version, after the ready-made."""
        with self._database.reading() as session:
            own = stored.newest(session)
        ready_made = (entry for entry in experiments_by_name().values() if not entry.replacement)
        return [*ready_made, *(entry for kept in own if (entry := _try_build_definition(kept)) is not None)]

    def list_own(self) -> list[OwnExperiment]:
        """Return the newest version of each own experiment."""
        with self._database.reading() as session:
            return [build_own_experiment(kept) for kept in stored.newest(session)]

    def list_versions(self, name: str) -> list[OwnExperiment]:
        """Return all versions of an own experiment, the newest first; none where there is no such name."""
        with self._database.reading() as session:
            return [build_own_experiment(kept) for kept in stored.versions(session, name)]

    def has_own(self) -> bool:
        """Whether any own experiment is kept."""
        with self._database.reading() as session:
            return bool(stored.newest(session))

    def build_plan(
        self, name: str, in_force: LoopSettings, settings: Mapping[str, Any]
    ) -> tuple[str, Plan, LoopSettings]:
        """Return what an order asks for, of an own experiment its version; ``in_force`` where nothing else is said.

        Raises SettingError, OutOfRangeError, ExperimentError.
        """
        entry = self.find_definition(name)
        return entry.name, *split_values(
            entry.settings, entry.make_plan, {**asdict(in_force), **complete_motion(settings)}
        )

    def load_text(self, name: str) -> WrittenExperiment:
        """Return an experiment as its text: ready-made, "name" or "name@2". Raises UnknownRecordError."""
        written = library.load_ready_text(name) if name in library.READY_NAMES else self._load_stored(name).text
        return WrittenExperiment(text=written, document=parser.parse_document(written, stored=True)[0])

    def build_from_run(self, run_id: int) -> RecordedExperiment:
        """Return the recorded references of a run as an experiment. Raises UnknownRecordError, ExperimentError."""
        return build_recorded_experiment(self._database, run_id)

    def find_definition(self, name: str) -> ExperimentDefinition:
        """Return the experiment of this name: ready-made, own, or a version of an own one, "name@2".

        Raises SettingError with those there are, ExperimentError for a text that an older Sinew took.
        """
        if name in experiments_by_name():
            return ready(name)
        try:
            kept = self._load_stored(name)
        except UnknownRecordError:
            known = tuple(entry.name for entry in self.list_definitions())
            why = f"there is no such experiment; known: {', '.join(known)}"
            raise SettingError("name", name, why, legal=known) from None
        return _build_definition(kept)

    def check_and_store(
        self, written: str, who: str, parameters: PlantParameters, tuning: TuningSettings
    ) -> StoredExperiment:
        """Keep an experiment that can be played on this plant. Raises ExperimentError."""
        return self.store(self.check(written, parameters, tuning), written, who)

    def store(self, checked: ExperimentCheck, written: str, who: str) -> StoredExperiment:
        """Keep an experiment that was looked over, as the next version of its name."""
        with self._database.session() as session:
            return stored.add(session, checked.name, written, who)

    def check(self, written: str, parameters: PlantParameters, tuning: TuningSettings) -> ExperimentCheck:
        """Look an experiment over, whole, before anything moves. Raises ExperimentError naming line and bound."""
        experiment, lines = parser.parse_experiment(written)
        if fold_name(experiment.name) in map(fold_name, experiments_by_name()):
            why = f"{experiment.name!r} is the name of a ready-made experiment: give this one another"
            raise ExperimentError(why, ("name",), find_line(("name",), lines))
        entry = build_experiment_definition(experiment, lines)
        plan = entry.default_plan
        assert isinstance(plan, ExperimentPlan)
        program = compile_program(make_bank_loader(self._database), parameters, plan, tuning)
        return ExperimentCheck(
            name=entry.name,
            title=entry.title,
            plan=plan,
            duration_s=program.duration_s,
            segments=len(program.segments),
            changes_of_tuning=len(program.tunings),
            document=parser.parse_document(written)[0],
            parts=list_played_parts(plan.compiled),
        )

    def _load_stored(self, name: str) -> StoredExperiment:
        base, at, number = name.partition("@")
        if at and not (number.isdecimal() and len(number) < 10):
            raise UnknownRecordError(f"there is no experiment {name}")
        with self._database.reading() as session:
            return stored.get(session, base, int(number) if at else None)


def build_own_experiment(kept: StoredExperiment, title: str | None = None) -> OwnExperiment:
    """Return an own experiment as it is listed; without its ``title`` its text is read."""
    if title is None:
        entry = _try_build_definition(kept)
        title = "" if entry is None else entry.title
    return OwnExperiment(name=kept.name, version=kept.version, title=title, who=kept.who, created=kept.created_at)


def _build_definition(kept: StoredExperiment) -> ExperimentDefinition:
    experiment, lines = parser.parse_experiment(kept.text, stored=True)
    return build_experiment_definition(experiment, lines, name=f"{kept.name}@{kept.version}")


def _try_build_definition(kept: StoredExperiment) -> ExperimentDefinition | None:
    """Return the entry of an own experiment; one that this version of Sinew does not take any more is not offered."""
    try:
        return _build_definition(kept)
    except ExperimentError:
        return None


# Preferences ---------------------------------------------------------------------------------------
#
# How each person likes the page, as settings in the database.


class StoredPreferences:
    """Reads and writes settings in the database. All methods wait for it: the event loop calls them in a thread."""

    def __init__(self, database: Database) -> None:
        self._database = database

    def load(self, person: User) -> Preferences:
        """Return how ``person`` likes the page; defaults for somebody new."""
        with self._database.reading() as session:
            stored = settings.newest(session, _name_preferences_setting(person))
        # what was stored before a preference existed lacks it
        return DEFAULT_PREFERENCES if stored is None else _parse_preferences(stored)

    def save(self, person: User, preferences: Preferences) -> Preferences:
        """Remember how ``person`` likes the page. Raises RequestRejectedError for a layout that cannot be drawn."""
        with self._database.reading() as session:
            known = formulas.ever(session)
        check_preferences(preferences.layouts, known)
        with self._database.session() as session:
            settings.save(session, _name_preferences_setting(person), preferences.model_dump(), person.name)
        return preferences


def _parse_preferences(stored: StoredSetting) -> Preferences:
    return Preferences.model_validate({**DEFAULT_PREFERENCES.model_dump(), **stored.value}, context=STORED_CONTEXT)


def _name_preferences_setting(person: User) -> str:
    # By name and role: whoever holds the viewers' token may give any name, and must not change an operator's page.
    name = person.given_name or person.name
    return f"preferences/{name}" if person.role is Role.OPERATOR else f"viewer-preferences/{name}"


# Run library ---------------------------------------------------------------------------------------
#
# Many runs: what they can be searched by, saved searches, tags, runs beside each other, a metric
# over their dates.


_SEARCH_PREFIX = "search/"


class RunLibrary:
    """Reads and writes the database. Saved searches are settings: what one was before stays there."""

    def __init__(self, database: Database) -> None:
        self._database = database

    def list_search_words(self) -> SearchWords:
        """Return what runs can be searched by."""
        with self._database.reading() as session:
            known = search.known_words(session)
        return SearchWords(
            station=self._database.station,
            stations=list(known.stations),
            fields=list(search.FIELDS),
            kinds=list(known.kinds),
            ends=list(ENDS),
            verdicts=list(VERDICTS),
            tags=list(known.tags),
            values={source: list(names) for source, names in known.values.items()},
        )

    def list_saved_searches(self) -> SavedSearchList:
        """Return the saved searches of the station."""
        with self._database.reading() as session:
            kept = settings.newest_under(session, _SEARCH_PREFIX)
        found = [
            SavedSearch(name=one.name.removeprefix(_SEARCH_PREFIX), where=one.value["where"], who=one.who)
            for one in kept
            if one.value is not None
        ]
        return SavedSearchList(searches=found)

    def find_saved_search(self, name: str) -> str:
        """Return the text of a saved search. Raises UnknownRecordError."""
        known = {one.name: one.where for one in self.list_saved_searches().searches}
        if name not in known:
            raise UnknownRecordError(f"there is no saved search {name!r}; there are: {', '.join(known) or 'none'}")
        return known[name]

    def save_search(self, name: str, where: str, who: str) -> SavedSearchList:
        """Save a search that can be asked now under a name. Raises QueryError, RequestRejectedError."""
        called = name.strip()
        if not 1 <= len(called) <= SEARCH_NAME_MAX:
            why = f"{called[:SEARCH_NAME_MAX]!r} is not 1 to {SEARCH_NAME_MAX} characters"
            raise RequestRejectedError(ErrorCode.BAD_VALUE, f"name of the search: {why}")
        try:
            check_single_line(called)
        except PlainTextError as error:
            raise RequestRejectedError(
                ErrorCode.BAD_VALUE, f"name of the search: {error}", code="bad_character"
            ) from None
        require_distinct_name("a saved search", called, (one.name for one in self.list_saved_searches().searches))
        query = parse_query(where)
        with self._database.session() as session:
            search.search(session, query, everywhere=False, limit=1)
            settings.save(session, f"{_SEARCH_PREFIX}{called}", {"where": where}, who)
        return self.list_saved_searches()

    def remove_search(self, name: str, who: str) -> SavedSearchList:
        """Take a search off the list; what it was stays in the database. Raises UnknownRecordError."""
        self.find_saved_search(name)
        with self._database.session() as session:
            settings.save(session, f"{_SEARCH_PREFIX}{name}", None, who)
        return self.list_saved_searches()

    def change_tags(self, run_ids: Sequence[int], put: Sequence[str], taken: Sequence[str]) -> None:
        """Put tags on runs and take others off, all or nothing. Raises TagError, UnknownRecordError."""
        with self._database.session() as session:
            for run_id in sorted(run_ids):  # in the order in which everybody locks them
                for one in put:
                    tags.add(session, run_id, one)
                for one in taken:
                    tags.take(session, run_id, one)

    def rename_tag(self, before: str, after: str) -> int:
        """Call a tag otherwise; return on how many runs. Raises TagError, UnknownRecordError."""
        with self._database.session() as session:
            return tags.rename(session, before, after)

    def compare_runs(self, asked: ComparisonRequest) -> RunComparison:
        """Set runs beside each other. Raises RequestRejectedError, UnknownRecordError."""
        with self._database.reading() as session:
            return comparison.compare_runs(session, asked)

    def build_metric_history(self, kind: str, metric: str, where: str, *, everywhere: bool) -> MetricHistory:
        """Return a metric of a kind of runs over their dates. Raises QueryError."""
        with self._database.reading() as session:
            return comparison.build_metric_history(session, kind, metric, where, everywhere=everywhere)
