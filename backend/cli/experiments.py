"""``sinew experiments``: those there are, looking one over, keeping own ones."""

import sys
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from backend.cli.experiment import entry_of, text_in
from backend.cli.ordering import current_user, in_force
from backend.cli.output import AsJson, out, print_json, print_table
from backend.cli.place import DataFolder, ParameterSet, database_of, parameters_in_force, settings_with
from backend.plain_text import as_lines
from backend.settings import Settings
from backend.units import counted

if TYPE_CHECKING:
    from backend.archive.own_experiments import Checked
    from backend.banks.tuning_settings import TuningChoice
    from backend.storage.database import Database
    from plant.parameters import PlantParameters

app = typer.Typer(
    help="Experiments: list, show, look over, keep own ones.", no_args_is_help=True, rich_markup_mode=None
)
File = Annotated[Path, typer.Argument(help="File of an experiment, YAML or JSON.")]
Name = Annotated[str, typer.Argument(help="Name of an experiment, name@2 for a version, or a file.")]


@app.command("list")
def list_experiments(data: DataFolder = None, as_json: AsJson = False) -> None:
    """List all experiments that can be run, own ones in their newest version."""
    from backend.archive.own_experiments import OwnExperiments

    with database_of(settings_with(data=data), reading=True) as database:
        found = OwnExperiments(database).all()
    rows = [(entry.name, entry.title, f"{entry.usual.program().duration_s:.6g}") for entry in found]
    if as_json:
        print_json([{"name": name, "title": title, "duration_s": float(lasts)} for name, title, lasts in rows])
    else:
        print_table(("experiment", "title", "lasts [s]"), rows)


@app.command()
def show(name: Name, data: DataFolder = None, as_json: AsJson = False) -> None:
    """Show the settings of an experiment, with unit, default and bounds."""
    entry = entry_of(name, settings_with(data=data))
    if as_json:
        print_json([asdict(setting) for setting in entry.settings])
        return
    out.print(f"{entry.title}. {' '.join(entry.description.split())}", highlight=False, markup=False)
    rows = [
        (s.name, f"{s.default}", ", ".join(s.choices) or f"{s.minimum} to {s.maximum}", s.unit, s.meaning)
        for s in entry.settings
    ]
    print_table(("setting", "default", "bounds", "unit", "meaning"), rows)


@app.command()
def text(name: Name, data: DataFolder = None) -> None:
    """Print the text of an experiment, to keep it elsewhere or to begin an own one with."""
    from backend.archive.own_experiments import OwnExperiments

    with database_of(settings_with(data=data), reading=True) as database:
        written = OwnExperiments(database).written(name).text
    print(as_lines(written) if sys.stdout.isatty() else written, end="")


@app.command()
def check(file: File, params: ParameterSet = None, data: DataFolder = None, as_json: AsJson = False) -> None:
    """Look an experiment over as a start would: nothing moves, nothing is kept."""
    from backend.archive.own_experiments import OwnExperiments

    settings = settings_with(params=params, data=data)
    tuning = _tuning(settings)
    with database_of(settings, reading=True) as database:
        parameters = parameters_in_force(settings, database)
        looked_over = OwnExperiments(database).checked(text_in(file), parameters, tuning)
        peaks = _peaks(database, looked_over, parameters, tuning)
    checked = looked_over.view(peaks)
    if as_json:
        print_json(checked.model_dump())
        return
    changes = f", {checked.changes_of_tuning} changes of the tuning" if checked.changes_of_tuning else ""
    segments = counted(checked.segments, "segment")
    words = f"{checked.name} can be run: {checked.duration_s:.6g} s in {segments}{changes}"
    out.print(words, highlight=False, markup=False)
    if checked.peak_voltage_V is not None and checked.min_tension_N is not None and checked.max_tension_N is not None:
        reach = f"tensions {checked.min_tension_N:.3g} to {checked.max_tension_N:.3g} N"
        out.print(f"on the simulator: {checked.peak_voltage_V:.3g} V at most, {reach}", highlight=False, markup=False)


@app.command()
def keep(file: File, params: ParameterSet = None, data: DataFolder = None, as_json: AsJson = False) -> None:
    """Keep an experiment as the next version of its name; one that could not be run is refused."""
    from backend.archive.own_experiments import OwnExperiments

    settings = settings_with(params=params, data=data)
    tuning = _tuning(settings)
    with database_of(settings) as database:
        own = OwnExperiments(database)
        kept = own.keep(text_in(file), current_user(), parameters_in_force(settings, database), tuning)
    if as_json:
        print_json({"name": kept.name, "version": kept.version})
    else:
        out.print(f"kept as {kept.name}@{kept.version}", highlight=False, markup=False)


@app.command()
def schema() -> None:
    """Print the JSON schema of an experiment, for editors."""
    from backend.experiments.schema import schema as schema_of

    print_json(schema_of())


def _peaks(
    database: "Database", checked: "Checked", parameters: "PlantParameters", tuning: "TuningChoice"
) -> "dict[str, float | None]":
    """Play an experiment on a simulator of its own, with its banks, and return its figures by name."""
    from tempfile import TemporaryDirectory

    from backend.execution.runner import Order, banks_of
    from backend.execution.simulation import dry_run
    from backend.experiments.plans import LoopSettings
    from backend.storage import banks

    plan = checked.plan
    numbers = {tuning.bank, *banks_of(plan)}
    with database.reading() as session:
        used = [bank for bank in banks.find(session) if bank.id in numbers]
    order = Order(plan, LoopSettings(**tuning.document()), current_user())
    with TemporaryDirectory() as folder:
        played = dry_run(parameters, order, used, ("q",), 2, Path(folder))
    figures = () if played.result is None else played.result.metrics.figures
    return {figure.name: figure.value for figure in figures}


def _tuning(settings: Settings) -> "TuningChoice":
    from backend.banks.tuning_settings import TuningChoice

    return TuningChoice.of(in_force(settings).parts)
