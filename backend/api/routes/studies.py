"""Studies: begun from a text, followed, stopped and resumed."""

from fastapi import APIRouter, Request

from backend.api.auth import Operator, SignedIn
from backend.api.service import RowId, ServiceInUse
from backend.schemas.experiment import CheckedStudy, MapPick, PlantNumbers, StudyDetail, StudyList, StudyText, StudyView

router = APIRouter(prefix="/api/studies", tags=["studies"])


@router.get("")
async def list_studies(service: ServiceInUse, _person: SignedIn) -> StudyList:
    """List the newest studies, and how far each is."""
    return await service.studies.all()


@router.post("", status_code=201)
async def begin_study(body: StudyText, service: ServiceInUse, person: Operator) -> StudyView:
    """Keep a study and have it computed beside the loop, on the simulator; it moves nothing."""
    return await service.studies.begin(body.text, person.name)


@router.post("/check")
async def check_study(request: Request, body: StudyText, service: ServiceInUse, person: SignedIn) -> CheckedStudy:
    """Return what a text says as plain data, how many runs it has and whether it would be refused; nothing is kept."""
    return await service.studies.check(body.text, person, request.is_disconnected)


@router.get("/numbers")
async def list_plant_numbers(service: ServiceInUse, _person: SignedIn) -> PlantNumbers:
    """List the numbers of the plant that a study can vary."""
    return service.studies.numbers()


@router.get("/{id}")
async def get_study(id: RowId, service: ServiceInUse, _person: SignedIn, pick: MapPick = "worst") -> StudyDetail:
    """Return a study with its maps and the first rows of its table."""
    return await service.studies.detail(id, pick)


@router.post("/{id}/stop")
async def stop_study(id: RowId, service: ServiceInUse, _person: Operator) -> StudyView:
    """Have a study stop, whoever computes it; what is computed stays."""
    return await service.studies.stop(id)


@router.post("/{id}/resume")
async def resume_study(id: RowId, service: ServiceInUse, _person: Operator) -> StudyView:
    """Have computed what a study lacks."""
    return await service.studies.resume(id)
