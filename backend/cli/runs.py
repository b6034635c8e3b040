"""``sinew runs``."""

from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from backend.cli.output import AsJson, angles, fail, out, print_json, print_table
from backend.cli.place import DataFolder, database_of, settings_with
from backend.cli.run_tables import show_run, show_settings

if TYPE_CHECKING:
    from backend.storage.runs import Run

app = typer.Typer(help="Stored runs: search, show, export, report.", no_args_is_help=True, rich_markup_mode=None)

RunNumber = Annotated[int, typer.Argument(help="Number of the run.")]


@app.command("list")
def list_runs(
    search: Annotated[str, typer.Option(help="Words in number, kind, person, note, parameters or end state.")] = "",
    limit: Annotated[int, typer.Option(min=1, max=10_000, help="Most runs to list.")] = 50,
    data: DataFolder = None,
    as_json: AsJson = False,
) -> None:
    """List runs, newest first."""
    from backend.storage import results, runs

    with database_of(settings_with(data=data)) as database, database.reading() as session:
        found = runs.find(session, search=search, limit=limit)
        evaluated = results.present(session, [run.id for run in found])
    if as_json:
        print_json([{**asdict(run), "evaluated": run.id in evaluated} for run in found])
        return
    rows = [
        (r.id, f"{r.started_at:%Y-%m-%d %H:%M}", r.kind, r.parameters_name, r.who, _end(r, r.id in evaluated))
        for r in found
    ]
    print_table(("run", "started (UTC)", "kind", "parameters", "by", "end"), rows)


@app.command()
def show(run: RunNumber, data: DataFolder = None, as_json: AsJson = False) -> None:
    """Show a run with its settings, metrics and criteria."""
    from backend.reports.files import metrics_document
    from backend.reports.source import load_source

    with database_of(settings_with(data=data)) as database:
        source = load_source(database, run)
    if as_json:
        print_json(metrics_document(source))
        return
    show_settings(source)
    show_run(source)


@app.command()
def evaluate(run: RunNumber, data: DataFolder = None) -> None:
    """Compute the result of a run again, from what is stored of it, and store it beside earlier ones."""
    from backend.experiments.results.again import evaluate_again

    with database_of(settings_with(data=data)) as database:
        evaluation = evaluate_again(database, run)
    if evaluation.problem:
        fail(f"run {run}: {evaluation.problem}", status=2)
    out.print(f"run {run} is evaluated; see it with: sinew runs show {run}", highlight=False, markup=False)


@app.command()
def export(
    run: RunNumber,
    file: Annotated[Path, typer.Argument(help="File to write; .csv, .parquet or .mat says the format.")],
    data: DataFolder = None,
) -> None:
    """Write all samples of a run to a file; SI units."""
    from backend.recording.columns import columns_of_run
    from backend.reports.rendering import EXPORTS

    kind = file.suffix.removeprefix(".")
    if kind not in EXPORTS:
        fail(f"{file}: name the file .csv, .parquet or .mat", status=2)
    with database_of(settings_with(data=data)) as database:
        file.write_bytes(EXPORTS[kind](columns_of_run(database, run)))
    out.print(f"wrote {file}", highlight=False, markup=False)


@app.command()
def report(
    run: RunNumber,
    folder: Annotated[Path, typer.Argument(help="Folder for report.html, report.pdf, data.csv and metrics.json.")],
    data: DataFolder = None,
) -> None:
    """Write the report of a run with its data."""
    from backend.reports.files import write_files

    with database_of(settings_with(data=data)) as database:
        for path in write_files(database, run, folder, angles()):
            out.print(f"wrote {path}", highlight=False, markup=False)


def _end(run: "Run", is_evaluated: bool) -> str:
    from backend.storage.runs import EndState, RunKind

    if is_evaluated or run.kind == RunKind.SESSION or run.end_state == EndState.RUNNING:
        return run.end_state
    return f"{run.end_state}, not evaluated: {run.evaluation_problem or 'it was never done'}"
