"""Routes of experiments, own experiments and studies."""

from typing import Annotated, Any

from fastapi import APIRouter, Path, Request

from backend.api.dependencies import ActuatorOperator, CurrentService, Operator, RowId, SignedInUser
from backend.experiments import build_json_schema
from backend.schemas import (
    CheckedExperiment,
    CheckedStudy,
    DryRunProgress,
    DryRunView,
    ExperimentCheckRequest,
    ExperimentKindList,
    ExperimentRequest,
    ExperimentText,
    ExperimentView,
    MapPick,
    OwnExperiment,
    OwnExperimentList,
    PlantNumbers,
    QueuePlace,
    QueueView,
    RecordedExperiment,
    StartedRun,
    StudyDetail,
    StudyList,
    StudyText,
    StudyView,
    WrittenExperiment,
)
from backend.server import ThreadRoute, in_thread

# Experiments ---------------------------------------------------------------------------------------


experiments_router = APIRouter(prefix="/api/experiments", tags=["experiments"], route_class=ThreadRoute)


@experiments_router.get("")
async def list_experiments(request: Request, service: CurrentService, person: SignedInUser) -> ExperimentKindList:
    """List the kinds of experiments with their settings and units."""
    return ExperimentKindList(
        experiments=await service.ordered_runs.list_experiment_kinds(person, request.is_disconnected)
    )


@experiments_router.post("", status_code=202)
async def start_experiment(body: ExperimentRequest, service: CurrentService, person: ActuatorOperator) -> StartedRun:
    """Start an experiment; the state shows its progress, and the returned id identifies its result."""
    return StartedRun(id=await service.ordered_runs.start_experiment(body, person.name))


@experiments_router.post("/dry-run")
async def dry_run_experiment(
    request: Request, body: ExperimentRequest, service: CurrentService, person: SignedInUser
) -> DryRunView:
    """Simulate an experiment of at most 10 min while the connection is open; one dry run per user."""
    return await service.ordered_runs.dry_run(body, person, request.is_disconnected)


@experiments_router.get("/dry-run/progress")
async def get_dry_run_progress(service: CurrentService, person: SignedInUser) -> DryRunProgress:
    """Return the progress of the user's dry run. To cancel a dry run, close its connection."""
    return await service.dry_runs.progress(person)


@experiments_router.get("/queue")
async def get_queue(service: CurrentService, _person: SignedInUser) -> QueueView:
    """Return the experiments in the queue."""
    return service.ordered_runs.queue.view()


@experiments_router.post("/queue", status_code=201)
async def add_to_queue(body: ExperimentRequest, service: CurrentService, person: Operator) -> QueueView:
    """Add an experiment to the end of the queue; it starts only while the queue runs."""
    return await service.ordered_runs.queue.add(body, person.name)


@experiments_router.post("/queue/run")
async def run_queue(service: CurrentService, _person: ActuatorOperator) -> QueueView:
    """Start the first experiment, and the next ones until one does not complete."""
    return await service.ordered_runs.queue.run()


@experiments_router.post("/queue/hold", summary="Pause Queue")
async def hold_queue(service: CurrentService, _person: Operator) -> QueueView:
    """Pause the queue after the current experiment."""
    return service.ordered_runs.queue.hold()


@experiments_router.put("/queue/{id}/place")
async def move_in_queue(id: RowId, body: QueuePlace, service: CurrentService, _person: Operator) -> QueueView:
    """Move a queued experiment to another position."""
    return await service.ordered_runs.queue.move(id, body.place)


@experiments_router.delete("/queue/{id}")
async def remove_from_queue(id: RowId, service: CurrentService, _person: Operator) -> QueueView:
    """Remove an experiment from the queue."""
    return await service.ordered_runs.queue.remove(id)


@experiments_router.get("/{id}")
def get_experiment(id: RowId, service: CurrentService, _person: SignedInUser) -> ExperimentView:
    """Return one experiment run with its metrics and criteria."""
    return service.runs.load_experiment(id)


# Own experiments -----------------------------------------------------------------------------------


own_experiments_router = APIRouter(prefix="/api/experiments", tags=["experiments"], route_class=ThreadRoute)
ExperimentName = Annotated[
    str, Path(max_length=60, description="built-in or stored experiment, or a version of a stored one: name@2")
]


@own_experiments_router.get("/schema")
async def get_experiment_schema(_person: SignedInUser) -> dict[str, Any]:
    """Return the JSON schema of an experiment."""
    return build_json_schema()


@own_experiments_router.get("/own")
async def list_own_experiments(request: Request, service: CurrentService, person: SignedInUser) -> OwnExperimentList:
    """List stored experiments with their newest version."""
    if not await in_thread(service.experiments.has_own):
        return OwnExperimentList(experiments=[])
    found = await service.texts.run(person, request.is_disconnected, service.experiments.list_own)
    return OwnExperimentList(experiments=found)


@own_experiments_router.post("/own", status_code=201, summary="Save Experiment")
async def keep_experiment(
    request: Request, body: ExperimentText, service: CurrentService, person: Operator
) -> OwnExperiment:
    """Store an experiment as the next version of its name, if it is valid on this plant."""
    return await service.ordered_runs.store_experiment(body.text, person, request.is_disconnected)


@own_experiments_router.post("/check")
async def check_experiment(
    request: Request, body: ExperimentCheckRequest, service: CurrentService, person: SignedInUser
) -> CheckedExperiment:
    """Check an experiment as at its start, optionally with a dry run; stores nothing."""
    return await service.ordered_runs.check_experiment(body, person, request.is_disconnected)


@own_experiments_router.get("/texts/{name}")
async def get_experiment_text(
    request: Request, name: ExperimentName, service: CurrentService, person: SignedInUser
) -> WrittenExperiment:
    """Return the text of an experiment, for a copy or for editing."""
    return await service.texts.run(person, request.is_disconnected, service.experiments.load_text, name)


@own_experiments_router.get("/own/{name}/versions")
async def list_versions(
    request: Request, name: ExperimentName, service: CurrentService, person: SignedInUser
) -> OwnExperimentList:
    """List the versions of a stored experiment, newest first, with author and time."""
    found = await service.texts.run(person, request.is_disconnected, service.experiments.list_versions, name)
    return OwnExperimentList(experiments=found)


@own_experiments_router.get("/as-run/{run_id}")
async def get_experiment_as_run(
    request: Request, run_id: RowId, service: CurrentService, person: SignedInUser
) -> RecordedExperiment:
    """Return a run as an experiment, with a list of what it does not repeat."""
    return await service.texts.run(person, request.is_disconnected, service.experiments.build_from_run, run_id)


# Studies -------------------------------------------------------------------------------------------


studies_router = APIRouter(prefix="/api/studies", tags=["studies"], route_class=ThreadRoute)


@studies_router.get("")
async def list_studies(service: CurrentService, _person: SignedInUser) -> StudyList:
    """List the newest studies with their progress."""
    return await service.studies.list_newest()


@studies_router.post("", status_code=201, summary="Start Study")
async def begin_study(body: StudyText, service: CurrentService, person: Operator) -> StudyView:
    """Store a study and compute it on the simulator in the background; nothing moves."""
    return await service.studies.start(body.text, person.name)


@studies_router.post("/check")
async def check_study(request: Request, body: StudyText, service: CurrentService, person: SignedInUser) -> CheckedStudy:
    """Return the parsed text, its number of runs and its problem, if any; stores nothing."""
    return await service.studies.check(body.text, person, request.is_disconnected)


@studies_router.get("/numbers")
async def list_plant_numbers(service: CurrentService, _person: SignedInUser) -> PlantNumbers:
    """List the plant parameters that a study can vary."""
    return service.studies.list_plant_numbers()


@studies_router.get("/{id}")
async def get_study(id: RowId, service: CurrentService, _person: SignedInUser, pick: MapPick = "worst") -> StudyDetail:
    """Return a study with its maps and the first rows of its table."""
    return await service.studies.build_detail(id, pick)


@studies_router.post("/{id}/stop")
async def stop_study(id: RowId, service: CurrentService, _person: Operator) -> StudyView:
    """Stop a study, in whichever process it runs; computed runs are kept."""
    return await service.studies.stop(id)


@studies_router.post("/{id}/resume")
async def resume_study(id: RowId, service: CurrentService, _person: Operator) -> StudyView:
    """Compute the missing runs of a study."""
    return await service.studies.resume(id)
