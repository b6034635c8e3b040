"""The parts of a running service that routes call."""

from collections.abc import AsyncIterator
from dataclasses import dataclass
from typing import Annotated

from fastapi import Depends, Header, Path, Request
from starlette.requests import HTTPConnection

from backend.api.auth import Operator
from backend.archive.downloads import Downloads
from backend.archive.evaluations import Evaluations
from backend.archive.figures import RecordedFigures
from backend.archive.formulas import Formulas
from backend.archive.history import History
from backend.archive.maintenance import Maintenance
from backend.archive.own_experiments import OwnExperiments
from backend.archive.preferences import StoredPreferences
from backend.archive.replay import Replay
from backend.archive.retention import Retention
from backend.archive.run_library import RunLibrary
from backend.archive.stored_banks import StoredBanks
from backend.archive.stored_identifications import StoredIdentifications
from backend.archive.stored_runs import StoredRuns
from backend.archive.timeline import StoredTimeline
from backend.auth.authentication import Person
from backend.auth.control_lease import HEADER, Control, read_stamp
from backend.auth.handover import HandOver
from backend.operating.actuator import Actuator
from backend.operating.applied import Applied
from backend.operating.bring_up import BringUp
from backend.operating.chart_sheets import ChartSheets
from backend.operating.dry_runs import DryRuns
from backend.operating.live_stream import LiveStream
from backend.operating.ordered_runs import OrderedRuns
from backend.operating.refusals import Refusals
from backend.operating.saved_tunings import SavedTunings
from backend.operating.studies_under_way import StudiesUnderWay
from backend.operating.text_work import TextWork
from backend.operating.triggers import Triggers
from backend.operating.work_places import WorkPlaces
from backend.server.security import SHEETS
from backend.storage.database import Database

RowId = Annotated[int, Path(ge=1, le=2**53, description="identifier in the database")]


@dataclass(frozen=True)
class Service:
    """What the routes act on."""

    actuator: Actuator
    applied: Applied
    control: Control
    hand_over: HandOver
    ordered_runs: OrderedRuns
    experiments: OwnExperiments
    saved_tunings: SavedTunings
    bring_up: BringUp
    live: LiveStream
    refusals: Refusals
    runs: StoredRuns
    figures: RecordedFigures
    run_library: RunLibrary
    identifications: StoredIdentifications
    evaluations: Evaluations
    banks: StoredBanks
    preferences: StoredPreferences
    history: History
    timeline: StoredTimeline
    replay: Replay
    texts: TextWork
    sheets: ChartSheets
    dry_runs: DryRuns
    database: Database
    downloads: Downloads
    maintenance: Maintenance
    retention: Retention
    studies: StudiesUnderWay
    triggers: Triggers
    formulas: Formulas

    def places_for(self, method: str, path: str) -> WorkPlaces | None:
        """Return where a request takes its place before its body is read; None for one that needs none."""
        if method != "POST":
            return None
        return {
            SHEETS: self.sheets.places,
            "/api/experiments/check": self.texts.places,
            "/api/experiments/own": self.texts.places,
            "/api/studies/check": self.texts.places,
            "/api/spring-tables": self.texts.places,
            "/api/identifications/prediction": self.texts.previews,
            "/api/experiments/dry-run": self.dry_runs.places,
        }.get(path)


def service_of(connection: HTTPConnection) -> Service:
    """Return the running service."""
    service: Service = connection.app.state.service
    return service


async def _service_in_use(request: Request) -> Service:
    return service_of(request)


ServiceInUse = Annotated[Service, Depends(_service_in_use)]


Stamped = Annotated[
    str | None, Header(alias=HEADER, max_length=40, description="page.sequence of the page that holds control")
]


async def _holds_control(
    request: Request, service: ServiceInUse, person: Operator, stamp: Stamped = None
) -> AsyncIterator[Person]:
    request.state.commanding = person, await request.body()  # the log tells who asked for what, if it is refused
    async with service.control.turn(person, read_stamp(stamp)):
        yield person


HoldsControl = Annotated[Person, Depends(_holds_control, scope="function")]
"""An operator who holds control, of whatever is driven or played."""


async def _in_control(service: ServiceInUse, person: HoldsControl) -> Person:
    service.actuator.player.require_none()
    return person


InControl = Annotated[Person, Depends(_in_control, scope="function")]
"""An operator who holds control: only their commands move the actuator. Refused while a recording is played."""
