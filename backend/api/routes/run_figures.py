"""Statistics, values, spectra and files of every sample of a range of a run."""

from typing import Annotated, Any

from fastapi import APIRouter, Depends, Query, Response
from fastapi.responses import StreamingResponse
from pydantic import Field

from backend.api.auth import SignedIn
from backend.api.routes.runs import download
from backend.api.service import RowId, ServiceInUse
from backend.archive.figures import RangeAsked
from backend.schemas.base import Finite, Schema
from backend.schemas.run import RecordedValues, SpectraLine, StatisticsLine

router = APIRouter(prefix="/api/runs", tags=["runs"])

CSV = "text/csv; charset=utf-8"
LINES = "application/x-ndjson"
"""Sent while the range is read: whoever waits sees how far it is, and who leaves ends the work."""

MOST_MOMENTS = 100


def _lines_of(model: type[Schema]) -> dict[str, Any]:
    """Return how a route is described whose answer is lines of JSON, each of this model; refusals are one body."""
    schema = {"$ref": f"#/components/schemas/{model.__name__}"}
    described: dict[int | str, dict[str, Any]] = {200: {"content": {LINES: {"schema": schema}}}}
    return {"response_class": Response, "response_model": model, "responses": described}


async def _range(
    id: RowId,
    from_s: Annotated[Finite, Query(alias="from", description="begin, from the run's first sample [s]")] = 0.0,
    to_s: Annotated[
        Finite | None, Query(alias="to", description="end [s], itself included; the run's end if left out")
    ] = None,
    signals: Annotated[str, Query(max_length=2000, description="names separated by commas")] = "q,q_ref,S,S_ref",
) -> RangeAsked:
    return RangeAsked(id, from_s, to_s, tuple(dict.fromkeys(signals.split(","))))


Range = Annotated[RangeAsked, Depends(_range)]
Times = Annotated[list[Finite], Field(min_length=1, max_length=MOST_MOMENTS)]


@router.get("/{id}/statistics", **_lines_of(StatisticsLine))
async def get_statistics(asked: Range, service: ServiceInUse, _person: SignedIn) -> Response:
    """Return statistics of every sample of a range: lines that tell how far it is, the result in the last one."""
    return StreamingResponse(await service.figures.statistics(asked), media_type=LINES)


@router.get("/{id}/spectra", **_lines_of(SpectraLine))
async def get_spectra(asked: Range, service: ServiceInUse, _person: SignedIn) -> Response:
    """Return spectra of every sample of a range (Welch's method): lines as ``statistics``."""
    return StreamingResponse(await service.figures.spectra(asked), media_type=LINES)


@router.get("/{id}/range.csv", response_class=Response, responses={200: {"content": {"text/csv": {}}}})
async def get_range_file(asked: Range, service: ServiceInUse, _person: SignedIn) -> Response:
    """Return every sample of a range as comma-separated text; values as ``data.csv`` has them."""
    end = "end" if asked.to_s is None else f"{asked.to_s:.3f}-s"
    name = f"sinew-run-{asked.run}-{asked.from_s:.3f}-to-{end}.csv"
    return download(await service.figures.file(asked), CSV, name)


@router.get("/{id}/values")
async def get_values(
    id: RowId,
    service: ServiceInUse,
    _person: SignedIn,
    at: Annotated[Times, Query(description="times since the run's first sample [s]")],
    signals: Annotated[str, Query(max_length=2000, description="names separated by commas")] = "q,q_ref,S,S_ref",
) -> RecordedValues:
    """Return the values of signals at the samples at or before some times."""
    return await service.figures.values(id, at, tuple(dict.fromkeys(signals.split(","))))
