"""λ of the loops: read, set, preview."""

from typing import Annotated

from fastapi import APIRouter, Query

from backend.api.auth import Operator, SignedIn
from backend.api.schemas.base import Finite
from backend.api.schemas.tuning import TuningPreview, TuningRequest, TuningView
from backend.api.service import ServiceInUse

LAM_PREVIEW_MIN = 0.05
"""Shortest λ worth a preview [s]: the loop is unstable well above it (erratum E6)."""

router = APIRouter(prefix="/api/tuning", tags=["tuning"])


@router.get("")
async def get_tuning(service: ServiceInUse, _person: SignedIn) -> TuningView:
    """Return the tuning in force and its ranges."""
    picture = service.bench.picture
    return picture.tuning.view(picture.entry)


@router.put("")
async def set_tuning(body: TuningRequest, service: ServiceInUse, person: Operator) -> TuningView:
    """Change λ while the loop runs, bumpless; returns what is in force then."""
    return await service.bench.set_tuning(body, person.name)


@router.get("/preview")
async def preview_tuning(
    service: ServiceInUse,
    _person: SignedIn,
    lam_q: Annotated[Finite, Query(ge=LAM_PREVIEW_MIN, le=10.0, description="λ of the position loop [s]")],
    lam_S: Annotated[Finite, Query(ge=LAM_PREVIEW_MIN, le=10.0, description="λ of the stiffness loop [s]")],
) -> TuningPreview:
    """Predict step, M_s and margins of both outer loops on the high-order model of the active entry."""
    return await service.bench.preview(lam_q, lam_S)
