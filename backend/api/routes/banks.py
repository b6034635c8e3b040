"""Banks: built from identification runs, compared, activated, taken out and brought in."""

from typing import Annotated

from fastapi import APIRouter, Query

from backend.api.auth import Operator, SignedIn
from backend.api.service import InControl, RowId, ServiceInUse
from backend.errors import Because, RefusalError
from backend.schemas.base import RowNumber
from backend.schemas.tuning import BankDetail, BankDifference, BankFile, BankList, BankRequest, BankView, TuningView

router = APIRouter(prefix="/api/banks", tags=["banks"])

OtherBank = Annotated[int | None, Query(ge=1, le=2**53, description="bank to compare with")]
Again = Annotated[
    list[RowNumber] | None,
    Query(max_length=20, description="in place of another bank: runs that identified points again"),
]


@router.post("", status_code=201)
async def build_bank(body: BankRequest, service: ServiceInUse, person: Operator) -> BankView:
    """Build a bank, or a new version of it, from identification runs; entries that do not fit are refused."""
    return await service.banks.build(body.name, body.identifications, person.name)


@router.get("")
async def list_banks(service: ServiceInUse, _person: SignedIn) -> BankList:
    """List all versions of all banks, newest first."""
    return BankList(banks=await service.banks.banks())


@router.post("/file", status_code=201)
async def import_bank(body: BankFile, service: ServiceInUse, person: Operator) -> BankView:
    """Store an exported bank as the next version of its name, after checking it."""
    return await service.banks.bring_in(body, person.name)


@router.get("/in-use/difference")
async def compare_with_bank_in_use(
    service: ServiceInUse, _person: SignedIn, other: OtherBank = None, run: Again = None
) -> BankDifference:
    """Tell what another bank, or points identified again, would change about the models and gains in use."""
    bank = service.actuator.present.tuning.bank
    _require_one(other, run)
    return await service.banks.difference(None if bank is None else bank.id, other, run or ())


@router.get("/{id}")
async def get_bank(id: RowId, service: ServiceInUse, _person: SignedIn) -> BankView:
    """Return one version of a bank with its entries."""
    return await service.banks.bank(id)


@router.get("/{id}/detail")
async def get_bank_detail(id: RowId, service: ServiceInUse, _person: SignedIn) -> BankDetail:
    """Return gains and M_s of every entry at the λ in force, and the identification each came from."""
    return await service.banks.detail(id)


@router.get("/{id}/difference")
async def compare_banks(
    id: RowId, service: ServiceInUse, _person: SignedIn, other: OtherBank = None, run: Again = None
) -> BankDifference:
    """Tell what another bank, or points identified again, would change: models, gains and M_s at the λ in force."""
    _require_one(other, run)
    return await service.banks.difference(id, other, run or ())


@router.get("/{id}/file")
async def export_bank(id: RowId, service: ServiceInUse, _person: SignedIn) -> BankFile:
    """Return a bank as a file, to take it to another data folder."""
    return await service.banks.file(id)


@router.post("/geometry/activate")
async def use_geometry(service: ServiceInUse, person: InControl) -> TuningView:
    """Use gains from the plant's geometry from now on, no bank; bumpless while the loop runs."""
    return await service.actuator.retuning.use_bank(None, person.name)


@router.post("/{id}/activate")
async def activate_bank(id: RowId, service: ServiceInUse, person: InControl) -> BankView:
    """Use a bank from now on; bumpless while the loop runs."""
    await service.actuator.retuning.use_bank(await service.banks.stored_bank(id), person.name)
    return await service.banks.bank(id)


def _require_one(other: int | None, run: list[int] | None) -> None:
    if (other is None) == (not run):
        raise RefusalError(Because.BAD_VALUE, "give either another bank or runs that identified points again")
