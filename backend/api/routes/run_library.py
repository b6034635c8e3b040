"""Finding runs and setting them beside each other."""

from typing import Annotated, Literal

from fastapi import APIRouter, Path, Query, Request, Response

from backend.api.angles import AnglesRead
from backend.api.auth import Operator, SignedIn
from backend.api.routes.runs import download, report
from backend.api.service import ServiceInUse
from backend.departure import unless_left
from backend.reports.series import MOST_RUNS
from backend.schemas.comparison import ComparisonAsked, Differences, DifferencesAsked, RunComparison
from backend.schemas.run import (
    SEARCH_NAME_MAX,
    MetricHistory,
    SavedSearchList,
    SearchText,
    SearchWords,
    TagList,
    TagRequest,
)
from backend.storage.orm import TAG_MAX
from backend.storage.search import LONGEST

router = APIRouter(prefix="/api", tags=["runs"])

SearchName = Annotated[str, Path(max_length=2 * SEARCH_NAME_MAX, description="name of a saved search")]
RunNumber = Annotated[int, Query(ge=1, le=2**53)]


@router.get("/run-words")
async def get_search_words(service: ServiceInUse, _person: SignedIn) -> SearchWords:
    """Return what runs can be searched by at present: fields, names of values, tags, stations."""
    return await service.run_library.words()


@router.get("/saved-searches")
async def list_saved_searches(service: ServiceInUse, _person: SignedIn) -> SavedSearchList:
    """List the saved searches."""
    return await service.run_library.searches()


@router.put("/saved-searches/{name}")
async def save_search(name: SearchName, body: SearchText, service: ServiceInUse, person: Operator) -> SavedSearchList:
    """Save a search under a name, in the place of one that has it."""
    return await service.run_library.save_search(name, body.where, person.name)


@router.delete("/saved-searches/{name}")
async def forget_search(name: SearchName, service: ServiceInUse, person: Operator) -> SavedSearchList:
    """Take a saved search off the list."""
    return await service.run_library.forget_search(name, person.name)


@router.patch("/run-tags/{tag}")
async def rename_tag(
    tag: Annotated[str, Path(max_length=10 * TAG_MAX, description="a tag")],
    body: TagRequest,
    service: ServiceInUse,
    _person: Operator,
) -> TagList:
    """Call a tag otherwise on all runs of this station."""
    return await service.run_library.rename_tag(tag, body.tag)


@router.get("/run-comparison")
async def compare_runs(
    asked: Annotated[ComparisonAsked, Query()], service: ServiceInUse, _person: SignedIn
) -> RunComparison:
    """Return metrics and settings of runs beside those of one of them, and how they come onto its time axis."""
    return await service.run_library.comparison(asked)


@router.get("/run-comparison/differences")
async def get_differences(
    request: Request, asked: Annotated[DifferencesAsked, Query()], service: ServiceInUse, _person: SignedIn
) -> Differences:
    """Return a signal of runs minus that of one of them, and where it leaves a tolerance band."""
    return await unless_left(service.downloads.differences(asked), request.is_disconnected)


@router.get("/run-comparison/{content}.csv", response_class=Response)
async def get_comparison_file(
    content: Literal["curves", "table"],
    asked: Annotated[DifferencesAsked, Query()],
    service: ServiceInUse,
    _person: SignedIn,
) -> Response:
    """Return aligned curves with their differences, or the table of what differs; SI units."""
    content_pieces = await service.downloads.comparison(content, asked)
    return download(content_pieces, "text/csv", f"sinew-comparison-{content}.csv")


@router.get("/run-comparison/report.{format}", response_class=Response)
async def get_series_report(
    request: Request,
    format: Literal["html", "pdf"],
    service: ServiceInUse,
    _person: SignedIn,
    angles: AnglesRead,
    run: Annotated[list[RunNumber], Query(min_length=1, max_length=MOST_RUNS, description="runs, in order")],
) -> Response:
    """Return one report of many runs, as a self-contained page or as PDF."""
    content = await unless_left(service.downloads.series(run, format, angles), request.is_disconnected)
    return report(content, format, "sinew-series.pdf")


@router.get("/metric-history")
async def get_metric_history(
    service: ServiceInUse,
    _person: SignedIn,
    kind: Annotated[str, Query(min_length=1, max_length=200, description="kind of runs, or name of an experiment")],
    metric: Annotated[str, Query(max_length=200, description="name of the metric; else the first there is")] = "",
    where: Annotated[str, Query(max_length=2 * LONGEST, description="of the runs that fit this search only")] = "",
    everywhere: Annotated[bool, Query(description="of all stations, not of this one only")] = False,
) -> MetricHistory:
    """Return one metric of a kind of runs over the dates of these runs."""
    return await service.run_library.metric_history(kind, metric, where, everywhere=everywhere)
