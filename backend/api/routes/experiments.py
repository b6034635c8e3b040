"""Experiments: the kinds, starting one, its result."""

from fastapi import APIRouter, Request

from backend.api.auth import Operator, SignedIn
from backend.api.service import InControl, RowId, ServiceInUse
from backend.schemas.experiment import (
    DryRunProgress,
    DryRunView,
    ExperimentKindList,
    ExperimentRequest,
    ExperimentView,
    QueuePlace,
    QueueView,
)
from backend.schemas.identification import Started

router = APIRouter(prefix="/api/experiments", tags=["experiments"])


@router.get("")
async def list_experiments(request: Request, service: ServiceInUse, person: SignedIn) -> ExperimentKindList:
    """List the kinds of experiments with their settings and units."""
    return ExperimentKindList(experiments=await service.ordered_runs.experiment_kinds(person, request.is_disconnected))


@router.post("", status_code=202)
async def start_experiment(body: ExperimentRequest, service: ServiceInUse, person: InControl) -> Started:
    """Start an experiment; its progress is in the state, its result under the returned id."""
    return Started(id=await service.ordered_runs.start_experiment(body, person.name))


@router.post("/dry-run")
async def dry_run_experiment(
    request: Request, body: ExperimentRequest, service: ServiceInUse, person: SignedIn
) -> DryRunView:
    """Play an experiment on a simulator of its own, one per person, 10 min at most, while the connection stands."""
    return await service.ordered_runs.dry_run(body, person, request.is_disconnected)


@router.get("/dry-run/progress")
async def get_dry_run_progress(service: ServiceInUse, person: SignedIn) -> DryRunProgress:
    """Return how far one's own dry run is; closing the connection that asked for it ends it."""
    return await service.dry_runs.progress(person)


@router.get("/queue")
async def get_queue(service: ServiceInUse, _person: SignedIn) -> QueueView:
    """Return the experiments that wait for their turn."""
    return service.ordered_runs.queue.view()


@router.post("/queue", status_code=201)
async def add_to_queue(body: ExperimentRequest, service: ServiceInUse, person: Operator) -> QueueView:
    """Put an experiment at the end of the queue; nothing starts before the queue is run."""
    return await service.ordered_runs.queue.add(body, person.name)


@router.post("/queue/run")
async def run_queue(service: ServiceInUse, _person: InControl) -> QueueView:
    """Start the first experiment and go on until the queue is empty or one does not complete."""
    return await service.ordered_runs.queue.run()


@router.post("/queue/hold")
async def hold_queue(service: ServiceInUse, _person: Operator) -> QueueView:
    """Start no further experiment; the one under way goes on."""
    return service.ordered_runs.queue.hold()


@router.put("/queue/{id}/place")
async def move_in_queue(id: RowId, body: QueuePlace, service: ServiceInUse, _person: Operator) -> QueueView:
    """Let a waiting experiment wait at another place."""
    return await service.ordered_runs.queue.move(id, body.place)


@router.delete("/queue/{id}")
async def remove_from_queue(id: RowId, service: ServiceInUse, _person: Operator) -> QueueView:
    """Take a waiting experiment out of the queue."""
    return await service.ordered_runs.queue.remove(id)


@router.get("/{id}")
async def get_experiment(id: RowId, service: ServiceInUse, _person: SignedIn) -> ExperimentView:
    """Return one experiment run with its metrics and criteria."""
    return await service.runs.experiment(id)
