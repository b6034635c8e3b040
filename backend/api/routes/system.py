"""Machine, timing, disk, database; backups; room for recordings."""

from fastapi import APIRouter

from backend.api.auth import Operator, SignedIn
from backend.api.service import ServiceInUse
from backend.schemas.state import BackupView, DatabaseCheck, RecordingsView, RemovalRequest, SystemView

router = APIRouter(prefix="/api/system", tags=["system"])


@router.get("")
async def get_system(service: ServiceInUse, _person: SignedIn) -> SystemView:
    """Return what was granted to the loop, how late its ticks are, versions, disk, database and its backups."""
    return await service.maintenance.view()


@router.post("/check")
async def check_database(service: ServiceInUse, _person: Operator) -> DatabaseCheck:
    """Check the whole database while it is in use."""
    return await service.maintenance.check()


@router.post("/backups", status_code=201)
async def make_backup(service: ServiceInUse, person: Operator) -> BackupView:
    """Copy the database to the data folder while it is in use; `sinew db restore` brings a copy back."""
    return await service.maintenance.backup(person.name)


@router.get("/recordings")
async def get_recordings(service: ServiceInUse, _person: SignedIn) -> RecordingsView:
    """Return how much recordings take, and the runs whose samples may go."""
    return await service.retention.view()


@router.post("/recordings/removal")
async def remove_recordings(request: RemovalRequest, service: ServiceInUse, person: Operator) -> RecordingsView:
    """Delete the samples of exactly these runs; refused as a whole unless each of them may go now."""
    return await service.retention.remove(request.runs, person.name)
