"""Studies that the page has computed: one after the other, in processes that give way to all others.

One core is left to the loop and the service. What ends with the service goes on where it was, when somebody resumes it.
"""

import asyncio
import logging
import time
from collections.abc import Callable

from backend.archive.studies import Studies
from backend.auth.authentication import Person
from backend.banks.tuning_settings import TuningChoice
from backend.departure import HasLeft
from backend.errors import Because, RefusalError
from backend.operating.text_work import TextWork
from backend.schemas.experiment import CheckedStudy, PlantNumber, PlantNumbers, StudyDetail, StudyList, StudyView
from backend.storage.database import Database
from backend.studies.crew import cores
from backend.studies.point import numbers_of
from backend.studies.runner import local, run_study
from backend.workers import Offload, WorkerDiedError
from plant.parameters import PlantParameters

_LOG = logging.getLogger(__name__)
WAITING = "waiting"
"""State of a study whose turn comes after that of another one."""
WAITING_MAX = 20
"""Studies under way or waiting, at most."""
COMPUTED = ("running", "stopping")
REST = 9.0
"""The table of a study that is computed is read anew after so many times what that takes: of 100 000 rows, seconds."""


class StudiesUnderWay:
    """Belongs to the service's event loop.

    ``computing`` has a process for studies, ``reading`` one for their tables, and ``texts`` those for what is written.

    ``tuning`` tells the one in force, which holds where a study names none.
    """

    def __init__(
        self,
        database: Database,
        parameters: PlantParameters,
        tuning: Callable[[], TuningChoice],
        computing: Offload,
        reading: Offload,
        texts: TextWork,
    ) -> None:
        self._database, self._parameters, self._tuning = database, parameters, tuning
        self._computing, self._reading, self._texts = computing, reading, texts
        self._kept = Studies(database)
        self._turn, self._door = asyncio.Lock(), asyncio.Lock()
        self._looked_at: dict[tuple[int, str], tuple[float, StudyDetail]] = {}
        self._waiting: dict[int, asyncio.Task[None]] = {}
        self._present: dict[int, asyncio.Task[None]] = {}

    def use(self, parameters: PlantParameters) -> None:
        """Begin studies around these parameters from now on."""
        self._parameters = parameters

    async def all(self) -> StudyList:
        """Return the newest studies, newest first."""
        return StudyList(studies=[self._told(study) for study in await asyncio.to_thread(self._kept.all)])

    async def detail(self, study_id: int, pick: str) -> StudyDetail:
        """Return a study with its maps, by ``pick``, and the first rows of its table. Raises UnknownRecordError.

        The table of one that is computed may be that of before, see REST.
        """
        study = await asyncio.to_thread(self._kept.view, study_id)
        due, found = self._looked_at.get((study_id, pick), (0.0, None))
        if found is None or study.state not in COMPUTED or time.monotonic() >= due:
            begun = time.monotonic()
            found = await self._reading.run(_detail, self._database, study_id, pick)
            study, ended = found.study, time.monotonic()
            resting = {other: kept for other, kept in self._looked_at.items() if kept[0] > ended}
            self._looked_at = resting | {(study_id, pick): (ended + REST * (ended - begun), found)}
        return found.model_copy(update={"study": self._told(study)})

    async def check(self, text: str, person: Person, has_left: HasLeft) -> CheckedStudy:
        """Return what a text says and whether it could be begun. Raises RefusalError where there is no place."""
        return await self._texts.run(person, has_left, _check, self._database, text, self._parameters, self._tuning())

    def numbers(self) -> PlantNumbers:
        """Return the numbers of the plant that a study can vary."""
        return PlantNumbers(numbers=[PlantNumber(**vars(number)) for number in numbers_of(self._parameters)])

    async def begin(self, text: str, who: str) -> StudyView:
        """Keep a study and have it computed. Raises ExperimentError, SettingError, RefusalError for one too many."""
        async with self._door:
            self._require_place()
            tuning = self._tuning()
            study = await self._texts.order(_begin, self._database, text, who, self._parameters, tuning)
            return self._have_computed(study)

    async def resume(self, study_id: int) -> StudyView:
        """Have computed what is missing.

        Raises UnknownRecordError, OtherSoftwareError, TakenError while it stops, RefusalError for one too many.
        """
        async with self._door:
            self._require_place()
            return self._have_computed(await asyncio.to_thread(self._kept.resume, study_id))

    async def stop(self, study_id: int) -> StudyView:
        """Have a study stop, whoever computes it. Raises UnknownRecordError."""
        study = await asyncio.to_thread(self._kept.stop, study_id)
        due = self._waiting.pop(study_id, None)
        begun = self._present.get(study_id) if study.state == "stopped" else None  # its process only comes up
        for task in (due, begun):
            if task is not None:
                task.cancel()
                await asyncio.wait((task,))
        return self._told(study)

    async def close(self) -> None:
        """Let go of all; what is computed is kept."""
        tasks = [*self._waiting.values(), *self._present.values()]
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)

    def _require_place(self) -> None:
        if len(self._waiting) + len(self._present) >= WAITING_MAX:
            raise RefusalError(Because.NOT_NOW, f"{WAITING_MAX} studies wait already: stop one of them first")

    def _have_computed(self, study: StudyView) -> StudyView:
        if study.id not in self._waiting and study.state == "stopped":  # after its last attempt, where that only ends
            self._waiting[study.id] = asyncio.get_running_loop().create_task(self._compute(study.id))
        return self._told(study)

    async def _compute(self, study_id: int) -> None:
        async with self._turn:
            self._present[study_id] = self._waiting.pop(study_id)
            try:
                await self._computing.run(_compute, self._database, study_id)
            except WorkerDiedError as died:
                _LOG.warning("study %s: %s", study_id, died)
            except Exception:  # the study says what it was
                _LOG.exception("study %s could not be computed", study_id)
            finally:
                del self._present[study_id]

    def _told(self, study: StudyView) -> StudyView:
        """Return a study that nobody computes yet as one that waits, where that is so."""
        under_way = study.id in self._waiting or study.id in self._present
        return study.model_copy(update={"state": WAITING}) if under_way and study.state == "stopped" else study


def _check(database: Database, text: str, parameters: PlantParameters, tuning: TuningChoice) -> CheckedStudy:
    return Studies(database).check(text, parameters, tuning.document())


def _begin(database: Database, text: str, who: str, parameters: PlantParameters, tuning: TuningChoice) -> StudyView:
    return Studies(database).begin(text, who, parameters, tuning.document())


def _detail(database: Database, study_id: int, pick: str) -> StudyDetail:
    return Studies(database).detail(study_id, pick=pick)


def _compute(database: Database, study_id: int) -> None:
    run_study(database, study_id, local(max(1, cores() - 1)))
