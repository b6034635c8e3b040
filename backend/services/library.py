"""Libraries of a station: own experiments, preferences, saved searches, tags."""

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
from backend.services import comparison, record_messages
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


@dataclass(frozen=True)
class ExperimentCheck:
    """A checked experiment with default settings, before it is stored or started.

    Can be pickled for another process, unlike an ExperimentDefinition.
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
        """Return the check for the page, with its metrics on the simulator.

        ``not_predicted`` is the reason why it was not simulated.
        """
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
    """Reads, checks and stores experiments; storing a known name adds a version."""

    def __init__(self, database: Database) -> None:
        self._database = database

    def list_definitions(self) -> list[ExperimentDefinition]:
        """Return all experiments: the ready-made, then own ones in their newest version."""
        with self._database.reading() as session:
            own = stored.newest(session)
        ready_made = (entry for entry in experiments_by_name().values() if not entry.replacement)
        return [
            *ready_made,
            *(entry for stored_item in own if (entry := _try_build_definition(stored_item)) is not None),
        ]

    def list_own(self) -> list[OwnExperiment]:
        """Return the newest version of each own experiment."""
        with self._database.reading() as session:
            return [build_own_experiment(stored_item) for stored_item in stored.newest(session)]

    def list_versions(self, name: str) -> list[OwnExperiment]:
        """Return all versions of an own experiment, newest first; none for a wrong name."""
        with self._database.reading() as session:
            return [build_own_experiment(stored_item) for stored_item in stored.versions(session, name)]

    def has_own(self) -> bool:
        """Whether any own experiment is stored."""
        with self._database.reading() as session:
            return bool(stored.newest(session))

    def build_plan(
        self, name: str, in_force: LoopSettings, settings: Mapping[str, Any]
    ) -> tuple[str, Plan, LoopSettings]:
        """Return name with version, plan and loop settings of a requested experiment.

        ``in_force`` are the loop settings where ``settings`` name none. Raises SettingError, OutOfRangeError,
        ExperimentError.
        """
        entry = self.find_definition(name)
        return entry.name, *split_values(
            entry.settings, entry.make_plan, {**asdict(in_force), **complete_motion(settings)}
        )

    def load_text(self, name: str) -> WrittenExperiment:
        """Return an experiment as its text; "name@2" is a version of an own one.

        Raises UnknownRecordError.
        """
        text = library.load_ready_text(name) if name in library.READY_NAMES else self._load_stored(name).text
        return WrittenExperiment(text=text, document=parser.parse_document(text, stored=True)[0])

    def build_from_run(self, run_id: int) -> RecordedExperiment:
        """Return the recorded references of a run as an experiment.

        Raises UnknownRecordError, ExperimentError.
        """
        return build_recorded_experiment(self._database, run_id)

    def find_definition(self, name: str) -> ExperimentDefinition:
        """Return the experiment of a name: ready-made, own, or "name@2".

        Raises SettingError with the known names, and ExperimentError for the text of an earlier version that is not
        valid now.
        """
        if name in experiments_by_name():
            return ready(name)
        try:
            stored_item = self._load_stored(name)
        except UnknownRecordError:
            known = tuple(entry.name for entry in self.list_definitions())
            raise SettingError("name", name, record_messages.unknown_experiment(known=known), legal=known) from None
        return _build_definition(stored_item)

    def check_and_store(
        self, text: str, who: str, parameters: PlantParameters, tuning: TuningSettings
    ) -> StoredExperiment:
        """Check an experiment and store it. Raises ExperimentError."""
        return self.store(self.check(text, parameters, tuning), text, who)

    def store(self, checked: ExperimentCheck, text: str, who: str) -> StoredExperiment:
        """Store a checked experiment as the next version of its name."""
        with self._database.session() as session:
            return stored.add(session, checked.name, text, who)

    def check(self, text: str, parameters: PlantParameters, tuning: TuningSettings) -> ExperimentCheck:
        """Check an experiment completely, without moving anything.

        Raises ExperimentError with line and bound.
        """
        experiment, lines = parser.parse_experiment(text)
        if fold_name(experiment.name) in map(fold_name, experiments_by_name()):
            reason = record_messages.name_of_ready_made_experiment(name=experiment.name)
            raise ExperimentError(reason, ("name",), find_line(("name",), lines))
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
            document=parser.parse_document(text)[0],
            parts=list_played_parts(plan.compiled),
        )

    def _load_stored(self, name: str) -> StoredExperiment:
        base, _, number = name.partition("@")
        has_version = number.isdecimal() and len(number) < 10
        with self._database.reading() as session:
            return stored.get(session, base, int(number)) if has_version else stored.get(session, name)


def build_own_experiment(stored_item: StoredExperiment, title: str | None = None) -> OwnExperiment:
    """Return an own experiment for the list; without ``title`` its text is parsed."""
    if title is None:
        entry = _try_build_definition(stored_item)
        title = "" if entry is None else entry.title
    return OwnExperiment(
        name=stored_item.name,
        version=stored_item.version,
        title=title,
        who=stored_item.who,
        created=stored_item.created_at,
    )


def _build_definition(stored_item: StoredExperiment) -> ExperimentDefinition:
    experiment, lines = parser.parse_experiment(stored_item.text, stored=True)
    return build_experiment_definition(experiment, lines, name=f"{stored_item.name}@{stored_item.version}")


def _try_build_definition(stored_item: StoredExperiment) -> ExperimentDefinition | None:
    """Return the definition of an own experiment, None if this version rejects it."""
    try:
        return _build_definition(stored_item)
    except ExperimentError:
        return None


# Preferences ---------------------------------------------------------------------------------------


class StoredPreferences:
    """Stores each person's preferences for the page as settings in the database.

    All methods wait for the database: the event loop calls them in a thread.
    """

    def __init__(self, database: Database) -> None:
        self._database = database

    def load(self, person: User) -> Preferences:
        """Return the preferences of a person; defaults for a new one."""
        with self._database.reading() as session:
            stored = settings.newest(session, _name_preferences_setting(person))
        return DEFAULT_PREFERENCES if stored is None else _parse_preferences(stored)

    def save(self, person: User, preferences: Preferences) -> Preferences:
        """Store the preferences of a person.

        Raises RequestRejectedError for a layout that cannot be drawn.
        """
        with self._database.reading() as session:
            known = formulas.ever(session)
        check_preferences(preferences.layouts, known)
        with self._database.session() as session:
            settings.save(session, _name_preferences_setting(person), preferences.model_dump(), person.name)
        return preferences


def _parse_preferences(stored: StoredSetting) -> Preferences:
    # preferences that were added after the setting was stored have their defaults
    return Preferences.model_validate({**DEFAULT_PREFERENCES.model_dump(), **stored.value}, context=STORED_CONTEXT)


def _name_preferences_setting(person: User) -> str:
    # By name and role: a viewer may enter any name, and must not change an operator's preferences.
    name = person.given_name or person.name
    return f"preferences/{name}" if person.role is Role.OPERATOR else f"viewer-preferences/{name}"


# Run library ---------------------------------------------------------------------------------------


_SEARCH_PREFIX = "search/"


class RunLibrary:
    """Searches, tags and compares runs. Earlier versions of a search stay stored."""

    def __init__(self, database: Database) -> None:
        self._database = database

    def list_search_words(self) -> SearchWords:
        """Return the fields and values by which runs can be searched."""
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
            stored_item = settings.newest_under(session, _SEARCH_PREFIX)
        found = [
            SavedSearch(name=one.name.removeprefix(_SEARCH_PREFIX), where=one.value["where"], who=one.who)
            for one in stored_item
            if one.value is not None
        ]
        return SavedSearchList(searches=found)

    def find_saved_search(self, name: str) -> str:
        """Return the text of a saved search. Raises UnknownRecordError."""
        known = {one.name: one.where for one in self.list_saved_searches().searches}
        if name not in known:
            raise UnknownRecordError(record_messages.no_saved_search(name=name, known=list(known)))
        return known[name]

    def save_search(self, name: str, where: str, who: str) -> SavedSearchList:
        """Store a valid search under a name. Raises QueryError, RequestRejectedError."""
        shown_name = name.strip()
        if not 1 <= len(shown_name) <= SEARCH_NAME_MAX:
            raise RequestRejectedError(
                ErrorCode.BAD_VALUE, record_messages.length_of_search_name(name=shown_name, maximum=SEARCH_NAME_MAX)
            )
        try:
            check_single_line(shown_name)
        except PlainTextError as error:
            message = record_messages.invalid_search_name(reason=error.message)
            raise RequestRejectedError(ErrorCode.BAD_VALUE, message, code="bad_character") from None
        require_distinct_name("a saved search", shown_name, (one.name for one in self.list_saved_searches().searches))
        query = parse_query(where)
        with self._database.session() as session:
            search.search(session, query, everywhere=False, limit=1)
            settings.save(session, f"{_SEARCH_PREFIX}{shown_name}", {"where": where}, who)
        return self.list_saved_searches()

    def remove_search(self, name: str, who: str) -> SavedSearchList:
        """Remove a search from the list; its versions stay in the database.

        Raises UnknownRecordError.
        """
        self.find_saved_search(name)
        with self._database.session() as session:
            settings.save(session, f"{_SEARCH_PREFIX}{name}", None, who)
        return self.list_saved_searches()

    def change_tags(self, run_ids: Sequence[int], added: Sequence[str], removed: Sequence[str]) -> None:
        """Add tags to runs and remove others; on an error, change nothing.

        Raises TagError, UnknownRecordError.
        """
        with self._database.session() as session:
            for run_id in sorted(run_ids):  # always the same order of locks
                for tag in added:
                    tags.add(session, run_id, tag)
                for tag in removed:
                    tags.take(session, run_id, tag)

    def rename_tag(self, before: str, after: str) -> int:
        """Rename a tag; return the number of runs. Raises TagError, UnknownRecordError."""
        with self._database.session() as session:
            return tags.rename(session, before, after)

    def compare_runs(self, query: ComparisonRequest) -> RunComparison:
        """Return the metrics of runs with their differences.

        Raises RequestRejectedError, UnknownRecordError.
        """
        with self._database.reading() as session:
            return comparison.compare_runs(session, query)

    def build_metric_history(self, kind: str, metric: str, where: str, *, everywhere: bool) -> MetricHistory:
        """Return a metric of all runs of a kind over their dates. Raises QueryError."""
        with self._database.reading() as session:
            return comparison.build_metric_history(session, kind, metric, where, everywhere=everywhere)
