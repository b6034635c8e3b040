"""``sinew runs``."""

from pathlib import Path
from typing import Annotated

import typer

from backend.cli import exports, run_library
from backend.cli.output import AsJson, angles, fail, out, print_json
from backend.cli.place import DataFolder, StationName, database_of, settings_with
from backend.cli.run_tables import show_run, show_settings

app = typer.Typer(
    help="Stored runs: search, tag, compare, show, export, report.", no_args_is_help=True, rich_markup_mode=None
)
app.command()(exports.export)
app.command()(exports.layout)
app.command("import")(exports.take_in)
app.command()(exports.bundle)
app.command("list")(run_library.list_runs)
app.command()(run_library.compare)
app.command()(run_library.history)
app.command()(run_library.lineage)
app.command()(run_library.tag)
app.command("rename-tag")(run_library.rename_tag)
app.command("save-search")(run_library.save_search)
app.command()(run_library.searches)

RunNumber = Annotated[int, typer.Argument(help="Number of the run.")]


@app.command()
def show(run: RunNumber, data: DataFolder = None, station: StationName = None, as_json: AsJson = False) -> None:
    """Show a run with its settings, metrics and criteria."""
    from backend.reports.build import metrics_document
    from backend.reports.model import load_source

    with database_of(settings_with(data=data, station=station), reading=True) as database:
        source = load_source(database, run)
    if as_json:
        print_json(metrics_document(source))
        return
    show_settings(source)
    show_run(source)


@app.command()
def evaluate(run: RunNumber, data: DataFolder = None, station: StationName = None) -> None:
    """Compute the result of a run again, from what is stored of it, and store it beside earlier ones."""
    from backend.analysis.evaluation import evaluate_again

    with database_of(settings_with(data=data, station=station)) as database:
        evaluation = evaluate_again(database, run)
    if evaluation.problem:
        fail(f"run {run}: {evaluation.problem}", status=2)
    out.print(f"run {run} is evaluated; see it with: sinew runs show {run}", highlight=False, markup=False)


@app.command()
def report(
    run: RunNumber,
    folder: Annotated[Path, typer.Argument(help="Folder for report.html, report.pdf, data.csv and metrics.json.")],
    data: DataFolder = None,
    station: StationName = None,
) -> None:
    """Write the report of a run with its data."""
    from backend.reports.build import write_files

    with database_of(settings_with(data=data, station=station), reading=True) as database:
        for path in write_files(database, run, folder, angles()):
            out.print(f"wrote {path}", highlight=False, markup=False)
