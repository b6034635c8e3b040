"""Stored runs: search, notes, samples, reports, downloads."""

import math
from enum import StrEnum
from typing import Annotated

from fastapi import APIRouter, Depends, Query, Response

from backend.api.angles import AnglesRead
from backend.api.auth import Operator, SignedIn
from backend.api.service import RowId, ServiceInUse
from backend.archive.stored_runs import Excerpt
from backend.messages.base import Finite
from backend.messages.history import LONGEST_S, Lineage, ReplayRequest, RunMarks
from backend.messages.run import NoteRequest, RunList, RunView, SamplesView
from backend.web_server.guard import DOCUMENT_POLICY

router = APIRouter(prefix="/api/runs", tags=["runs"])

PDF = "application/pdf"
BINARY = "application/octet-stream"


class DataFormat(StrEnum):
    """Formats a recording can be downloaded in."""

    CSV = "csv"
    PARQUET = "parquet"
    MAT = "mat"


MEDIA_TYPES = {
    DataFormat.CSV: "text/csv; charset=utf-8",
    DataFormat.PARQUET: "application/vnd.apache.parquet",
    DataFormat.MAT: "application/x-matlab-data",
}


@router.get("")
async def list_runs(
    service: ServiceInUse,
    _person: SignedIn,
    kind: Annotated[
        str | None, Query(max_length=200, description="only runs of these kinds, separated by commas")
    ] = None,
    search: Annotated[str, Query(max_length=100, description="words in kind, note, person or settings")] = "",
    limit: Annotated[int, Query(ge=1, le=500)] = 100,
    offset: Annotated[int, Query(ge=0, le=2**31)] = 0,
) -> RunList:
    """List stored runs, newest first."""
    return await service.runs.runs(kind, search, limit, offset)


@router.get("/{id}")
async def get_run(id: RowId, service: ServiceInUse, _person: SignedIn) -> RunView:
    """Return one run."""
    return await service.runs.run(id)


@router.patch("/{id}")
async def set_note(id: RowId, body: NoteRequest, service: ServiceInUse, _person: Operator) -> RunView:
    """Write the note of a run."""
    return await service.runs.set_note(id, body.note)


@router.post("/{id}/evaluation")
async def evaluate_run(id: RowId, service: ServiceInUse, _person: Operator) -> RunView:
    """Compute the result of a run again, from what is stored of it; earlier results stay beside the new one."""
    await service.evaluations.again(id)
    return await service.runs.run(id)


@router.get("/{id}/lineage")
async def get_lineage(id: RowId, service: ServiceInUse, _person: SignedIn) -> Lineage:
    """Return where a run came from, back to raw data and parameters, and what came of it."""
    return await service.history.lineage(id)


@router.get("/{id}/marks")
async def get_marks(id: RowId, service: ServiceInUse, _person: SignedIn) -> RunMarks:
    """Return what happened during a run, on its own time axis."""
    return await service.history.marks(id)


@router.post("/{id}/replay", status_code=204)
async def show_moment(id: RowId, body: ReplayRequest, service: ServiceInUse, _person: SignedIn) -> None:
    """Let the replay's 3D view at /replay/ show a moment of the run; nothing real moves."""
    await service.replay.show(id, body.t)


async def _excerpt(
    id: RowId,
    from_s: Annotated[
        Finite, Query(alias="from", ge=0.0, le=LONGEST_S, description="begin, from the run's first sample [s]")
    ] = 0.0,
    to_s: Annotated[
        Finite | None, Query(alias="to", gt=0.0, le=LONGEST_S, description="end [s]; the run's end if left out")
    ] = None,
    points: Annotated[int, Query(ge=10, le=20000, description="most points; beyond it the envelope is sent")] = 2000,
    signals: Annotated[str, Query(max_length=400, description="names separated by commas")] = "q,q_ref,S,S_ref",
) -> Excerpt:
    return Excerpt(id, from_s, math.inf if to_s is None else to_s, points, signals.split(","))


AskedFor = Annotated[Excerpt, Depends(_excerpt)]


@router.get("/{id}/samples")
async def get_samples(asked: AskedFor, service: ServiceInUse, _person: SignedIn) -> SamplesView:
    """Return samples of a run: raw where they are few enough, else their min/max envelope."""
    return await service.runs.samples(asked)


@router.get("/{id}/samples.bin", response_class=Response, responses={200: {"content": {BINARY: {}}}})
async def get_packed_samples(asked: AskedFor, service: ServiceInUse, _person: SignedIn) -> Response:
    """Return what ``samples`` returns in binary, a tenth of the size, for drawing.

    Little endian: float64 bucket width [s], uint64 number of the first bucket, uint32 buckets, uint32 values per bucket
    (1: samples, 2: smallest and largest); then float32 per signal in the order asked for: the smallest values, then, of
    2, the largest.
    """
    return Response(await service.runs.packed_samples(asked), media_type=BINARY)


@router.get("/{id}/report.html", response_class=Response, responses={200: {"content": {"text/html": {}}}})
async def get_report_html(id: RowId, service: ServiceInUse, _person: SignedIn, angles: AnglesRead) -> Response:
    """Return the report of a run as one self-contained page."""
    report = await service.downloads.report_html(id, angles)
    return Response(report, media_type="text/html", headers={"Content-Security-Policy": DOCUMENT_POLICY})


@router.get("/{id}/report.pdf", response_class=Response, responses={200: {"content": {PDF: {}}}})
async def get_report_pdf(id: RowId, service: ServiceInUse, _person: SignedIn, angles: AnglesRead) -> Response:
    """Return the report of a run as PDF."""
    return download(await service.downloads.report_pdf(id, angles), PDF, f"sinew-run-{id}.pdf")


@router.get(
    "/{id}/data.{format}",
    response_class=Response,
    responses={200: {"content": {kind.partition(";")[0]: {} for kind in MEDIA_TYPES.values()}}},
)
async def get_data(id: RowId, format: DataFormat, service: ServiceInUse, _person: SignedIn) -> Response:
    """Return all samples of a run as CSV, Parquet or MATLAB file; SI units, columns named as in the notation."""
    return download(await service.downloads.data(id, format), MEDIA_TYPES[format], f"sinew-run-{id}.{format}")


def download(content: bytes, media_type: str, name: str) -> Response:
    """Return content to be saved under a name."""
    return Response(content, media_type=media_type, headers={"Content-Disposition": f'attachment; filename="{name}"'})
