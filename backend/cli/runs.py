"""Commands ``sinew runs``: search, tag, compare, show, export and import runs."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from backend.cli import messages
from backend.cli.experiments import current_user
from backend.cli.options import (
    DataFolder,
    ParameterSet,
    StationName,
    load_plant_parameters,
    load_settings,
    open_configured_database,
)
from backend.cli.output import AsJson, angle_unit, console, fail, print_json, print_run, print_settings, print_table
from backend.units import convert_to_display, get_display_unit

if TYPE_CHECKING:
    from backend.schemas import ComparedValue, RunView
    from backend.services import StoredRuns
    from backend.storage import Database


# Exports and imports -------------------------------------------------------------------------------


def export(
    run: Annotated[int, typer.Argument(help="Number of the run.")],
    file: Annotated[Path, typer.Argument(help="File to write, .csv, .parquet, .mat or .mcap.")],
    formula: Annotated[list[str] | None, typer.Option(help="Derived signal to add as a column; repeatable.")] = None,
    data: DataFolder = None,
    station: StationName = None,
) -> None:
    """Write all samples of a run in SI units to a file, with the metadata of the run."""
    from backend.exports import DataFormat, ExportError, export_run, write_export
    from backend.storage import UnknownRecordError

    kind = file.suffix.removeprefix(".")
    if kind not in set(DataFormat):
        fail(messages.unknown_export_suffix(file=file), status=2)
    with open_configured_database(load_settings(data=data, station=station), read_only=True) as database:
        try:
            write_export(export_run(database, run, list(dict.fromkeys(formula or ()))), DataFormat(kind), file)
        except (UnknownRecordError, ExportError) as error:
            fail(str(error), status=2)
    console.print(messages.wrote(files=str(file)), highlight=False, markup=False)


def layout(file: Annotated[Path, typer.Argument(help="File to write, .json.")]) -> None:
    """Write a Foxglove and Lichtblick layout for MCAP exports and the live stream."""
    from backend.exports import mcap, write_file_whole

    write_file_whole((mcap.foxglove_layout().encode(),), file)
    console.print(messages.wrote(files=str(file)), highlight=False, markup=False)


def import_run(
    file: Annotated[Path, typer.Argument(help="Export of a run, .csv, .parquet, .mat or .mcap, or a bundle, .zip.")],
    data: DataFolder = None,
    station: StationName = None,
    as_json: AsJson = False,
) -> None:
    """Import an exported run, or a run with its lineage from a bundle; on an error, import nothing."""
    from backend.exports import ImportRefusedError
    from backend.services import import_run_file

    settings = load_settings(data=data, station=station)
    with open_configured_database(settings) as database:
        try:
            imported = import_run_file(database, file, current_user(), settings.data)
        except (ImportRefusedError, OSError) as error:
            fail(messages.nothing_imported(file=file, reason=str(error)), status=2)
            raise
    if as_json:
        print_json(vars(imported))
    elif imported.new:
        text = messages.run_imported(was=imported.was, run_id=imported.run)
        console.print(text, highlight=False, markup=False)
    else:
        text = messages.run_already_stored(was=imported.was, run_id=imported.run)
        console.print(text, highlight=False, markup=False)


def bundle(
    run: Annotated[int, typer.Argument(help="Number of the run.")],
    file: Annotated[Path, typer.Argument(help="File to write, .zip.")],
    data: DataFolder = None,
    station: StationName = None,
) -> None:
    """Write a run with its lineage to a file that another installation can import."""
    from backend.exports import ExportError, write_file_whole
    from backend.services import stream_bundle
    from backend.storage import UnknownRecordError

    settings = load_settings(data=data, station=station)
    with open_configured_database(settings, read_only=True) as database:
        try:
            write_file_whole(stream_bundle(database, run, settings.data), file)
        except (UnknownRecordError, ExportError) as error:
            fail(str(error), status=2)
    console.print(messages.wrote(files=str(file)), highlight=False, markup=False)


# Search, comparison, lineage and tags --------------------------------------------------------------


Where = Annotated[str, typer.Option("--where", help='Search, such as "kind=tracking overshoot_q_percent < 5".')]
AllStations = Annotated[bool, typer.Option("--all-stations", help="Include all stations in the database.")]
RunNumbers = Annotated[list[int], typer.Argument(help="Numbers of runs.")]
_SHOWN_HASH_DIGITS = 12


def list_runs(
    where: Where = "",
    search: Annotated[
        str,
        typer.Option(
            help="Words in number, kind, title, plant, parameters, bank, person, station, note, tags or end of a run."
        ),
    ] = "",
    saved: Annotated[str, typer.Option("--saved", metavar="NAME", help="Name of a saved search.")] = "",
    limit: Annotated[int, typer.Option(min=1, max=10_000, help="Maximum number of runs to list.")] = 50,
    all_stations: AllStations = False,
    data: DataFolder = None,
    station: StationName = None,
    as_json: AsJson = False,
) -> None:
    """List all runs, or those that match a search, newest first.

    docs/reference/search.md describes searches.
    """
    from backend.services import RunLibrary, RunQuery

    with open_configured_database(load_settings(data=data, station=station), read_only=True) as database:
        saved_where = RunLibrary(database).find_saved_search(saved) if saved else ""
        query = RunQuery(search=search, where=(saved_where, where), everywhere=all_stations, limit=limit)
        found = _open_stored_runs(database).find_runs(query)
    if as_json:
        print_json([run.model_dump(mode="json") for run in found.runs])
        return
    rows = [
        (
            run.id,
            f"{run.started:%Y-%m-%d %H:%M}",
            run.title,
            run.parameters,
            run.who,
            run.station,
            " ".join(run.tags),
            _describe_end(run),
        )
        for run in found.runs
    ]
    columns = ("run", "started (UTC)", "title", "parameters", "by", "station", "tags", "end")
    print_table(columns, rows, no_wrap=columns[:2])
    if found.total > len(rows):
        console.print(messages.more_runs(listed=len(rows), found=found.total), highlight=False, markup=False)


def compare(
    runs: RunNumbers,
    reference: Annotated[
        int | None, typer.Option("--reference", help="Reference run of the differences. [the first]")
    ] = None,
    data: DataFolder = None,
    station: StationName = None,
    as_json: AsJson = False,
) -> None:
    """Compare the metrics of runs, with differences from a reference run."""
    from backend.schemas import ComparisonRequest
    from backend.services import RunLibrary

    with open_configured_database(load_settings(data=data, station=station), read_only=True) as database:
        found = RunLibrary(database).compare_runs(ComparisonRequest.model_construct(run=runs, reference=reference))
    if as_json:
        print_json(found.model_dump(mode="json"))
        return
    for run in found.runs:
        text = messages.compared_run(
            run_id=run.id,
            station=run.station,
            is_reference=run.id == found.reference,
            title=run.title,
            started=run.started,
            verdict=run.verdict,
        )
        console.print(text, highlight=False, markup=False)
    rows = [
        (
            item.label,
            *(_format_comparison(value, item.unit) for value in item.values),
            get_display_unit(item.unit, angle_unit()).unit,
        )
        for item in found.metrics
    ]
    print_table(("metric", *(f"run {run.id}" for run in found.runs), "unit"), rows)


def history(
    kind: Annotated[str, typer.Argument(help="Kind of run, or name of an experiment.")],
    metric: Annotated[str, typer.Argument(help="Name of a metric. [the first one]")] = "",
    where: Where = "",
    all_stations: AllStations = False,
    data: DataFolder = None,
    station: StationName = None,
    as_json: AsJson = False,
) -> None:
    """Print the history of a metric over all runs of a kind."""
    from backend.services import RunLibrary

    with open_configured_database(load_settings(data=data, station=station), read_only=True) as database:
        found = RunLibrary(database).build_metric_history(kind, metric, where, everywhere=all_stations)
    if as_json:
        print_json(found.model_dump(mode="json"))
        return
    if found.metric is None:
        fail(messages.no_result_of_kind(kind=kind))
    reading = get_display_unit(found.metric.unit, angle_unit())
    rows = [
        (point.run, f"{point.at:%Y-%m-%d %H:%M}", convert_to_display(point.value, found.metric.unit, angle_unit()))
        for point in found.points
    ]
    print_table(("run", "started (UTC)", f"{found.metric.label} [{reading.unit}]"), rows)
    if found.without or found.left_out:
        text = messages.runs_without_value(without=found.without, left_out=found.left_out)
        console.print(text, highlight=False, markup=False)


def lineage(
    run: Annotated[int, typer.Argument(help="Number of the run.")],
    params: ParameterSet = None,
    data: DataFolder = None,
    station: StationName = None,
    as_json: AsJson = False,
) -> None:
    """Show the lineage of a run, with SHA-256 digests and outdated parts."""
    import sys

    from backend.services import RunHistory

    settings = load_settings(params=params, data=data, station=station)
    with open_configured_database(settings, read_only=True) as database:
        found = RunHistory(
            database, load_plant_parameters(settings, database), lambda: None, sys.maxsize
        ).build_lineage(run)
    if as_json:
        print_json(found.model_dump(mode="json"))
        return
    titles = {node.id: node.title for node in found.nodes}
    rows = [
        (
            node.title,
            node.detail,
            node.sha256[:_SHOWN_HASH_DIGITS] if node.sha256 else node.no_sha256,
            ", ".join(titles[origin] for origin in node.origins),
            node.out_of_date,
        )
        for node in found.nodes
    ]
    print_table(("record", "detail", "sha256", "from", "out of date"), rows)


def tag(
    runs: RunNumbers,
    add: Annotated[list[str] | None, typer.Option("--add", metavar="TAG", help="Tag to add; repeatable.")] = None,
    remove: Annotated[
        list[str] | None, typer.Option("--remove", metavar="TAG", help="Tag to remove; repeatable.")
    ] = None,
    data: DataFolder = None,
    station: StationName = None,
) -> None:
    """Add tags to runs and remove others; on an error, change nothing."""
    from backend.services import RunLibrary

    if not add and not remove:
        fail(messages.no_tag(), status=2)
    with open_configured_database(load_settings(data=data, station=station)) as database:
        RunLibrary(database).change_tags(runs, add or [], remove or [])


def rename_tag(
    before: Annotated[str, typer.Argument(help="Current name of the tag.")],
    after: Annotated[str, typer.Argument(help="New name of the tag.")],
    data: DataFolder = None,
    station: StationName = None,
) -> None:
    """Rename a tag on all runs of the station."""
    from backend.services import RunLibrary

    with open_configured_database(load_settings(data=data, station=station)) as database:
        renamed = RunLibrary(database).rename_tag(before, after)
    console.print(messages.tag_renamed(runs=renamed), highlight=False, markup=False)


def save_search(
    name: Annotated[str, typer.Argument(help="Name of the search.")],
    where: Annotated[str, typer.Argument(help="Search to save; empty deletes the saved search.")] = "",
    data: DataFolder = None,
    station: StationName = None,
) -> None:
    """Save a search for `sinew runs list --saved` and the Runs page."""
    from backend.services import RunLibrary

    with open_configured_database(load_settings(data=data, station=station)) as database:
        library = RunLibrary(database)
        if where.strip():
            library.save_search(name, where, current_user())
        else:
            library.remove_search(name, current_user())


def searches(data: DataFolder = None, station: StationName = None, as_json: AsJson = False) -> None:
    """List the saved searches."""
    from backend.services import RunLibrary

    with open_configured_database(load_settings(data=data, station=station), read_only=True) as database:
        found = RunLibrary(database).list_saved_searches()
    if as_json:
        print_json([one.model_dump() for one in found.searches])
        return
    print_table(("search", "where", "by"), [(one.name, one.where, one.who) for one in found.searches])


def _open_stored_runs(database: "Database") -> "StoredRuns":
    from backend.services import StoredRuns

    return StoredRuns(database, lambda: None, lambda _run: False)


def _describe_end(run: "RunView") -> str:
    from backend.schemas import EvaluationView

    if run.evaluation is not EvaluationView.MISSING:
        return run.end_state
    return messages.not_evaluated(end=run.end_state, reason=run.evaluation_problem)


def _format_comparison(value: "ComparedValue", unit: str) -> str:
    if value.value is None:
        return messages.not_measured_because(reason=value.reason)
    text = f"{convert_to_display(value.value, unit, angle_unit()):.4g}"
    if not value.difference:
        return text
    percent = "" if value.percent is None else f", {value.percent:+.3g} %"
    return f"{text} ({convert_to_display(value.difference, unit, angle_unit()):+.4g}{percent})"


# Commands ------------------------------------------------------------------------------------------


app = typer.Typer(
    help="Stored runs: search, tag, compare, show, export, report.", no_args_is_help=True, rich_markup_mode=None
)
app.command()(export)
app.command()(layout)
app.command("import")(import_run)
app.command()(bundle)
app.command("list")(list_runs)
app.command()(compare)
app.command()(history)
app.command()(lineage)
app.command()(tag)
app.command("rename-tag")(rename_tag)
app.command("save-search")(save_search)
app.command()(searches)

RunNumber = Annotated[int, typer.Argument(help="Number of the run.")]


@app.command()
def show(run: RunNumber, data: DataFolder = None, station: StationName = None, as_json: AsJson = False) -> None:
    """Show a run with its settings, metrics and criteria."""
    from backend.reports import build_metrics_document, load_source

    with open_configured_database(load_settings(data=data, station=station), read_only=True) as database:
        source = load_source(database, run)
    if as_json:
        print_json(build_metrics_document(source))
        return
    print_settings(source)
    print_run(source)


@app.command()
def evaluate(run: RunNumber, data: DataFolder = None, station: StationName = None) -> None:
    """Recompute the result of a run from its stored data and store it.

    Earlier results are kept.
    """
    from backend.analysis import reevaluate_run

    with open_configured_database(load_settings(data=data, station=station)) as database:
        evaluation = reevaluate_run(database, run)
    if evaluation.problem:
        fail(messages.problem_of_run(run_id=run, reason=evaluation.problem), status=2)
    console.print(messages.run_evaluated(run_id=run), highlight=False, markup=False)


@app.command()
def report(
    run: RunNumber,
    folder: Annotated[Path, typer.Argument(help="Folder for report.html, report.pdf, data.csv and metrics.json.")],
    data: DataFolder = None,
    station: StationName = None,
) -> None:
    """Write the report and the data of a run."""
    from backend.reports import write_report_files

    with open_configured_database(load_settings(data=data, station=station), read_only=True) as database:
        for path in write_report_files(database, run, folder, angle_unit()):
            console.print(messages.wrote(files=str(path)), highlight=False, markup=False)
