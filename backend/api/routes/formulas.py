"""Derived signals by formula."""

from typing import Annotated

from fastapi import APIRouter, Path

from backend.api.auth import Operator, SignedIn
from backend.api.service import ServiceInUse
from backend.schemas.state import FormulaList, FormulaName, FormulaText, FormulaView

router = APIRouter(prefix="/api", tags=["runs"])

Named = Annotated[FormulaName, Path(description="name of the derived signal")]


@router.get("/formulas")
async def list_formulas(service: ServiceInUse, _person: SignedIn) -> FormulaList:
    """List the derived signals of the station, by name, with the steps that compute them."""
    return await service.formulas.all()


@router.put("/formulas/{name}")
async def put_formula(name: Named, body: FormulaText, service: ServiceInUse, person: Operator) -> FormulaView:
    """Write a derived signal, or change the one of this name."""
    return await service.formulas.put(name, body, person.name)


@router.delete("/formulas/{name}", status_code=204)
async def remove_formula(name: Named, service: ServiceInUse, person: Operator) -> None:
    """Remove a derived signal; recordings stay as they are."""
    await service.formulas.remove(name, person.name)
