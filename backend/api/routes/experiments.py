"""Experiments: the kinds, starting one, its result."""

from fastapi import APIRouter

from backend.api.auth import Operator, SignedIn
from backend.api.schemas.experiment import ExperimentKindList, ExperimentRequest, ExperimentView
from backend.api.schemas.identification import Started
from backend.api.service import RowId, ServiceInUse

router = APIRouter(prefix="/api/experiments", tags=["experiments"])


@router.get("")
async def list_experiments(service: ServiceInUse, _person: SignedIn) -> ExperimentKindList:
    """List the kinds of experiments with their settings and units."""
    return ExperimentKindList(experiments=service.tasks.experiment_kinds())


@router.post("", status_code=202)
async def start_experiment(body: ExperimentRequest, service: ServiceInUse, person: Operator) -> Started:
    """Start an experiment; its progress is in the state, its result under the returned id."""
    return Started(id=await service.tasks.start_experiment(body, person.name))


@router.get("/{id}")
async def get_experiment(id: RowId, service: ServiceInUse, _person: SignedIn) -> ExperimentView:
    """Return one experiment run with its metrics and criteria."""
    return await service.library.experiment(id)
