"""Statistics, values, spectra and files of every sample of a range of a run."""

from typing import Annotated

from fastapi import APIRouter, Depends, Query, Response
from fastapi.responses import StreamingResponse
from pydantic import Field

from backend.api.auth import SignedIn
from backend.api.routes.runs import download
from backend.api.service import RowId, ServiceInUse
from backend.archive.figures import RangeAsked
from backend.messages.base import Finite
from backend.messages.figures import RecordedValues, SpectraLine, StatisticsLine

router = APIRouter(prefix="/api/runs", tags=["runs"])

CSV = "text/csv; charset=utf-8"
MOST_MOMENTS = 100


class Lines(StreamingResponse):
    """Lines of JSON, sent while the range is read: whoever waits sees how far it is; leaving ends the work."""

    media_type = "application/x-ndjson"


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


@router.get("/{id}/statistics", response_class=Lines, responses={200: {"model": StatisticsLine}})
async def get_statistics(asked: Range, service: ServiceInUse, _person: SignedIn) -> Response:
    """Return statistics of every sample of a range: lines that tell how far it is, the result in the last one."""
    return Lines(await service.figures.statistics(asked))


@router.get("/{id}/spectra", response_class=Lines, responses={200: {"model": SpectraLine}})
async def get_spectra(asked: Range, service: ServiceInUse, _person: SignedIn) -> Response:
    """Return spectra of every sample of a range (Welch's method): lines as ``statistics``."""
    return Lines(await service.figures.spectra(asked))


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
