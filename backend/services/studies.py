"""Studies: stored, shown, and computed in worker processes."""

import asyncio
import logging
import time
from collections.abc import Callable, Mapping
from datetime import UTC, datetime
from typing import Any

from backend.auth import User
from backend.banks import TuningSettings
from backend.errors import InvalidValueError, RequestRejectedError
from backend.execution import make_bank_loader
from backend.experiments import LoopSettings, parser
from backend.models import Value, describe_settings
from backend.plain_text import escape_line
from backend.schemas import CheckedStudy, PlantNumber, PlantNumbers, StudyAxis, StudyDetail, StudyList, StudyView
from backend.services import record_messages
from backend.services.background_work import IsDisconnected, TextWork
from backend.services.library import OwnExperiments
from backend.storage import Database, StoredStudy, StudyPoint, studies
from backend.studies import (
    Design,
    Map,
    StudyContext,
    TakenError,
    count_cores,
    create_study,
    estimate_remaining_s,
    is_being_computed,
    list_variable_numbers,
    maps,
    parse_design,
    require_version,
    run_study,
    use_local_processes,
)
from backend.workers import WorkerDiedError, WorkerProcess
from plant import ErrorCode, PlantParameters

# Stored studies ------------------------------------------------------------------------------------


MAX_LISTED = 100
MAX_ROWS = 200
"""Rows of a table that the page gets; the command line shows all."""


class Studies:
    """Creates, reads and stops studies; ``backend.studies.runner`` computes them."""

    def __init__(self, database: Database) -> None:
        self._database = database

    def create(self, text: str, who: str, parameters: PlantParameters, tuning: Mapping[str, Value]) -> StudyView:
        """Store a new study with the present plant and tuning.

        Raises ExperimentError, SettingError.
        """
        own = OwnExperiments(self._database)
        new = create_study(
            text, StudyContext(own.find_definition, parameters, tuning, make_bank_loader(self._database)), who
        )
        with self._database.session() as session:
            stored = studies.add(session, new)
        return self.load_view(stored.id)

    def check(self, text: str, parameters: PlantParameters, tuning: Mapping[str, Value]) -> CheckedStudy:
        """Return the parsed text, and whether it is a valid study. Stores nothing."""
        document: dict[str, Any] | None = None
        try:
            parsed = parser.parse_document(text)[0]
            document = parsed if isinstance(parsed, dict) else None
            own = OwnExperiments(self._database)
            new = create_study(
                text, StudyContext(own.find_definition, parameters, tuning, make_bank_loader(self._database)), ""
            )
        except InvalidValueError as error:
            return CheckedStudy(document=document, points=None, problem=str(error), path=list(error.path))
        return CheckedStudy(document=document, points=new.points, problem="", path=[])

    def list_newest(self) -> list[StudyView]:
        """Return the newest studies, newest first."""
        with self._database.reading() as session:
            return [
                _build_view(stored, studies.states(session, stored.id))
                for stored in studies.newest(session, MAX_LISTED)
            ]

    def load_view(self, study_id: int) -> StudyView:
        """Return one study. Raises UnknownRecordError."""
        with self._database.reading() as session:
            return _build_view(studies.get(session, study_id), studies.states(session, study_id))

    def request_stop(self, study_id: int) -> StudyView:
        """Ask the process that computes a study to stop after its current runs.

        Raises UnknownRecordError.
        """
        with self._database.session() as session:
            studies.ask_to_stop(session, study_id)
        return self.load_view(study_id)

    def resume(self, study_id: int) -> StudyView:
        """Mark the missing runs of a study for computation.

        Raises UnknownRecordError, OtherSoftwareError, and TakenError while it is being stopped.
        """
        with self._database.session() as session:
            stored = studies.get(session, study_id)
            require_version(stored.base["software"])
            if stored.stop_asked and is_being_computed(stored):
                raise TakenError(stored)
            studies.want(session, study_id)
        return self.load_view(study_id)

    def build_detail(self, study_id: int, rows: int | None = MAX_ROWS, pick: str = maps.WORST) -> StudyDetail:
        """Return a study with its maps and the first rows of its table.

        ``pick`` selects the value of a cell with several runs; ``rows`` None returns all rows.
        """
        stored, points, design = self._load(study_id)
        named = maps.list_metric_names(parser.parse_canonical(design.base.experiment))
        figures = maps.summarize_distributions(points, named.values())
        axes = dict(design.axes)
        drawn = maps.choose_map_axes(axes)
        names = [item.name for item in figures] + (list(maps.SHARES) if points else [])
        shown = [] if drawn is None else [maps.build_map(points, axes, *drawn, name, pick) for name in names]
        return StudyDetail(
            study=self.load_view(study_id),
            text=stored.text,
            axes=[
                StudyAxis(
                    name=name,
                    symbol=get_axis_symbol(name, design),
                    unit=get_axis_unit(name, design),
                    values=list(values),
                )
                for name, values in design.axes
            ],
            shares=maps.compute_shares(points),
            figures=figures,
            maps=shown,
            rows=points[:rows],
        )

    def build_map(
        self, study_id: int, figure: str, pick: str, over: tuple[str, str] | None = None
    ) -> tuple[Map, Design]:
        """Return the map of a metric over two axes, and the design of the study.

        ``pick`` selects the value of a cell with several runs, ``over`` the axes x and y. Raises SettingError,
        UnknownRecordError.
        """
        _, points, design = self._load(study_id)
        axes = dict(design.axes)
        x, y = over or maps.choose_map_axes(axes) or ("", "")
        return maps.build_map(points=points, axes=axes, x=x, y=y, figure=figure, pick=pick), design

    def _load(self, study_id: int) -> tuple[StoredStudy, list[StudyPoint], Design]:
        with self._database.reading() as session:
            stored = studies.get(session, study_id)
            return stored, studies.points(session, study_id), parse_design(stored)


def _build_view(stored: StoredStudy, ends: dict[str, int]) -> StudyView:
    done, computed = sum(ends.values()), is_being_computed(stored)
    state = "done" if done == stored.points else "stopped"
    if computed:
        state = "stopping" if stored.stop_asked else "running"
    lasted_s = (datetime.now(UTC) - stored.begun_at).total_seconds() if stored.begun_at else 0.0
    return StudyView(
        id=stored.id,
        name=stored.name,
        title=escape_line(stored.title),
        who=stored.who,
        created=stored.created_at,
        state=state,
        points=stored.points,
        done=done,
        ends=ends,
        left_s=estimate_remaining_s(done, stored.begun_with, stored.points, lasted_s) if computed else None,
        problem=stored.problem
        or (record_messages.study_process_died() if stored.runner and state == "stopped" else ""),
    )


def get_axis_unit(name: str, design: Design) -> str:
    """Return the SI unit of a varied plant parameter or setting."""
    if "." in name:
        section, entry, *_ = name.split(".")
        return str(design.base.parameters[section][entry]["unit"])
    return _describe_axes(design).get(name, ("", "1"))[1]


def get_axis_symbol(name: str, design: Design) -> str:
    """Return the symbol of a varied setting; a plant parameter has its dotted name."""
    return _describe_axes(design).get(name, (name, ""))[0]


def _describe_axes(design: Design) -> dict[str, tuple[str, str]]:
    """Return symbol and unit of each setting of the experiment and of the loop."""
    settings = parser.parse_canonical(design.base.experiment).settings
    found = {item.name: (item.symbol or item.name, item.unit) for item in settings}
    return found | {item.name: (item.symbol, item.unit) for item in describe_settings(LoopSettings)}


# Study scheduler -----------------------------------------------------------------------------------
# Computes the studies of the page one after the other, in processes of low priority; one core is
# left to the loop and the service. An operator can resume a study that ended with the service.


_log = logging.getLogger(__name__)
WAITING = "waiting"
"""State of a study that waits for another one."""
MAX_WAITING = 20
"""Largest number of running and waiting studies."""
COMPUTING_STATES = ("running", "stopping")
REFRESH_FACTOR = 9.0
"""Pause between reads of a running study's table, in durations of a read.

A table of 100 000 rows takes seconds.
"""


class StudyScheduler:
    """Starts, stops and shows studies. Belongs to the service's event loop.

    Worker processes: ``computing`` for studies, ``reading`` for their tables, ``texts`` for texts of persons.
    ``tuning`` returns the active tuning, used by studies that name none.
    """

    def __init__(
        self,
        database: Database,
        parameters: PlantParameters,
        tuning: Callable[[], TuningSettings],
        computing: WorkerProcess,
        reading: WorkerProcess,
        texts: TextWork,
    ) -> None:
        self._database, self._parameters, self._tuning = database, parameters, tuning
        self._computing, self._reading, self._texts = computing, reading, texts
        self._studies = Studies(database)
        self._computing_lock, self._start_lock = asyncio.Lock(), asyncio.Lock()
        self._detail_cache: dict[tuple[int, str], tuple[float, StudyDetail]] = {}
        self._waiting: dict[int, asyncio.Task[None]] = {}
        self._running: dict[int, asyncio.Task[None]] = {}

    def set_parameters(self, parameters: PlantParameters) -> None:
        """Use these plant parameters for studies that start later."""
        self._parameters = parameters

    async def list_newest(self) -> StudyList:
        """Return the newest studies, newest first."""
        return StudyList(
            studies=[self._mark_waiting(study) for study in await asyncio.to_thread(self._studies.list_newest)]
        )

    async def build_detail(self, study_id: int, pick: str) -> StudyDetail:
        """Return a study with its maps and the first rows of its table.

        The table of a running study may be older, see REFRESH_FACTOR. Raises UnknownRecordError.
        """
        study = await asyncio.to_thread(self._studies.load_view, study_id)
        due, found = self._detail_cache.get((study_id, pick), (0.0, None))
        if found is None or study.state not in COMPUTING_STATES or time.monotonic() >= due:
            started = time.monotonic()
            found = await self._reading.run(_detail, self._database, study_id, pick)
            study, ended = found.study, time.monotonic()
            recent = {key: entry for key, entry in self._detail_cache.items() if entry[0] > ended}
            self._detail_cache = recent | {(study_id, pick): (ended + REFRESH_FACTOR * (ended - started), found)}
        return found.model_copy(update={"study": self._mark_waiting(study)})

    async def check(self, text: str, person: User, is_disconnected: IsDisconnected) -> CheckedStudy:
        """Return the parsed text, and whether it is a valid study.

        Raises RequestRejectedError if too many texts are being checked.
        """
        return await self._texts.run(
            person, is_disconnected, _check, self._database, text, self._parameters, self._tuning()
        )

    def list_plant_numbers(self) -> PlantNumbers:
        """Return the plant parameters that a study can vary."""
        return PlantNumbers(numbers=[PlantNumber(**vars(number)) for number in list_variable_numbers(self._parameters)])

    async def start(self, text: str, who: str) -> StudyView:
        """Store a study and schedule it.

        Raises ExperimentError, SettingError, and RequestRejectedError above MAX_WAITING.
        """
        async with self._start_lock:
            self._require_capacity()
            tuning = self._tuning()
            study = await self._texts.run_for_operator(_begin, self._database, text, who, self._parameters, tuning)
            return self._schedule(study)

    async def resume(self, study_id: int) -> StudyView:
        """Schedule the missing runs of a study.

        Raises UnknownRecordError, OtherSoftwareError, TakenError while it stops, and RequestRejectedError above
        MAX_WAITING.
        """
        async with self._start_lock:
            self._require_capacity()
            return self._schedule(await asyncio.to_thread(self._studies.resume, study_id))

    async def stop(self, study_id: int) -> StudyView:
        """Stop a study, whichever process computes it. Raises UnknownRecordError."""
        study = await asyncio.to_thread(self._studies.request_stop, study_id)
        due = self._waiting.pop(study_id, None)
        started = self._running.get(study_id) if study.state == "stopped" else None  # its process only comes up
        for task in (due, started):
            if task is not None:
                task.cancel()
                await asyncio.wait((task,))
        return self._mark_waiting(study)

    async def close(self) -> None:
        """Cancel all studies; computed runs stay stored."""
        tasks = [*self._waiting.values(), *self._running.values()]
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)

    def _require_capacity(self) -> None:
        if len(self._waiting) + len(self._running) >= MAX_WAITING:
            raise RequestRejectedError(ErrorCode.NOT_NOW, record_messages.too_many_studies(maximum=MAX_WAITING))

    def _schedule(self, study: StudyView) -> StudyView:
        if study.id not in self._waiting and study.state == "stopped":  # after its last attempt, where that only ends
            self._waiting[study.id] = asyncio.get_running_loop().create_task(self._compute(study.id))
        return self._mark_waiting(study)

    async def _compute(self, study_id: int) -> None:
        async with self._computing_lock:
            self._running[study_id] = self._waiting.pop(study_id)
            try:
                await self._computing.run(_compute, self._database, study_id)
            except WorkerDiedError as died:
                _log.warning("Study %s: %s", study_id, died)
            except Exception:  # the study stores the problem
                _log.exception("Study %s failed.", study_id)
            finally:
                del self._running[study_id]

    def _mark_waiting(self, study: StudyView) -> StudyView:
        """Return a scheduled study whose computation has not started as waiting."""
        under_way = study.id in self._waiting or study.id in self._running
        return study.model_copy(update={"state": WAITING}) if under_way and study.state == "stopped" else study


def _check(database: Database, text: str, parameters: PlantParameters, tuning: TuningSettings) -> CheckedStudy:
    return Studies(database).check(text, parameters, tuning.to_document())


def _begin(database: Database, text: str, who: str, parameters: PlantParameters, tuning: TuningSettings) -> StudyView:
    return Studies(database).create(text, who, parameters, tuning.to_document())


def _detail(database: Database, study_id: int, pick: str) -> StudyDetail:
    return Studies(database).build_detail(study_id, pick=pick)


def _compute(database: Database, study_id: int) -> None:
    run_study(database, study_id, use_local_processes(max(1, count_cores() - 1)))
