"""Identification runs and the banks built from them."""

from fastapi import APIRouter

from backend.api.auth import Operator, SignedIn
from backend.api.schemas.identification import (
    BankList,
    BankRequest,
    BankView,
    IdentificationList,
    IdentificationRequest,
    IdentificationView,
    Prediction,
    Started,
)
from backend.api.service import InControl, RowId, ServiceInUse

router = APIRouter(prefix="/api", tags=["identification"])


@router.post("/identifications", status_code=202)
async def start_identification(body: IdentificationRequest, service: ServiceInUse, person: InControl) -> Started:
    """Start an identification run; its progress is in the state, its result under the returned id."""
    return Started(id=await service.tasks.start_identification(body, person.name))


@router.post("/identifications/prediction")
async def predict_identification(body: IdentificationRequest, service: ServiceInUse, _person: SignedIn) -> Prediction:
    """Tell what joint motion a run would cause, before it starts."""
    return await service.tasks.predict_identification(body)


@router.get("/identifications")
async def list_identifications(service: ServiceInUse, _person: SignedIn) -> IdentificationList:
    """List identification runs, newest first."""
    return IdentificationList(identifications=await service.library.identifications())


@router.get("/identifications/{id}")
async def get_identification(id: RowId, service: ServiceInUse, _person: SignedIn) -> IdentificationView:
    """Return one identification run with its models."""
    return await service.library.identification(id)


@router.post("/banks", status_code=201)
async def build_bank(body: BankRequest, service: ServiceInUse, person: Operator) -> BankView:
    """Build a bank, or a new version of it, from identification runs."""
    return await service.library.build_bank(body.name, body.identifications, person.name)


@router.get("/banks")
async def list_banks(service: ServiceInUse, _person: SignedIn) -> BankList:
    """List all versions of all banks, newest first."""
    return BankList(banks=await service.library.banks())


@router.get("/banks/{id}")
async def get_bank(id: RowId, service: ServiceInUse, _person: SignedIn) -> BankView:
    """Return one version of a bank with its entries."""
    return await service.library.bank(id)


@router.post("/banks/{id}/activate")
async def activate_bank(id: RowId, service: ServiceInUse, person: InControl) -> BankView:
    """Use a bank from now on; bumpless while the loop runs."""
    await service.bench.use_bank(await service.library.stored_bank(id), person.name)
    return await service.library.bank(id)
