"""Routes of banks and tuning."""

from typing import Annotated

from fastapi import APIRouter, Query, Request

from backend.api import messages
from backend.api.dependencies import ActuatorOperator, CurrentService, Operator, RowId, SignedInUser
from backend.errors import RequestRejectedError
from backend.schemas import (
    BankDetail,
    BankDifference,
    BankFile,
    BankList,
    BankRequest,
    BankView,
    Finite,
    Motion,
    MotorPreview,
    RobustTuning,
    RowNumber,
    SavedTuning,
    State,
    TrialRequest,
    TuningPreview,
    TuningRequest,
    TuningView,
)
from backend.server import ThreadRoute, in_thread
from plant import ErrorCode

# Banks ---------------------------------------------------------------------------------------------


banks_router = APIRouter(prefix="/api/banks", tags=["banks"], route_class=ThreadRoute)

OtherBank = Annotated[int | None, Query(ge=1, le=2**53, description="bank to compare with")]
NewRuns = Annotated[
    list[RowNumber] | None,
    Query(max_length=20, description="instead of another bank: new identification runs of operating points"),
]


@banks_router.post("", status_code=201)
def build_bank(body: BankRequest, service: CurrentService, person: Operator) -> BankView:
    """Build the next version of a bank from identification runs; rejects unusable ones."""
    return service.banks.build_bank(body.name, body.identifications, person.name)


@banks_router.get("")
async def list_banks(service: CurrentService, _person: SignedInUser) -> BankList:
    """List all versions of all banks, newest first."""
    service.banks.preload()
    return BankList(banks=await in_thread(service.banks.list_banks))


@banks_router.post("/file", status_code=201)
def import_bank(body: BankFile, service: CurrentService, person: Operator) -> BankView:
    """Store an exported bank as the next version of its name, after checking it."""
    return service.banks.import_bank(body, person.name)


@banks_router.get("/in-use/difference", summary="Compare With Active Bank")
async def compare_with_bank_in_use(
    service: CurrentService, _person: SignedInUser, other: OtherBank = None, run: NewRuns = None
) -> BankDifference:
    """Compare the active models and gains with another bank, or with new identifications."""
    bank = service.actuator.live_state.tuning.bank
    _require_one(other, run)
    return await service.banks.compute_difference(None if bank is None else bank.id, other, run or ())


@banks_router.get("/{id}")
def get_bank(id: RowId, service: CurrentService, _person: SignedInUser) -> BankView:
    """Return one version of a bank with its operating points."""
    return service.banks.load_bank(id)


@banks_router.get("/{id}/detail")
async def get_bank_detail(id: RowId, service: CurrentService, _person: SignedInUser) -> BankDetail:
    """Return gains, M_s and identification of every operating point, at the active λ."""
    return await service.banks.compute_detail(id)


@banks_router.get("/{id}/difference")
async def compare_banks(
    id: RowId, service: CurrentService, _person: SignedInUser, other: OtherBank = None, run: NewRuns = None
) -> BankDifference:
    """Compare a bank with another one, or with new identifications: models, gains, M_s."""
    _require_one(other, run)
    return await service.banks.compute_difference(id, other, run or ())


@banks_router.get("/{id}/file")
def export_bank(id: RowId, service: CurrentService, _person: SignedInUser) -> BankFile:
    """Return a bank as a file for another data folder."""
    return service.banks.export_bank(id)


@banks_router.post("/geometry/activate", summary="Activate Geometric Gains")
async def use_geometry(service: CurrentService, person: ActuatorOperator) -> TuningView:
    """Activate geometric gains without a bank; bumpless while the loop runs."""
    return await service.actuator.tuning_service.use_bank(None, person.name)


@banks_router.post("/{id}/activate")
async def activate_bank(id: RowId, service: CurrentService, person: ActuatorOperator) -> BankView:
    """Activate a bank; bumpless while the loop runs."""
    bank = await in_thread(service.banks.load_stored_bank, id)
    await service.actuator.tuning_service.use_bank(bank, person.name)
    return await in_thread(service.banks.load_bank, id)


def _require_one(other: int | None, run: list[int] | None) -> None:
    if (other is None) == (not run):
        raise RequestRejectedError(ErrorCode.BAD_VALUE, messages.bank_or_runs_needed())


# Tuning --------------------------------------------------------------------------------------------


LAM_PREVIEW_MIN = 0.05
"""Smallest λ of a preview [s]: loops become unstable well above it (erratum E6)."""

M_S_RANGE = (1.0, 2.0)
"""Range of the requested M_s: 1 is an open loop, 2 gives a phase margin of 29 degrees."""

tuning_router = APIRouter(prefix="/api/tuning", tags=["tuning"], route_class=ThreadRoute)


@tuning_router.get("")
async def get_tuning(service: CurrentService, _person: SignedInUser) -> TuningView:
    """Return the active tuning with its ranges."""
    live_state = service.actuator.live_state
    return live_state.tuning.view(live_state.entry)


@tuning_router.put("")
async def set_tuning(body: TuningRequest, service: CurrentService, person: ActuatorOperator) -> TuningView:
    """Change parts of the active tuning, bumpless while the loop runs; returns the active tuning."""
    return await service.actuator.tuning_service.apply(body, person.name)


@tuning_router.post("/undo")
async def undo_change(service: CurrentService, person: ActuatorOperator) -> TuningView:
    """Undo the last change of the active tuning, bank included; repeat for earlier changes."""
    return await service.actuator.tuning_service.undo(person.name)


@tuning_router.post("/redo")
async def redo_change(service: CurrentService, person: ActuatorOperator) -> TuningView:
    """Restore the change that the last undo reverted."""
    return await service.actuator.tuning_service.redo(person.name)


@tuning_router.post("/trial")
async def try_tuning(body: TrialRequest, service: CurrentService, person: ActuatorOperator) -> State:
    """Activate a tuning for a limited time; the service reverts it, even if the page is lost."""
    await service.actuator.tuning_service.start_trial(body, person.name)
    return service.state.view()


@tuning_router.delete("/trial")
async def revert_trial(service: CurrentService, person: ActuatorOperator) -> State:
    """End the trial and restore the tuning before it."""
    await service.actuator.tuning_service.end_trial(False, person.name)
    return service.state.view()


@tuning_router.post("/trial/keep", summary="Accept Trial Tuning")
async def keep_trial(service: CurrentService, person: ActuatorOperator) -> State:
    """Keep the tuning of the trial."""
    await service.actuator.tuning_service.end_trial(True, person.name)
    return service.state.view()


@tuning_router.get("/saved")
def get_saved_tuning(service: CurrentService, _person: SignedInUser) -> SavedTuning:
    """Return the tuning saved for the active bank; the defaults if none is saved."""
    return service.saved_tunings.load(service.actuator.live_state.tuning)


@tuning_router.put("/saved")
async def save_tuning(service: CurrentService, person: Operator) -> SavedTuning:
    """Save the active tuning for the active bank; rejected during a trial or a temporary tuning."""
    live_state = service.actuator.live_state
    if live_state.overridden_tuning is not None:
        raise RequestRejectedError(ErrorCode.NOT_NOW, messages.temporary_tuning_active())
    if service.actuator.tuning_service.view_trial() is not None:
        raise RequestRejectedError(ErrorCode.NOT_NOW, messages.trial_in_progress())
    return await in_thread(service.saved_tunings.save, live_state.tuning, person.name)


@tuning_router.get("/preview")
async def preview_tuning(
    request: Request,
    service: CurrentService,
    person: SignedInUser,
    lam_q: Annotated[Finite, Query(ge=LAM_PREVIEW_MIN, le=10.0, description="λ of the position loop [s]")],
    lam_S: Annotated[Finite, Query(ge=LAM_PREVIEW_MIN, le=10.0, description="λ of the stiffness loop [s]")],
    S: Annotated[Finite | None, Query(description="stiffness [N·m/rad]; default: the current reference")] = None,
    motion: Annotated[Motion | None, Query(description="how references are followed; default: the active one")] = None,
    u_plan: Annotated[
        Finite | None, Query(description="voltage limit of time-optimal motion [V]; default: the active one")
    ] = None,
    k_ext: Annotated[
        Finite | None, Query(description="gain of the disturbance rejection [1]; default: the active one")
    ] = None,
    printed: Annotated[bool, Query(description="whether to compute the printed formula (E1) as well")] = False,
) -> TuningPreview:
    """Predict M_s, margins, a step of each reference and the recovery from a push, at one stiffness."""
    return await service.actuator.tuning_service.preview(
        lam_q,
        lam_S,
        S,
        motion=motion,
        u_plan=u_plan,
        k_ext=k_ext,
        printed=printed,
        compute=service.texts.make_preview_runner(person, request.is_disconnected),
    )


@tuning_router.get("/motor", summary="Get Motor Margins")
async def motor_margins(
    request: Request,
    service: CurrentService,
    person: SignedInUser,
    lam_motor: Annotated[Finite, Query(gt=0.0, le=10.0, description="λ of the motor loops [s]")],
) -> MotorPreview:
    """Return M_s and margins of the sampled motor loop with L/R; rejects a λ out of range."""
    return await service.actuator.tuning_service.preview_motor(
        lam_motor, service.texts.make_preview_runner(person, request.is_disconnected)
    )


@tuning_router.get("/robust", summary="Get Robust Tuning")
async def robust_tuning(
    request: Request,
    service: CurrentService,
    person: SignedInUser,
    M_s: Annotated[Finite, Query(gt=M_S_RANGE[0], le=M_S_RANGE[1], description="largest permitted sensitivity peak")],
) -> RobustTuning:
    """Return the smallest λ of each loop whose M_s does not exceed the requested value, at the present λ_motor."""
    return await service.actuator.tuning_service.compute_robust_tuning(
        M_s, service.texts.make_preview_runner(person, request.is_disconnected)
    )
