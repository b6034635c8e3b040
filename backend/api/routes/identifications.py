"""Identification runs, and springs identified from tables."""

from fastapi import APIRouter

from backend.api.auth import Operator, SignedIn
from backend.api.service import InControl, RowId, ServiceInUse
from backend.messages.base import RowNumber
from backend.messages.compared_models import Trend, UnseenView
from backend.messages.curves import IdentificationCurves
from backend.messages.identification import (
    IdentificationKindList,
    IdentificationList,
    IdentificationRequest,
    IdentificationView,
    Prediction,
    SpringTableList,
    SpringTableRequest,
    SpringTableView,
    Started,
)
from backend.operating.run_kinds import identification_kinds

router = APIRouter(prefix="/api", tags=["identification"])


@router.post("/identifications", status_code=202)
async def start_identification(body: IdentificationRequest, service: ServiceInUse, person: InControl) -> Started:
    """Start an identification run; its progress is in the state, its result under the returned id."""
    return Started(id=await service.ordered_runs.start_identification(body, person.name))


@router.post("/identifications/prediction")
async def predict_identification(body: IdentificationRequest, service: ServiceInUse, _person: SignedIn) -> Prediction:
    """Tell what joint motion a run would cause, before it starts."""
    return await service.ordered_runs.predict_identification(body)


@router.get("/identifications")
async def list_identifications(service: ServiceInUse, _person: SignedIn) -> IdentificationList:
    """List identification runs, newest first."""
    return IdentificationList(identifications=await service.identifications.identifications())


@router.get("/identification-kinds")
async def list_identification_kinds(service: ServiceInUse, _person: SignedIn) -> IdentificationKindList:
    """List what can be identified, with the settings of each."""
    return IdentificationKindList(kinds=identification_kinds())


@router.get("/identifications/{id}")
async def get_identification(id: RowId, service: ServiceInUse, _person: SignedIn) -> IdentificationView:
    """Return one identification run with its models."""
    return await service.identifications.identification(id)


@router.get("/identifications/{id}/curves")
async def get_identification_curves(id: RowId, service: ServiceInUse, _person: SignedIn) -> IdentificationCurves:
    """Return what can be drawn of an identification run: responses, residual tests, errors."""
    return await service.identifications.curves(id)


@router.get("/identifications/{id}/unseen")
async def get_unseen(id: RowId, of: RowNumber, service: ServiceInUse, _person: SignedIn) -> UnseenView:
    """Set a model beside the record of the run `of`, or the part of its own that it was not fitted to."""
    return await service.identifications.unseen(id, of)


@router.get("/identification-trend")
async def get_identification_trend(service: ServiceInUse, _person: SignedIn) -> Trend:
    """Return gains and lags over S beside what geometry predicts."""
    return await service.identifications.trend()


@router.post("/spring-tables", status_code=201)
async def add_spring_table(body: SpringTableRequest, service: ServiceInUse, person: Operator) -> SpringTableView:
    """Identify a spring from a table measured elsewhere."""
    return await service.identifications.add_spring_table(body.name, body.table, person.name)


@router.get("/spring-tables")
async def list_spring_tables(service: ServiceInUse, _person: SignedIn) -> SpringTableList:
    """List springs identified from tables, newest first."""
    return SpringTableList(tables=await service.identifications.spring_tables())


@router.get("/spring-tables/{id}")
async def get_spring_table(id: RowId, service: ServiceInUse, _person: SignedIn) -> SpringTableView:
    """Return one spring identified from a table."""
    return await service.identifications.spring_table(id)


@router.get("/spring-tables/{id}/curves")
async def get_spring_table_curves(id: RowId, service: ServiceInUse, _person: SignedIn) -> IdentificationCurves:
    """Return what can be drawn of a spring identified from a table."""
    return await service.identifications.spring_table_curves(id)
