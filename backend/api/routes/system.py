"""Machine, timing, disk, database; backups."""

from fastapi import APIRouter

from backend.api.auth import Operator, SignedIn
from backend.api.schemas.system import BackupView, DatabaseCheck, SystemView
from backend.api.service import ServiceInUse

router = APIRouter(prefix="/api/system", tags=["system"])


@router.get("")
async def get_system(service: ServiceInUse, _person: SignedIn) -> SystemView:
    """Return what was granted to the loop, how late its ticks are, versions, disk, database and its backups."""
    return await service.upkeep.view()


@router.post("/check")
async def check_database(service: ServiceInUse, _person: Operator) -> DatabaseCheck:
    """Check the whole database while it is in use."""
    return await service.upkeep.check()


@router.post("/backups", status_code=201)
async def make_backup(service: ServiceInUse, _person: Operator) -> BackupView:
    """Copy the database to the data folder while it is in use; `sinew db restore` brings a copy back."""
    return await service.upkeep.backup()
