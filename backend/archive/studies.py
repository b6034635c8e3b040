"""Studies as they are kept and shown: begun from a text, listed, asked to stop, their tables and maps."""

from collections.abc import Mapping
from datetime import UTC, datetime
from typing import Any

from backend.archive.own_experiments import OwnExperiments
from backend.errors import RefusedValueError
from backend.execution.runner import banks_in
from backend.experiments import parser
from backend.experiments.plans import LoopSettings
from backend.models.run import Value
from backend.models.settings import describe
from backend.plain_text import as_line
from backend.schemas.experiment import (
    CheckedStudy,
    StudyAxis,
    StudyDetail,
    StudyFigure,
    StudyMap,
    StudyPoint,
    StudyShare,
    StudyView,
)
from backend.storage import studies
from backend.storage.database import Database
from backend.storage.studies import StoredPoint, StoredStudy
from backend.studies import maps
from backend.studies.design import Design
from backend.studies.maps import Map
from backend.studies.point import require_version
from backend.studies.runner import TakenError, is_computed, left_s
from backend.studies.stored import Surroundings, design_of, new_study
from plant.parameters import PlantParameters

LISTED = 100
_GONE = "who computed it died without a word: resume it, what is computed is kept"
"""Of a study that nobody computes although nobody has let go of it: killed, or its machine lost."""
ROWS_SHOWN = 200
"""Rows of a table that the page is given; the command line has all."""


class Studies:
    """Reads and keeps them; what computes them is ``backend.studies.runner``."""

    def __init__(self, database: Database) -> None:
        self._database = database

    def begin(self, written: str, who: str, parameters: PlantParameters, tuning: Mapping[str, Value]) -> StudyView:
        """Keep a study, with the plant and the tuning as they are now. Raises ExperimentError, SettingError."""
        own = OwnExperiments(self._database)
        new = new_study(written, Surroundings(own.entry, parameters, tuning, banks_in(self._database)), who)
        with self._database.session() as session:
            kept = studies.add(session, new)
        return self.view(kept.id)

    def check(self, written: str, parameters: PlantParameters, tuning: Mapping[str, Value]) -> CheckedStudy:
        """Return what a text says, and whether it is a study that could be begun. Nothing is kept."""
        document: dict[str, Any] | None = None
        try:
            said = parser.document_of(written)[0]
            document = said if isinstance(said, dict) else None
            own = OwnExperiments(self._database)
            new = new_study(written, Surroundings(own.entry, parameters, tuning, banks_in(self._database)), "")
        except RefusedValueError as error:
            return CheckedStudy(document=document, points=None, problem=str(error), path=list(error.path))
        return CheckedStudy(document=document, points=new.points, problem="", path=[])

    def all(self) -> list[StudyView]:
        """Return the newest studies, newest first."""
        with self._database.reading() as session:
            return [_view(kept, studies.states(session, kept.id)) for kept in studies.newest(session, LISTED)]

    def view(self, study_id: int) -> StudyView:
        """Return one. Raises UnknownRecordError."""
        with self._database.reading() as session:
            return _view(studies.get(session, study_id), studies.states(session, study_id))

    def stop(self, study_id: int) -> StudyView:
        """Have whoever computes it stop when the runs in hand are done. Raises UnknownRecordError."""
        with self._database.session() as session:
            studies.ask_to_stop(session, study_id)
        return self.view(study_id)

    def resume(self, study_id: int) -> StudyView:
        """Have what is missing computed by whoever comes. Raises UnknownRecordError, OtherSoftwareError, TakenError."""
        with self._database.session() as session:
            kept = studies.get(session, study_id)
            require_version(kept.base["software"])
            if kept.stop_asked and is_computed(kept):
                raise TakenError(kept)
            studies.want(session, study_id)
        return self.view(study_id)

    def detail(self, study_id: int, rows: int | None = ROWS_SHOWN, pick: str = maps.WORST) -> StudyDetail:
        """Return a study with its maps, by ``pick``, and the first rows of its table; all ``rows`` for None."""
        kept, points, design = self._read(study_id)
        named = maps.figure_names(parser.of_canonical(design.base.experiment))
        spread = {item.figure: item for item in maps.spreadings(points, tuple(named))}
        figures = [
            StudyFigure(**vars(named[name]), **{of: value for of, value in vars(item).items() if of != "figure"})
            for name, item in spread.items()
        ]
        axes = dict(design.axes)
        drawn = maps.axes_to_draw(axes)
        shown = (
            []
            if drawn is None
            else [maps.map_of(points, axes, *drawn, name, pick) for name in (*spread, *(maps.SHARES if points else ()))]
        )
        return StudyDetail(
            study=self.view(study_id),
            text=kept.text,
            axes=[
                StudyAxis(name=name, symbol=symbol_of(name, design), unit=unit_of(name, design), values=list(values))
                for name, values in design.axes
            ],
            shares=[StudyShare(label=maps.SHARES[item.name].label, **vars(item)) for item in maps.shares(points)],
            figures=figures,
            maps=[_map_view(item) for item in shown],
            rows=[_point_view(point) for point in points[:rows]],
        )

    def map(self, study_id: int, figure: str, pick: str, over: tuple[str, str] | None = None) -> tuple[Map, Design]:
        """Return the map of a figure, by ``pick``, ``over`` x and y. Raises SettingError, UnknownRecordError."""
        _, points, design = self._read(study_id)
        axes = dict(design.axes)
        x, y = over or maps.axes_to_draw(axes) or ("", "")
        return maps.map_of(points, axes, x, y, figure, pick), design

    def _read(self, study_id: int) -> tuple[StoredStudy, list[StoredPoint], Design]:
        with self._database.reading() as session:
            kept = studies.get(session, study_id)
            return kept, studies.points(session, study_id), design_of(kept)


def _view(kept: StoredStudy, ends: dict[str, int]) -> StudyView:
    done, computed = sum(ends.values()), is_computed(kept)
    state = "done" if done == kept.points else "stopped"
    if computed:
        state = "stopping" if kept.stop_asked else "running"
    lasted_s = (datetime.now(UTC) - kept.begun_at).total_seconds() if kept.begun_at else 0.0
    return StudyView(
        id=kept.id,
        name=kept.name,
        title=as_line(kept.title),
        who=kept.who,
        created=kept.created_at,
        state=state,
        points=kept.points,
        done=done,
        ends=ends,
        left_s=left_s(done, kept.begun_with, kept.points, lasted_s) if computed else None,
        problem=kept.problem or (_GONE if kept.runner and state == "stopped" else ""),
    )


def _map_view(drawn: Map) -> StudyMap:
    return StudyMap(
        figure=drawn.figure,
        pick=drawn.pick,
        x=drawn.x,
        y=drawn.y,
        cells=[list(row) for row in drawn.cells],
        unstable=[list(row) for row in drawn.unstable],
        counts=[list(row) for row in drawn.counts],
        runs=[list(row) for row in drawn.runs],
        intervals=[[None if ends is None else list(ends) for ends in row] for row in drawn.intervals],
    )


def _point_view(point: StoredPoint) -> StudyPoint:
    return StudyPoint(**vars(point))


def unit_of(name: str, design: Design) -> str:
    """Return the SI unit of what is varied: a number of the plant, or a setting."""
    if "." in name:
        section, entry, *_ = name.split(".")
        return str(design.base.parameters[section][entry]["unit"])
    return _settings(design).get(name, ("", "1"))[1]


def symbol_of(name: str, design: Design) -> str:
    """Return the symbol of a setting that is varied; a number of the plant has its section and entry."""
    return _settings(design).get(name, (name, ""))[0]


def _settings(design: Design) -> dict[str, tuple[str, str]]:
    """Symbol and unit of each setting of the experiment and of the loop, by name."""
    written = parser.of_canonical(design.base.experiment).settings
    found = {item.name: (item.symbol or item.name, item.unit) for item in written}
    return found | {item.name: (item.symbol, item.unit) for item in describe(LoopSettings)}
