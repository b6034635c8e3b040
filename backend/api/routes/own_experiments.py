"""Experiments as texts: the form, those there are, looking one over, keeping one."""

import asyncio
from typing import Annotated, Any

from fastapi import APIRouter, Path, Request

from backend.api.auth import Operator, SignedIn
from backend.api.service import RowId, ServiceInUse
from backend.documents.experiment import schema
from backend.messages.own_experiment import (
    CheckedExperiment,
    ExperimentText,
    ExperimentToCheck,
    OwnExperiment,
    OwnExperimentList,
    WrittenExperiment,
)

router = APIRouter(prefix="/api/experiments", tags=["experiments"])
ExperimentName = Annotated[str, Path(max_length=60, description="ready-made, own, or a version of an own one: name@2")]


@router.get("/schema")
async def get_experiment_schema(_person: SignedIn) -> dict[str, Any]:
    """Return the JSON schema of an experiment."""
    return schema()


@router.get("/own")
async def list_own_experiments(service: ServiceInUse, _person: SignedIn) -> OwnExperimentList:
    """List own experiments, the newest version of each."""
    return OwnExperimentList(experiments=await asyncio.to_thread(service.experiments.views))


@router.post("/own", status_code=201)
async def keep_experiment(body: ExperimentText, service: ServiceInUse, person: Operator) -> OwnExperiment:
    """Keep an experiment as the next version of its name; one that could not be played here is refused."""
    return await service.ordered_runs.keep_experiment(body.text, person.name)


@router.post("/check")
async def check_experiment(
    request: Request, body: ExperimentToCheck, service: ServiceInUse, person: SignedIn
) -> CheckedExperiment:
    """Look an experiment over as a start would, played dry for its peaks where asked; nothing is kept."""
    return await service.ordered_runs.check_experiment(body, person, request.is_disconnected)


@router.get("/texts/{name}")
async def get_experiment_text(name: ExperimentName, service: ServiceInUse, _person: SignedIn) -> WrittenExperiment:
    """Return an experiment as the text that it is, to keep it elsewhere or to begin an own one with."""
    return await asyncio.to_thread(service.experiments.written, name)


@router.get("/own/{name}/versions")
async def list_versions(name: ExperimentName, service: ServiceInUse, _person: SignedIn) -> OwnExperimentList:
    """List the versions of an own experiment, the newest first: who kept each, and when."""
    return OwnExperimentList(experiments=await asyncio.to_thread(service.experiments.versions, name))


@router.get("/as-run/{run_id}")
async def get_experiment_as_run(run_id: RowId, service: ServiceInUse, _person: SignedIn) -> WrittenExperiment:
    """Return the references of a run, as they were commanded, as an experiment to begin an own one with."""
    return await asyncio.to_thread(service.experiments.as_run, run_id)
