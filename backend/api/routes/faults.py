"""The faults there are, and injecting them into a simulated plant."""

from fastapi import APIRouter

from backend.api.auth import SignedIn
from backend.api.service import InControl, ServiceInUse
from backend.operating.fault_injection import fault_list, inject, mend
from backend.schemas.state import FaultList, Injection

router = APIRouter(prefix="/api/faults", tags=["faults"])


@router.get("")
async def list_faults(_person: SignedIn, service: ServiceInUse) -> FaultList:
    """List all faults with message, remedy, and what brings them about on what is driven."""
    return fault_list(service.actuator.present.plant)


@router.post("/injection", status_code=204)
async def inject_fault(body: Injection, service: ServiceInUse, person: InControl) -> None:
    """Break a part of a simulated plant or a link of the safety chain; refused on any other."""
    await inject(service.actuator, service.control, body, person.name)


@router.delete("/injection", status_code=204)
async def mend_fault(service: ServiceInUse, person: InControl) -> None:
    """Mend what was broken; the latched fault stays until it is reset."""
    await mend(service.actuator, person.name)
