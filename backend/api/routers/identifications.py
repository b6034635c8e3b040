"""Identification runs, and springs identified from tables."""

from fastapi import APIRouter, Request

from backend import __version__
from backend.analysis import fit_spring_table
from backend.api.dependencies import ActuatorOperator, CurrentService, Operator, RowId, SignedInUser
from backend.schemas import (
    ApplyRequest,
    IdentificationCurves,
    ParametersView,
    RowNumber,
    Trend,
    UndoRequest,
    ValidationView,
    identification,
)
from backend.server import ThreadRoute, in_thread
from backend.services import describe_identification_kinds

router = APIRouter(prefix="/api", tags=["identification"], route_class=ThreadRoute)


@router.post("/identifications", status_code=202, summary="Start Identification")
async def identify(
    body: identification.IdentificationRequest, service: CurrentService, person: ActuatorOperator
) -> identification.StartedRun:
    """Start an identification run; the state shows its progress, and the returned id identifies its result."""
    return identification.StartedRun(id=await service.ordered_runs.start_identification(body, person.name))


@router.put("/identifications/pause", summary="Pause Identifications")
async def pause(
    body: identification.PauseRequest, service: CurrentService, _person: ActuatorOperator
) -> identification.PauseRequest:
    """Pause before the next of several identifications, or continue; rejected without a next one."""
    service.ordered_runs.pause.request(body.paused)
    return body


@router.post("/identifications/prediction", summary="Predict Identification")
async def predict(
    request: Request, body: identification.IdentificationRequest, service: CurrentService, person: SignedInUser
) -> identification.Prediction:
    """Predict the joint motion of an identification before it starts."""
    return await service.ordered_runs.predict_identification(
        body, service.texts.make_preview_runner(person, request.is_disconnected)
    )


@router.get("/identifications")
def list_identifications(service: CurrentService, _person: SignedInUser) -> identification.IdentificationList:
    """List identification runs, newest first."""
    return identification.IdentificationList(identifications=service.identifications.list_identifications())


@router.get("/identification-kinds")
async def list_identification_kinds(
    service: CurrentService, _person: SignedInUser
) -> identification.IdentificationKindList:
    """List the kinds of identifications with their settings."""
    return identification.IdentificationKindList(kinds=describe_identification_kinds())


@router.get("/identifications/{id}")
def get_identification(id: RowId, service: CurrentService, _person: SignedInUser) -> identification.IdentificationView:
    """Return one identification run with its models."""
    return service.identifications.load_identification(id)


@router.get("/identifications/{id}/curves")
def get_identification_curves(id: RowId, service: CurrentService, _person: SignedInUser) -> IdentificationCurves:
    """Return the curves of an identification run: responses, residual tests, errors."""
    return service.identifications.build_curves(id)


@router.get("/identifications/{id}/unseen", summary="Validate Model")
async def get_unseen(id: RowId, of: RowNumber, service: CurrentService, _person: SignedInUser) -> ValidationView:
    """Compare a model with the recording of run `of`, or with the validation data of its own run."""
    return await service.identifications.validate(id, of)


@router.get("/identification-trend")
async def get_identification_trend(service: CurrentService, _person: SignedInUser) -> Trend:
    """Return gains and time constants versus S, with the predictions from geometry."""
    return await service.identifications.compute_trend()


@router.post("/spring-tables", status_code=201)
async def add_table(
    request: Request, body: identification.SpringTableRequest, service: CurrentService, person: Operator
) -> identification.SpringTableView:
    """Identify a spring from an imported table."""
    arguments = body.name, body.table, person.name, __version__, body.header, body.decimal
    new = await service.texts.run(person, request.is_disconnected, fit_spring_table, *arguments)
    return await in_thread(service.identifications.add_spring_table, new)


@router.get("/spring-tables")
def list_spring_tables(service: CurrentService, _person: SignedInUser) -> identification.SpringTableList:
    """List springs identified from tables, newest first."""
    return identification.SpringTableList(tables=service.identifications.list_spring_tables())


@router.get("/spring-tables/{id}")
def get_spring_table(id: RowId, service: CurrentService, _person: SignedInUser) -> identification.SpringTableView:
    """Return one spring identified from a table."""
    return service.identifications.load_spring_table(id)


@router.get("/spring-tables/{id}/curves")
def get_spring_table_curves(id: RowId, service: CurrentService, _person: SignedInUser) -> IdentificationCurves:
    """Return the curves of a spring identified from a table."""
    return service.identifications.build_spring_table_curves(id)


@router.get("/parameters")
def get_parameters(service: CurrentService, _person: SignedInUser, estimate: RowNumber | None = None) -> ParametersView:
    """Return the versions of the active parameters, and the effect of applying an estimate."""
    return service.parameter_service.build_view(estimate)


@router.post("/parameters")
async def apply_parameters(body: ApplyRequest, service: CurrentService, person: ActuatorOperator) -> ParametersView:
    """Activate identified motors or springs; in mode off only."""
    return await service.parameter_service.apply(body.estimate, person.name)


@router.post("/parameters/undo")
async def undo_parameters(body: UndoRequest, service: CurrentService, person: ActuatorOperator) -> ParametersView:
    """Activate the previous parameters again, as a new version; in mode off only."""
    return await service.parameter_service.undo(body.version, person.name)
