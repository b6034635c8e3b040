"""Experiments as texts: the form, those there are, looking one over, keeping one."""

import asyncio
from typing import Annotated, Any

from fastapi import APIRouter, Path, Request

from backend.api.auth import Operator, SignedIn
from backend.api.service import RowId, ServiceInUse
from backend.experiments.schema import schema
from backend.schemas.experiment import (
    CheckedExperiment,
    ExperimentText,
    ExperimentToCheck,
    OwnExperiment,
    OwnExperimentList,
    RecordedExperiment,
    WrittenExperiment,
)

router = APIRouter(prefix="/api/experiments", tags=["experiments"])
ExperimentName = Annotated[str, Path(max_length=60, description="ready-made, own, or a version of an own one: name@2")]


@router.get("/schema")
async def get_experiment_schema(_person: SignedIn) -> dict[str, Any]:
    """Return the JSON schema of an experiment."""
    return schema()


@router.get("/own")
async def list_own_experiments(request: Request, service: ServiceInUse, person: SignedIn) -> OwnExperimentList:
    """List own experiments, the newest version of each."""
    if not await asyncio.to_thread(service.experiments.has_own):
        return OwnExperimentList(experiments=[])
    found = await service.texts.run(person, request.is_disconnected, service.experiments.views)
    return OwnExperimentList(experiments=found)


@router.post("/own", status_code=201)
async def keep_experiment(
    request: Request, body: ExperimentText, service: ServiceInUse, person: Operator
) -> OwnExperiment:
    """Keep an experiment as the next version of its name; one that could not be played here is refused."""
    return await service.ordered_runs.keep_experiment(body.text, person, request.is_disconnected)


@router.post("/check")
async def check_experiment(
    request: Request, body: ExperimentToCheck, service: ServiceInUse, person: SignedIn
) -> CheckedExperiment:
    """Look an experiment over as a start would, played dry for its peaks where asked; nothing is kept."""
    return await service.ordered_runs.check_experiment(body, person, request.is_disconnected)


@router.get("/texts/{name}")
async def get_experiment_text(
    request: Request, name: ExperimentName, service: ServiceInUse, person: SignedIn
) -> WrittenExperiment:
    """Return an experiment as the text that it is, to keep it elsewhere or to begin an own one with."""
    return await service.texts.run(person, request.is_disconnected, service.experiments.written, name)


@router.get("/own/{name}/versions")
async def list_versions(
    request: Request, name: ExperimentName, service: ServiceInUse, person: SignedIn
) -> OwnExperimentList:
    """List the versions of an own experiment, the newest first: who kept each, and when."""
    found = await service.texts.run(person, request.is_disconnected, service.experiments.versions, name)
    return OwnExperimentList(experiments=found)


@router.get("/as-run/{run_id}")
async def get_experiment_as_run(
    request: Request, run_id: RowId, service: ServiceInUse, person: SignedIn
) -> RecordedExperiment:
    """Return a run as an experiment to begin an own one with, and what of the run it does not repeat."""
    return await service.texts.run(person, request.is_disconnected, service.experiments.as_run, run_id)
