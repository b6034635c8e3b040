"""λ of the loops: read, set, preview."""

from typing import Annotated

from fastapi import APIRouter, Query, Request

from backend.api.auth import Operator, SignedIn
from backend.api.service import InControl, ServiceInUse
from backend.errors import Because, RefusalError
from backend.schemas.base import Finite
from backend.schemas.state import State
from backend.schemas.tuning import (
    Motion,
    MotorPreview,
    RobustTuning,
    SavedTuning,
    TrialRequest,
    TuningPreview,
    TuningRequest,
    TuningView,
)

LAM_PREVIEW_MIN = 0.05
"""Shortest λ worth a preview [s]: the loop is unstable well above it (erratum E6)."""

M_S_RANGE = (1.0, 2.0)
"""Sensitivity peaks worth asking for: 1 is an open loop, 2 leaves a phase margin of 29 degrees."""

router = APIRouter(prefix="/api/tuning", tags=["tuning"])


@router.get("")
async def get_tuning(service: ServiceInUse, _person: SignedIn) -> TuningView:
    """Return the tuning in force and its ranges."""
    present = service.actuator.present
    return present.tuning.view(present.entry)


@router.put("")
async def set_tuning(body: TuningRequest, service: ServiceInUse, person: InControl) -> TuningView:
    """Change λ while the loop runs, bumpless; returns what is in force then."""
    return await service.actuator.retuning.set(body, person.name)


@router.post("/undo")
async def undo_change(service: ServiceInUse, person: InControl) -> TuningView:
    """Undo the last change of what is in force, λ, b, bank and all; undone twice, it is in force again."""
    return await service.actuator.retuning.undo(person.name)


@router.post("/trial")
async def try_tuning(body: TrialRequest, service: ServiceInUse, person: InControl) -> State:
    """Try a tuning for some seconds; the service puts the earlier one back by itself, also when the page is gone."""
    return await service.actuator.retuning.try_out(body, person.name)


@router.delete("/trial")
async def revert_trial(service: ServiceInUse, person: InControl) -> State:
    """Put the tuning before the trial back at once."""
    return await service.actuator.retuning.end_trial(False, person.name)


@router.post("/trial/keep")
async def keep_trial(service: ServiceInUse, person: InControl) -> State:
    """Keep what is on trial."""
    return await service.actuator.retuning.end_trial(True, person.name)


@router.get("/saved")
async def get_saved_tuning(service: ServiceInUse, _person: SignedIn) -> SavedTuning:
    """Return the tuning saved for the bank in use, to compare with what is in force."""
    return await service.saved_tunings.of(service.actuator.present.tuning)


@router.put("/saved")
async def save_tuning(service: ServiceInUse, person: Operator) -> SavedTuning:
    """Save what is in force for the bank in use. Refused while a tuning is on trial or lent to a run."""
    present = service.actuator.present
    if present.own_tuning is not None:
        raise RefusalError(Because.NOT_NOW, "what is in force belongs to a run: save when it is over")
    if present.trial() is not None:
        raise RefusalError(Because.NOT_NOW, "a tuning is on trial: keep it or revert it before saving")
    return await service.saved_tunings.save(present.tuning, person.name)


@router.get("/preview")
async def preview_tuning(
    request: Request,
    service: ServiceInUse,
    person: SignedIn,
    lam_q: Annotated[Finite, Query(ge=LAM_PREVIEW_MIN, le=10.0, description="λ of the position loop [s]")],
    lam_S: Annotated[Finite, Query(ge=LAM_PREVIEW_MIN, le=10.0, description="λ of the stiffness loop [s]")],
    S: Annotated[Finite | None, Query(description="stiffness [N·m/rad]; default: of the present reference")] = None,
    motion: Annotated[Motion | None, Query(description="how references are followed; default: active")] = None,
    u_plan: Annotated[
        Finite | None, Query(description="voltage limit of time-optimal motion [V]; default: active")
    ] = None,
    k_ext: Annotated[Finite | None, Query(description="share of a push fed forward [1]; default: in force")] = None,
    printed: Annotated[bool, Query(description="whether to compute the printed formula (E1) as well")] = False,
) -> TuningPreview:
    """Predict M_s, margins, a step of each reference and the recovery from a push, at one stiffness."""
    return await service.actuator.retuning.preview(
        lam_q,
        lam_S,
        S,
        motion=motion,
        u_plan=u_plan,
        k_ext=k_ext,
        printed=printed,
        compute=service.texts.previewing(person, request.is_disconnected),
    )


@router.get("/motor")
async def motor_margins(
    request: Request,
    service: ServiceInUse,
    person: SignedIn,
    lam_motor: Annotated[Finite, Query(gt=0.0, le=10.0, description="λ of the motor loops [s]")],
) -> MotorPreview:
    """Tell M_s and margins of the motor loop as it runs, sampled and with L/R; a λ that is not offered is refused."""
    return await service.actuator.retuning.motor(lam_motor, service.texts.previewing(person, request.is_disconnected))


@router.get("/robust")
async def robust_tuning(
    request: Request,
    service: ServiceInUse,
    person: SignedIn,
    M_s: Annotated[Finite, Query(gt=M_S_RANGE[0], le=M_S_RANGE[1], description="wanted maximum of the sensitivity")],
) -> RobustTuning:
    """Find the smallest λ of each loop that is as robust as wanted; lam_q and lam_S for λ_motor as it is."""
    return await service.actuator.retuning.robust(M_s, service.texts.previewing(person, request.is_disconnected))
