"""Stored runs: search, notes, samples, reports, downloads."""

import math
from collections.abc import AsyncIterator
from typing import Annotated, Any

from fastapi import APIRouter, Depends, Path, Query, Request, Response
from fastapi.responses import StreamingResponse
from pydantic import StringConstraints

from backend.api.angles import AnglesRead
from backend.api.auth import Operator, SignedIn
from backend.api.service import RowId, ServiceInUse
from backend.archive.planned import planned
from backend.archive.stored_runs import Asked, Excerpt
from backend.departure import unless_left
from backend.exports.formats import MEDIA_TYPES, DataFormat
from backend.exports.mcap import layout
from backend.plain_text import as_file_name
from backend.schemas.base import Finite
from backend.schemas.run import (
    LONGEST_S,
    Lineage,
    NoteRequest,
    Planned,
    ReplayRequest,
    RunList,
    RunMarks,
    RunView,
    SamplesView,
    TagRequest,
)
from backend.server.security import DOCUMENT_POLICY
from backend.storage.orm import TAG_MAX
from backend.storage.search import LONGEST

router = APIRouter(prefix="/api/runs", tags=["runs"])

Responses = dict[int | str, dict[str, Any]]
PDF = "application/pdf"
ZIP = "application/zip"
BINARY = "application/octet-stream"
JSON = "application/json"
DATA: Responses = {200: {"content": {kind.partition(";")[0]: {} for kind in MEDIA_TYPES.values()}}}

Where = Annotated[str, StringConstraints(max_length=2 * LONGEST)]
TagInPath = Annotated[str, Path(max_length=10 * TAG_MAX, description="a tag")]


@router.get("")
async def list_runs(
    service: ServiceInUse,
    _person: SignedIn,
    kind: Annotated[
        str | None, Query(max_length=200, description="only runs of these kinds, separated by commas")
    ] = None,
    search: Annotated[str, Query(max_length=100, description="words in kind, title, note, person or tags")] = "",
    where: Annotated[
        tuple[Where, ...], Query(max_length=10, description="searches, see docs/search.md; all have to fit")
    ] = (),
    everywhere: Annotated[bool, Query(description="of all stations, not of this one only")] = False,
    limit: Annotated[int, Query(ge=1, le=500)] = 100,
    offset: Annotated[int, Query(ge=0, le=2**31)] = 0,
) -> RunList:
    """List stored runs, newest first."""
    kinds = kind.split(",") if kind else ()
    return await service.runs.runs(Asked(kinds, search, where, everywhere, limit, offset))


@router.get("/foxglove-layout.json", response_class=Response, responses={200: {"content": {JSON: {}}}})
async def get_layout(_person: SignedIn) -> Response:
    """Return the layout that shows an MCAP file in Foxglove and Lichtblick."""
    return download(layout().encode(), JSON, "sinew-foxglove-layout.json")


@router.get("/{id}")
async def get_run(id: RowId, service: ServiceInUse, _person: SignedIn) -> RunView:
    """Return one run."""
    return await service.runs.run(id)


@router.patch("/{id}")
async def set_note(id: RowId, body: NoteRequest, service: ServiceInUse, _person: Operator) -> RunView:
    """Write the note of a run."""
    return await service.runs.set_note(id, body.note)


@router.post("/{id}/tags")
async def put_tag(id: RowId, body: TagRequest, service: ServiceInUse, _person: Operator) -> RunView:
    """Put a tag on a run."""
    await service.run_library.put_tag(id, body.tag)
    return await service.runs.run(id)


@router.delete("/{id}/tags/{tag}")
async def take_tag(id: RowId, tag: TagInPath, service: ServiceInUse, _person: Operator) -> RunView:
    """Take a tag off a run."""
    await service.run_library.take_tag(id, tag)
    return await service.runs.run(id)


@router.post("/{id}/evaluation")
async def evaluate_run(request: Request, id: RowId, service: ServiceInUse, _person: Operator) -> RunView:
    """Compute the result of a run again, from what is stored of it; earlier results stay beside the new one."""
    await unless_left(service.evaluations.again(id), request.is_disconnected)
    return await service.runs.run(id)


@router.get("/{id}/lineage")
async def get_lineage(id: RowId, service: ServiceInUse, _person: SignedIn) -> Lineage:
    """Return where a run came from, back to raw data and parameters, and what came of it."""
    return await service.history.lineage(id)


@router.get("/{id}/marks")
async def get_marks(id: RowId, service: ServiceInUse, _person: SignedIn) -> RunMarks:
    """Return what happened during a run, on its own time axis."""
    return await service.history.marks(id)


@router.get("/{id}/planned")
async def get_planned(request: Request, id: RowId, service: ServiceInUse, person: SignedIn) -> Planned:
    """Return the references that a run was to follow, from begin to end."""
    return await service.texts.run(person, request.is_disconnected, planned, service.database, id)


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
    signals: Annotated[str, Query(max_length=2000, description="names separated by commas")] = "q,q_ref,S,S_ref",
) -> Excerpt:
    return Excerpt(id, from_s, math.inf if to_s is None else to_s, points, signals.split(","))


AskedFor = Annotated[Excerpt, Depends(_excerpt)]


@router.get("/{id}/samples")
async def get_samples(asked: AskedFor, service: ServiceInUse, _person: SignedIn) -> SamplesView:
    """Return samples of a run: raw where they are few enough, else their min/max envelope."""
    return await service.runs.samples(asked)


@router.get("/{id}/samples.bin", response_class=Response, responses={200: {"content": {BINARY: {}}}})
async def get_packed_samples(asked: AskedFor, service: ServiceInUse, _person: SignedIn) -> Response:
    """Return what ``samples`` returns in binary, little endian.

    float64 bucket width [s], uint64 first bucket, uint32 buckets, uint32 values per bucket (1: samples, 2: smallest and
    largest); then float32 per signal in the order asked for: the smallest values, then, of 2, the largest.
    """
    return Response(await service.runs.packed_samples(asked), media_type=BINARY)


@router.get("/{id}/report.html", response_class=Response, responses={200: {"content": {"text/html": {}}}})
async def get_report_html(
    request: Request, id: RowId, service: ServiceInUse, _person: SignedIn, angles: AnglesRead
) -> Response:
    """Return the report of a run as one self-contained page."""
    return report(await unless_left(service.downloads.report_html(id, angles), request.is_disconnected), "html")


@router.get("/{id}/report.pdf", response_class=Response, responses={200: {"content": {PDF: {}}}})
async def get_report_pdf(
    request: Request, id: RowId, service: ServiceInUse, _person: SignedIn, angles: AnglesRead
) -> Response:
    """Return the report of a run as PDF."""
    content = await unless_left(service.downloads.report_pdf(id, angles), request.is_disconnected)
    return report(content, "pdf", f"sinew-run-{id}.pdf")


@router.get("/{id}/data.{format}", response_class=Response, responses=DATA)
async def get_data(
    id: RowId,
    format: DataFormat,
    service: ServiceInUse,
    _person: SignedIn,
    formulas: Annotated[
        str, Query(max_length=1100, description="derived signals as further columns, names separated by commas")
    ] = "",
) -> Response:
    """Return all samples of a run, with their notation and the facts of the run; SI units."""
    derived = list(dict.fromkeys(filter(None, formulas.split(","))))
    content = await service.downloads.data(id, format, derived)
    return download(content, MEDIA_TYPES[format], f"sinew-run-{id}.{format}")


@router.get("/{id}/bundle.zip", response_class=Response, responses={200: {"content": {ZIP: {}}}})
async def get_bundle(id: RowId, service: ServiceInUse, _person: SignedIn) -> Response:
    """Return a run with all that it came from, for another installation to take in."""
    return download(await service.downloads.bundle(id), ZIP, f"sinew-run-{id}.zip")


def report(content: bytes, format: str, name: str = "") -> Response:
    """Return a report: a page to look at, or a PDF to be saved under a name."""
    if format == "pdf":
        return download(content, PDF, name)
    return Response(content, media_type="text/html", headers={"Content-Security-Policy": DOCUMENT_POLICY})


def download(content: bytes | AsyncIterator[bytes], media_type: str, name: str) -> Response:
    """Return content, whole or piece by piece, to be saved under a name."""
    headers = {"Content-Disposition": f'attachment; filename="{as_file_name(name)}"'}
    if isinstance(content, bytes):
        return Response(content, media_type=media_type, headers=headers)
    return StreamingResponse(content, media_type=media_type, headers=headers)
