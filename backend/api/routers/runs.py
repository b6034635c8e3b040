"""Routes of runs: search, samples, log, formulas, figures, sheets, downloads."""

import math
from collections.abc import AsyncIterator
from typing import Annotated, Any, Literal

from fastapi import APIRouter, Depends, Path, Query, Request, Response
from fastapi.responses import StreamingResponse
from pydantic import Field, StringConstraints

from backend.api.dependencies import CurrentService, Operator, RequestedAngleUnit, RowId, SignedInUser
from backend.exports import MEDIA_TYPES, DataFormat, foxglove_layout
from backend.plain_text import make_file_name
from backend.reports import MOST_RUNS
from backend.schemas import (
    LONGEST_S,
    SEARCH_NAME_MAX,
    ChartSheet,
    ComparisonRequest,
    Differences,
    DifferencesRequest,
    EventNote,
    Finite,
    FlightList,
    FlightMoment,
    FormulaList,
    FormulaName,
    FormulaText,
    FormulaView,
    Instant,
    Lineage,
    MetricHistory,
    NoteRequest,
    PlannedSignals,
    RecordedValues,
    ReplayRequest,
    RunComparison,
    RunList,
    RunMarks,
    RunView,
    SamplesView,
    SavedSearchList,
    Schema,
    SearchText,
    SearchWords,
    SpectraLine,
    StatisticsLine,
    TagList,
    TagRequest,
    Timeline,
)
from backend.server import DOCUMENT_POLICY, SHEETS, ThreadRoute, in_thread
from backend.services import RangeQuery, RunQuery, SampleSlice, read_planned_run, run_while_connected
from backend.storage import LONGEST, TAG_MAX, EventKind, LogQuery

# Runs ----------------------------------------------------------------------------------------------


runs_router = APIRouter(prefix="/api/runs", tags=["runs"], route_class=ThreadRoute)

Responses = dict[int | str, dict[str, Any]]
PDF = "application/pdf"
ZIP = "application/zip"
BINARY = "application/octet-stream"
JSON = "application/json"
DATA: Responses = {200: {"content": {kind.partition(";")[0]: {} for kind in MEDIA_TYPES.values()}}}

Where = Annotated[str, StringConstraints(max_length=2 * LONGEST)]
TagInPath = Annotated[str, Path(max_length=10 * TAG_MAX, description="a tag")]


@runs_router.get("")
def list_runs(
    service: CurrentService,
    _person: SignedInUser,
    kind: Annotated[
        str | None, Query(max_length=200, description="only runs of these kinds, separated by commas")
    ] = None,
    search: Annotated[
        str, Query(max_length=100, description="words that the run contains, as in docs/reference/search.md")
    ] = "",
    where: Annotated[
        tuple[Where, ...], Query(max_length=10, description="searches, see docs/reference/search.md; all must match")
    ] = (),
    everywhere: Annotated[bool, Query(description="include all stations, not only this one")] = False,
    limit: Annotated[int, Query(ge=1, le=500)] = 100,
    offset: Annotated[int, Query(ge=0, le=2**31)] = 0,
) -> RunList:
    """List stored runs, newest first."""
    kinds = kind.split(",") if kind else ()
    return service.runs.find_runs(
        RunQuery(kinds=kinds, search=search, where=where, everywhere=everywhere, limit=limit, offset=offset)
    )


@runs_router.get("/foxglove-layout.json", response_class=Response, responses={200: {"content": {JSON: {}}}})
async def get_layout(_person: SignedInUser) -> Response:
    """Return the Foxglove and Lichtblick layout for MCAP files of runs."""
    return build_download_response(foxglove_layout().encode(), JSON, "sinew-foxglove-layout.json")


@runs_router.get("/{id}")
def get_run(id: RowId, service: CurrentService, _person: SignedInUser) -> RunView:
    """Return one run."""
    return service.runs.load_run(id)


@runs_router.patch("/{id}")
def set_note(id: RowId, body: NoteRequest, service: CurrentService, _person: Operator) -> RunView:
    """Set the note of a run."""
    return service.runs.set_note(id, body.note)


@runs_router.post("/{id}/tags", summary="Add Tag")
def put_tag(id: RowId, body: TagRequest, service: CurrentService, _person: Operator) -> RunView:
    """Add a tag to a run."""
    service.run_library.change_tags([id], [body.tag], [])
    return service.runs.load_run(id)


@runs_router.delete("/{id}/tags/{tag}", summary="Remove Tag")
def take_tag(id: RowId, tag: TagInPath, service: CurrentService, _person: Operator) -> RunView:
    """Remove a tag from a run."""
    service.run_library.change_tags([id], [], [tag])
    return service.runs.load_run(id)


@runs_router.post("/{id}/evaluation")
async def evaluate_run(request: Request, id: RowId, service: CurrentService, _person: Operator) -> RunView:
    """Recompute the result of a run; earlier results are kept."""
    await run_while_connected(service.evaluations.evaluate_again(id), request.is_disconnected)
    return await in_thread(service.runs.load_run, id)


@runs_router.get("/{id}/lineage")
def get_lineage(id: RowId, service: CurrentService, _person: SignedInUser) -> Lineage:
    """Return the lineage of a run, back to raw data and parameters, and the results derived from it."""
    return service.history.build_lineage(id)


@runs_router.get("/{id}/marks")
def get_marks(id: RowId, service: CurrentService, _person: SignedInUser) -> RunMarks:
    """Return the events during a run, on its own time axis."""
    return service.history.load_marks(id)


@runs_router.get("/{id}/planned")
async def get_planned(request: Request, id: RowId, service: CurrentService, person: SignedInUser) -> PlannedSignals:
    """Return the planned references of a run, from start to end."""
    return await service.texts.run(person, request.is_disconnected, read_planned_run, service.database, id)


@runs_router.post("/{id}/replay", status_code=204)
def show_moment(id: RowId, body: ReplayRequest, service: CurrentService, _person: SignedInUser) -> None:
    """Show a moment of the run in the replay's 3D view at /replay/; nothing moves."""
    service.replay.show(id, body.t)


async def _parse_slice(
    id: RowId,
    from_s: Annotated[
        Finite, Query(alias="from", ge=0.0, le=LONGEST_S, description="start, from the run's first sample [s]")
    ] = 0.0,
    to_s: Annotated[
        Finite | None, Query(alias="to", gt=0.0, le=LONGEST_S, description="end [s]; default: the end of the run")
    ] = None,
    points: Annotated[int, Query(ge=10, le=20000, description="point limit; longer ranges give an envelope")] = 2000,
    signals: Annotated[str, Query(max_length=2000, description="comma-separated signal names")] = "q,q_ref,S,S_ref",
) -> SampleSlice:
    return SampleSlice(id, from_s, math.inf if to_s is None else to_s, points, signals.split(","))


SliceQuery = Annotated[SampleSlice, Depends(_parse_slice)]


@runs_router.get("/{id}/samples")
async def get_samples(query: SliceQuery, service: CurrentService, _person: SignedInUser) -> SamplesView:
    """Return samples of a run, or their min/max envelope if there are too many."""
    return await service.runs.load_samples(query)


@runs_router.get("/{id}/samples.bin", response_class=Response, responses={200: {"content": {BINARY: {}}}})
async def get_packed_samples(query: SliceQuery, service: CurrentService, _person: SignedInUser) -> Response:
    """Return the content of ``samples`` in binary, little-endian.

    float64 bucket width [s], uint64 first bucket, uint32 buckets, uint32 values per bucket (1: samples, 2: smallest
    and largest); then for each signal in the requested order float32 values: the smallest, and with 2 values the
    largest.
    """
    return Response(await service.runs.pack_samples(query), media_type=BINARY)


@runs_router.get("/{id}/report.html", response_class=Response, responses={200: {"content": {"text/html": {}}}})
async def get_report_html(
    request: Request, id: RowId, service: CurrentService, _person: SignedInUser, angles: RequestedAngleUnit
) -> Response:
    """Return the report of a run as one self-contained page."""
    return build_report_response(
        await run_while_connected(service.downloads.render_html_report(id, angles), request.is_disconnected), "html"
    )


@runs_router.get("/{id}/report.pdf", response_class=Response, responses={200: {"content": {PDF: {}}}})
async def get_report_pdf(
    request: Request, id: RowId, service: CurrentService, _person: SignedInUser, angles: RequestedAngleUnit
) -> Response:
    """Return the report of a run as PDF."""
    content = await run_while_connected(service.downloads.render_pdf_report(id, angles), request.is_disconnected)
    return build_report_response(content, "pdf", f"sinew-run-{id}.pdf")


@runs_router.get("/{id}/data.{format}", response_class=Response, responses=DATA)
async def get_data(
    id: RowId,
    format: DataFormat,
    service: CurrentService,
    _person: SignedInUser,
    formulas: Annotated[
        str, Query(max_length=1100, description="names of derived signals to add as columns, separated by commas")
    ] = "",
) -> Response:
    """Return all samples of a run with notation and metadata; SI units."""
    derived = list(dict.fromkeys(filter(None, formulas.split(","))))
    content = await service.downloads.stream_run(id, format, derived)
    return build_download_response(content, MEDIA_TYPES[format], f"sinew-run-{id}.{format}")


@runs_router.get("/{id}/bundle.zip", response_class=Response, responses={200: {"content": {ZIP: {}}}})
async def get_bundle(id: RowId, service: CurrentService, _person: SignedInUser) -> Response:
    """Return a run with all records that it refers to, for import elsewhere."""
    return build_download_response(await service.downloads.stream_bundle(id), ZIP, f"sinew-run-{id}.zip")


def build_report_response(content: bytes, format: str, name: str = "") -> Response:
    """Return a report as a page, or as a PDF with a file name."""
    if format == "pdf":
        return build_download_response(content, PDF, name)
    return Response(content, media_type="text/html", headers={"Content-Security-Policy": DOCUMENT_POLICY})


def build_download_response(content: bytes | AsyncIterator[bytes], media_type: str, name: str) -> Response:
    """Return content, complete or in chunks, with a file name."""
    headers = {"Content-Disposition": f'attachment; filename="{make_file_name(name)}"'}
    if isinstance(content, bytes):
        return Response(content, media_type=media_type, headers=headers)
    return StreamingResponse(content, media_type=media_type, headers=headers)


# Event log and flight records ----------------------------------------------------------------------


log_router = APIRouter(prefix="/api", tags=["log"], route_class=ThreadRoute)


@log_router.get("/log")
def get_log(
    service: CurrentService,
    _person: SignedInUser,
    angles: RequestedAngleUnit,
    kind: Annotated[list[EventKind] | None, Query(max_length=50, description="kinds of the entries")] = None,
    words: Annotated[
        str, Query(max_length=400, description="words that must all occur in the displayed text, person, note or tag")
    ] = "",
    since: Annotated[Instant | None, Query(description="start of the time range")] = None,
    before: Annotated[Instant | None, Query(description="end of the time range, exclusive")] = None,
    limit: Annotated[int, Query(ge=1, le=1000)] = 100,
) -> Timeline:
    """Return the entries of the event log, newest first."""
    return service.timeline.load_page(LogQuery(kind or (), words.split(), since, before, angles), limit)


@log_router.put("/log/{id}/remark", status_code=204)
def set_remark(id: RowId, body: EventNote, service: CurrentService, person: Operator) -> None:
    """Set note and tags of an event."""
    service.timeline.set_remark(id, body, person.name)


@log_router.get("/flights", tags=["faults"])
def list_flights(service: CurrentService, _person: SignedInUser) -> FlightList:
    """List the newest flight records: samples from 10 s before to 5 s after each trip, and trigger captures."""
    return service.runs.list_flights()


@log_router.get("/flights/{id}/data.{format}", tags=["faults"], response_class=Response, responses=DATA)
async def get_flight_data(id: RowId, format: DataFormat, service: CurrentService, _person: SignedInUser) -> Response:
    """Return a flight record in a format; t counts from the trip or trigger."""
    return build_download_response(
        await service.downloads.stream_flight_record(id, format), MEDIA_TYPES[format], f"sinew-flight-{id}.{format}"
    )


@log_router.post("/flights/{id}/replay", tags=["faults"], status_code=204)
def show_flight_moment(id: RowId, body: FlightMoment, service: CurrentService, _person: SignedInUser) -> None:
    """Show a moment of a flight record in the replay's 3D view at /replay/; nothing moves."""
    service.replay.show_flight(id, body.t)


# Search and comparison of runs ---------------------------------------------------------------------


run_library_router = APIRouter(prefix="/api", tags=["runs"], route_class=ThreadRoute)

SearchName = Annotated[str, Path(max_length=2 * SEARCH_NAME_MAX, description="name of a saved search")]
RunNumber = Annotated[int, Query(ge=1, le=2**53)]


@run_library_router.get("/run-words")
def get_search_words(service: CurrentService, _person: SignedInUser) -> SearchWords:
    """Return the fields, names of values, tags and stations of the search."""
    return service.run_library.list_search_words()


@run_library_router.get("/saved-searches")
def list_saved_searches(service: CurrentService, _person: SignedInUser) -> SavedSearchList:
    """List the saved searches."""
    return service.run_library.list_saved_searches()


@run_library_router.put("/saved-searches/{name}")
def save_search(name: SearchName, body: SearchText, service: CurrentService, person: Operator) -> SavedSearchList:
    """Save a search under a name, replacing an existing one."""
    return service.run_library.save_search(name, body.where, person.name)


@run_library_router.delete("/saved-searches/{name}", summary="Delete Saved Search")
def forget_search(name: SearchName, service: CurrentService, person: Operator) -> SavedSearchList:
    """Remove a saved search from the list."""
    return service.run_library.remove_search(name, person.name)


@run_library_router.patch("/run-tags/{tag}")
def rename_tag(
    tag: Annotated[str, Path(max_length=10 * TAG_MAX, description="a tag")],
    body: TagRequest,
    service: CurrentService,
    _person: Operator,
) -> TagList:
    """Rename a tag on all runs of this station."""
    service.run_library.rename_tag(tag, body.tag)
    return TagList(tags=service.run_library.list_search_words().tags)


@run_library_router.get("/run-comparison")
def compare_runs(
    query: Annotated[ComparisonRequest, Query()], service: CurrentService, _person: SignedInUser
) -> RunComparison:
    """Return metrics and settings of runs compared with a reference, and their alignment."""
    return service.run_library.compare_runs(query)


@run_library_router.get("/run-comparison/differences")
async def get_differences(
    request: Request, query: Annotated[DifferencesRequest, Query()], service: CurrentService, _person: SignedInUser
) -> Differences:
    """Return a signal of runs minus that of a reference, and where it leaves a tolerance band."""
    return await run_while_connected(service.downloads.compute_differences(query), request.is_disconnected)


@run_library_router.get("/run-comparison/{content}.csv", response_class=Response)
async def get_comparison_file(
    content: Literal["curves", "table"],
    query: Annotated[DifferencesRequest, Query()],
    service: CurrentService,
    _person: SignedInUser,
) -> Response:
    """Return aligned curves with their differences, or the table of differences; SI units."""
    chunks = await service.downloads.stream_comparison(content, query)
    return build_download_response(chunks, "text/csv", f"sinew-comparison-{content}.csv")


@run_library_router.get("/run-comparison/report.{format}", response_class=Response)
async def get_series_report(
    request: Request,
    format: Literal["html", "pdf"],
    service: CurrentService,
    _person: SignedInUser,
    angles: RequestedAngleUnit,
    run: Annotated[list[RunNumber], Query(min_length=1, max_length=MOST_RUNS, description="runs, in order")],
) -> Response:
    """Return one report of many runs, as a self-contained page or as PDF."""
    content = await run_while_connected(service.downloads.render_series(run, format, angles), request.is_disconnected)
    return build_report_response(content, format, "sinew-series.pdf")


@run_library_router.get("/metric-history")
def get_metric_history(
    service: CurrentService,
    _person: SignedInUser,
    kind: Annotated[str, Query(min_length=1, max_length=200, description="kind of runs, or name of an experiment")],
    metric: Annotated[str, Query(max_length=200, description="name of the metric; default: the first one")] = "",
    where: Annotated[str, Query(max_length=2 * LONGEST, description="only runs that match this search")] = "",
    everywhere: Annotated[bool, Query(description="include all stations, not only this one")] = False,
) -> MetricHistory:
    """Return the history of one metric over all runs of a kind."""
    return service.run_library.build_metric_history(kind, metric, where, everywhere=everywhere)


# Chart sheets --------------------------------------------------------------------------------------


sheets_router = APIRouter(tags=["runs"], route_class=ThreadRoute)


@sheets_router.post(SHEETS, response_class=Response, responses={200: {"content": {PDF: {}}}})
async def print_sheet(request: Request, body: ChartSheet, service: CurrentService, person: SignedInUser) -> Response:
    """Return a sheet of charts as PDF. Open to viewers: stores and moves nothing."""
    return build_download_response(
        await service.sheets.render(body.svg, person, request.is_disconnected), PDF, "sinew-charts.pdf"
    )


# Derived signals -----------------------------------------------------------------------------------


formulas_router = APIRouter(prefix="/api", tags=["runs"], route_class=ThreadRoute)

Named = Annotated[FormulaName, Path(description="name of the derived signal")]


@formulas_router.get("/formulas")
def list_formulas(service: CurrentService, _person: SignedInUser) -> FormulaList:
    """List the derived signals of the station by name, with their computation steps."""
    return service.formulas.list_formulas()


@formulas_router.put("/formulas/{name}", summary="Store Formula")
def put_formula(name: Named, body: FormulaText, service: CurrentService, person: Operator) -> FormulaView:
    """Store a new or changed derived signal."""
    return service.formulas.save(name, body, person.name)


@formulas_router.delete("/formulas/{name}", status_code=204)
def remove_formula(name: Named, service: CurrentService, person: Operator) -> None:
    """Remove a derived signal; recordings are unchanged."""
    service.formulas.remove(name, person.name)


# Analysis of ranges --------------------------------------------------------------------------------


run_figures_router = APIRouter(prefix="/api/runs", tags=["runs"], route_class=ThreadRoute)

CSV = "text/csv; charset=utf-8"
LINES = "application/x-ndjson"
"""Lines of JSON, sent while the range is read: the client shows the progress."""

MAX_MOMENTS = 100


def _describe_lines(model: type[Schema]) -> dict[str, Any]:
    """Return the OpenAPI description of a route that sends lines of JSON of a model."""
    schema = {"$ref": f"#/components/schemas/{model.__name__}"}
    described: dict[int | str, dict[str, Any]] = {200: {"content": {LINES: {"schema": schema}}}}
    return {"response_class": Response, "response_model": model, "responses": described}


async def _parse_range(
    id: RowId,
    from_s: Annotated[Finite, Query(alias="from", description="start, from the run's first sample [s]")] = 0.0,
    to_s: Annotated[
        Finite | None, Query(alias="to", description="end [s], inclusive; default: the end of the run")
    ] = None,
    signals: Annotated[str, Query(max_length=2000, description="comma-separated signal names")] = "q,q_ref,S,S_ref",
) -> RangeQuery:
    return RangeQuery(id, from_s, to_s, tuple(dict.fromkeys(signals.split(","))))


RangeParameters = Annotated[RangeQuery, Depends(_parse_range)]
Times = Annotated[list[Finite], Field(min_length=1, max_length=MAX_MOMENTS)]


@run_figures_router.get("/{id}/statistics", **_describe_lines(StatisticsLine))
async def get_statistics(query: RangeParameters, service: CurrentService, _person: SignedInUser) -> Response:
    """Return statistics over all samples of a range, as lines: the progress, then the result."""
    return StreamingResponse(await service.figures.stream_statistics(query), media_type=LINES)


@run_figures_router.get("/{id}/spectra", **_describe_lines(SpectraLine))
async def get_spectra(query: RangeParameters, service: CurrentService, _person: SignedInUser) -> Response:
    """Return spectra over all samples of a range (Welch's method), as lines like ``statistics``."""
    return StreamingResponse(await service.figures.stream_spectra(query), media_type=LINES)


@run_figures_router.get("/{id}/range.csv", response_class=Response, responses={200: {"content": {"text/csv": {}}}})
async def get_range_file(query: RangeParameters, service: CurrentService, _person: SignedInUser) -> Response:
    """Return every sample of a range as CSV, with values as in ``data.csv``."""
    end = "end" if query.to_s is None else f"{query.to_s:.3f}-s"
    name = f"sinew-run-{query.run}-{query.from_s:.3f}-to-{end}.csv"
    return build_download_response(await service.figures.stream_csv(query), CSV, name)


@run_figures_router.get("/{id}/values")
def get_values(
    id: RowId,
    service: CurrentService,
    _person: SignedInUser,
    at: Annotated[Times, Query(description="times since the run's first sample [s]")],
    signals: Annotated[str, Query(max_length=2000, description="comma-separated signal names")] = "q,q_ref,S,S_ref",
) -> RecordedValues:
    """Return the values of signals at the last sample at or before each given time."""
    return service.figures.read_values(id, at, tuple(dict.fromkeys(signals.split(","))))
