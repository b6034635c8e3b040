"""``sinew experiment``, ``experiments`` and ``queue``."""

import asyncio
import getpass
import os
import sys
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Protocol, TypeVar

import typer

from backend.cli.options import (
    DataFolder,
    ParameterSet,
    PlantName,
    RunningService,
    StationName,
    VirtualCard,
    WiringFile,
    database_of,
    load_settings,
    parameters_in_force,
    running_service,
)
from backend.cli.output import AsJson, angle_unit, errors, fail, meter, out, print_json, print_table, show_run
from backend.plain_text import as_line, as_lines
from backend.settings import Settings
from backend.units import counted

if TYPE_CHECKING:
    from backend.banks import TuningSettings
    from backend.execution import RunRequest, RunResult
    from backend.experiments import ExperimentDefinition, LoopSettings
    from backend.models import Setting
    from backend.reports import RunData
    from backend.schemas import QueueView, TaskView
    from backend.services import ExperimentCheck, RobustnessCache
    from backend.storage import Database
    from plant import PlantParameters


# Ordering ------------------------------------------------------------------------------------------
#
# What ``experiment`` and ``identify`` share: settings from words, a headless run, its result on the
# screen.


_Plan = TypeVar("_Plan")


@dataclass(frozen=True)
class _Played:
    """How an order went, all that is stored of it, and the files that were written."""

    outcome: "RunResult"
    source: "RunData"
    files: tuple[Path, ...]

    def document(self) -> dict[str, Any]:
        """Return what a program wants to know of it."""
        from backend.reports import build_metrics_document

        return {**build_metrics_document(self.source), "files": [str(path) for path in self.files]}


class _Play(Protocol):
    def __call__(
        self, order: "RunRequest", folder: Path | None, *, hidden: bool, own_folder: bool = False
    ) -> _Played: ...


def values_of(words: list[str]) -> dict[str, object]:
    """Return named values from ``key=value`` words; one that is not of that form ends the command."""
    values: dict[str, object] = {}
    for word in words:
        name, equals, value = word.partition("=")
        if not equals or not name:
            fail(f"--set {word}: write key=value, for example --set lam_q=0.6", status=2)
        values[name.strip()] = value.strip()
    return values


@dataclass(frozen=True)
class RunConfiguration:
    """A tuning that holds where nothing is said, part by part, and in words where it comes from."""

    parts: dict[str, object]
    origin: str


def ordered(
    settings: "Sequence[Setting]",
    make: "Callable[[Mapping[str, object]], _Plan]",
    values: dict[str, object],
    standing: RunConfiguration,
) -> "tuple[_Plan, LoopSettings, str]":
    """Return a plan that has ``settings`` and is made by ``make``, and loop settings: what is said, else what stands.

    The text says of each part of the tuning where it comes from. Raises SettingError, OutOfRangeError.
    """
    from backend.experiments import split_values
    from backend.models import complete_motion

    values = complete_motion(values)
    chosen, loop = split_values(settings, make, {**standing.parts, **values})
    parts = [f"{text} ({'set' if name in values else standing.origin})" for name, text in loop.parts_in_words().items()]
    return chosen, loop, f"tuning: {', '.join(parts)}"


def in_force(settings: Settings) -> RunConfiguration:
    """Return the tuning that the dashboard left in force for this plant; the defaults where none can be used."""
    from backend.banks import tuning_settings
    from backend.errors import OutOfRangeError
    from backend.models import SettingError, UnreadableDocumentError

    _figures().load()
    with database_of(settings, reading=True) as database:
        parameters = parameters_in_force(settings, database)
        try:
            kept = tuning_settings.newest_tuning(database, parameters)
        except (SettingError, OutOfRangeError, UnreadableDocumentError) as error:
            errors.print(f"defaults: the tuning in force is refused, {error}", highlight=False, markup=False)
            return _defaults(parameters)
    if kept is None:
        return _defaults(parameters)
    if not kept.same_plant:
        errors.print("defaults: the tuning in force is for other parameters of the plant", highlight=False)
        return _defaults(parameters)
    return RunConfiguration(kept.choice.document(), "in force")


def _defaults(parameters: "PlantParameters") -> RunConfiguration:
    from backend.banks import default_tuning_choice

    default = default_tuning_choice(parameters)
    if default.moved:
        errors.print(default.moved, highlight=False, markup=False, soft_wrap=True)
    return RunConfiguration(default.choice.document(), "default")


Together = Callable[[Sequence["RunData"]], tuple[dict[str, Any], str]]
"""What runs say together: entries for the document of each, and a line for people."""


def run_headless(
    settings: Settings,
    order: "RunRequest",
    tuning: str,
    folder: Path | None,
    *,
    as_json: bool,
    together: Together | None = None,
) -> None:
    """Play an order on the simulator, store it, and show what came of it; exit 1 when it did not complete."""
    with _bench(settings, order) as play:
        _say(tuning, as_json=as_json)
        played = play(order, folder, hidden=as_json)
        entries, line = together([played.source]) if together else ({}, "")
        if as_json:
            print_json(played.document() | entries)
        else:
            show_run(played.source, played.files)
            _say_line(line)
    _end_status(played.outcome)


def run_in_turn(
    settings: Settings,
    orders: "Sequence[RunRequest]",
    tuning: str,
    folder: Path | None,
    *,
    as_json: bool,
    together: Together | None = None,
) -> None:
    """Play orders one after the other, files in a folder per run; one that does not complete ends the sequence."""
    documents, sources = [], []
    with _bench(settings, orders[0]) as play:
        _say(tuning, as_json=as_json)
        for order in orders:
            played = play(order, folder, hidden=as_json, own_folder=True)
            documents.append(played.document())
            sources.append(played.source)
            if not as_json:
                show_run(played.source, played.files)
            if played.outcome.run.end_state != "completed" or played.outcome.evaluation.problem:
                break
    entries, line = together(sources) if together else ({}, "")
    if as_json:
        print_json([document | entries for document in documents])
    else:
        _say_line(line)
    _end_status(played.outcome)


@contextmanager
def _bench(settings: Settings, first: "RunRequest") -> "Iterator[_Play]":
    """Open database and simulator, both set for ``first``, and give what plays an order there."""
    from backend.data_folder import playing_in
    from backend.execution import open_headless_rig, run_experiment
    from backend.reports import load_source

    with (
        database_of(settings) as database,
        playing_in(settings.data),
        open_headless_rig(
            database, parameters_in_force(settings, database), first.loop_settings, settings.plant_choice
        ) as station,
    ):

        def play(order: "RunRequest", folder: Path | None, *, hidden: bool, own_folder: bool = False) -> _Played:
            with meter(order.plan.program().duration_s, hidden=hidden) as progress:
                outcome = asyncio.run(run_experiment(station, order, progress))
            into = folder / f"run-{outcome.run.id}" if folder and own_folder else folder
            written: tuple[Path, ...] = ()
            if into:
                from backend.reports import write_report_files  # draws, for which most runs need not wait

                written = write_report_files(database, outcome.run.id, into, angle_unit())
            return _Played(outcome, load_source(database, outcome.run.id), written)

        yield play
    _figures().save()


@cache
def _figures() -> "RobustnessCache":
    """Return what commands before, and the service, have computed for a tuning."""
    from backend.services import RobustnessCache

    return RobustnessCache()


def current_user() -> str:
    """Return who runs the command, for the record: the account's name, or its number where it has none."""
    try:
        return getpass.getuser()
    except (KeyError, OSError):  # KeyError until Python 3.12
        return str(os.getuid())


def _say(tuning: str, *, as_json: bool) -> None:
    """Say what the gains come from, once it is accepted."""
    if not as_json:
        out.print(tuning, highlight=False, markup=False, soft_wrap=True)


def _say_line(line: str) -> None:
    if line:
        out.print(line, highlight=False, markup=False, soft_wrap=True)


def _end_status(outcome: "RunResult") -> None:
    from backend.storage import EndState

    if outcome.run.end_state != EndState.COMPLETED:
        fail(f"run {outcome.run.id} {outcome.run.end_state}: {outcome.run.end_detail or 'no further reason known'}")
    if outcome.evaluation.problem:
        fail(f"run {outcome.run.id}: {outcome.evaluation.problem}", status=2)


# Experiment ----------------------------------------------------------------------------------------
#
# ``sinew experiment``.


SetWords = Annotated[
    list[str] | None,
    typer.Option("--set", metavar="KEY=VALUE", help="Setting of the experiment or the loop, in SI units; repeatable."),
]
OutFolder = Annotated[
    Path | None, typer.Option("--out", help="Folder for report.html, report.pdf, data.csv and metrics.json.")
]


def experiment(
    names: Annotated[
        list[str],
        typer.Argument(
            metavar="NAME...",
            help="Which experiment: a name of sinew experiments list, name@2, or a file of one; several play in turn.",
        ),
    ],
    values: SetWords = None,
    controller: Annotated[
        str | None,
        typer.Option("--controller", help="Of tracking: cascade, single-loop or feedback-linearization."),
    ] = None,
    out: OutFolder = None,
    plant: PlantName = None,
    virtual_card: VirtualCard = None,
    wiring: WiringFile = None,
    params: ParameterSet = None,
    data: DataFolder = None,
    station: StationName = None,
    as_json: AsJson = False,
) -> None:
    """Run experiments headless on the simulator, faster than real time; stored like those from the browser.

    Several play in turn, each with the settings that are said, until one does not complete; their files go to a folder
    for each run.

    Its settings, such as q_amplitude [rad], S_hold [N·m/rad] or hold_s [s], are told by sinew experiments show NAME.
    Settings of the loop: lam_q, lam_S, lam_motor [s], b (0 to 1), bank (number, 0 for gains from geometry),
    interpolate (true, false), seed. What is not set is as it is in force in the data folder.
    """
    from backend.execution import RunRequest

    chosen = values_of(values or []) | ({} if controller is None else {"controller": controller})
    settings = load_settings(
        plant=plant, virtual_card=virtual_card, wiring=wiring, params=params, data=data, station=station
    )
    standing, who = in_force(settings), current_user()
    orders = []
    for name in names:
        entry = entry_of(name, settings)
        plan, loop_settings, tuning = ordered(entry.settings, entry.make, chosen, standing)
        orders.append(RunRequest(plan, loop_settings, who))
    if len(orders) == 1:
        run_headless(settings, orders[0], tuning, out, as_json=as_json)
    else:
        run_in_turn(settings, orders, tuning, out, as_json=as_json)


def entry_of(name: str, settings: Settings) -> "ExperimentDefinition":
    """Return the experiment of a name or a file. Raises SettingError, ExperimentError."""
    from backend.experiments import library, parser
    from backend.services import OwnExperiments

    if Path(name).suffix in (".yaml", ".yml", ".json"):
        return library.build_library_entry(*parser.read(text_in(Path(name))))
    if name in library.experiments_by_name():
        tell_deprecated(name)
        return library.find_experiment(name)
    with database_of(settings, reading=True) as database:
        return OwnExperiments(database).entry(name)


def tell_deprecated(name: str) -> None:
    """Say of an experiment that is not offered any more what to order in its place."""
    from backend.experiments import experiments_by_name

    entry = experiments_by_name().get(name)
    if entry is not None and entry.instead:
        errors.print(f"{name} is deprecated: {entry.instead}", highlight=False, markup=False)


def text_in(file: Path) -> str:
    """Return what a file says; one that cannot be read ends the command."""
    try:
        return file.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        fail(f"{file} cannot be read: {error}", status=2)


# Experiments ---------------------------------------------------------------------------------------
#
# ``sinew experiments``: those there are, looking one over, keeping own ones.


experiments_app = typer.Typer(
    help="Experiments: list, show, look over, keep own ones.", no_args_is_help=True, rich_markup_mode=None
)
File = Annotated[Path, typer.Argument(help="File of an experiment, YAML or JSON.")]
Name = Annotated[str, typer.Argument(help="Name of an experiment, name@2 for a version, or a file.")]


@experiments_app.command("list")
def list_experiments(data: DataFolder = None, as_json: AsJson = False) -> None:
    """List all experiments that can be run, own ones in their newest version."""
    from backend.services import OwnExperiments

    with database_of(load_settings(data=data), reading=True) as database:
        found = OwnExperiments(database).all()
    rows = [(entry.name, entry.title, f"{entry.usual.program().duration_s:.6g}") for entry in found]
    if as_json:
        print_json([{"name": name, "title": title, "duration_s": float(lasts)} for name, title, lasts in rows])
    else:
        print_table(("experiment", "title", "lasts [s]"), rows)


@experiments_app.command("show")
def show_experiment(name: Name, data: DataFolder = None, as_json: AsJson = False) -> None:
    """Show the settings of an experiment, with unit, default and bounds."""
    entry = entry_of(name, load_settings(data=data))
    if as_json:
        print_json([asdict(setting) for setting in entry.settings])
        return
    out.print(f"{entry.title}. {' '.join(entry.description.split())}", highlight=False, markup=False)
    rows = [
        (s.name, f"{s.default}", ", ".join(s.choices or ()) or f"{s.minimum} to {s.maximum}", s.unit, s.meaning)
        for s in entry.settings
    ]
    print_table(("setting", "default", "bounds", "unit", "meaning"), rows)


@experiments_app.command()
def text(name: Name, data: DataFolder = None) -> None:
    """Print the text of an experiment, to keep it elsewhere or to begin an own one with."""
    from backend.services import OwnExperiments

    with database_of(load_settings(data=data), reading=True) as database:
        written = OwnExperiments(database).written(name).text
    print(as_lines(written) if sys.stdout.isatty() else written, end="")


@experiments_app.command()
def check(file: File, params: ParameterSet = None, data: DataFolder = None, as_json: AsJson = False) -> None:
    """Look an experiment over as a start would: nothing moves, nothing is kept."""
    from backend.services import OwnExperiments

    settings = load_settings(params=params, data=data)
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


@experiments_app.command()
def keep(file: File, params: ParameterSet = None, data: DataFolder = None, as_json: AsJson = False) -> None:
    """Keep an experiment as the next version of its name; one that could not be run is refused."""
    from backend.services import OwnExperiments

    settings = load_settings(params=params, data=data)
    tuning = _tuning(settings)
    with database_of(settings) as database:
        own = OwnExperiments(database)
        kept = own.keep(text_in(file), current_user(), parameters_in_force(settings, database), tuning)
    if as_json:
        print_json({"name": kept.name, "version": kept.version})
    else:
        out.print(f"kept as {kept.name}@{kept.version}", highlight=False, markup=False)


@experiments_app.command()
def schema() -> None:
    """Print the JSON schema of an experiment, for editors."""
    from backend.experiments import build_json_schema as schema_of

    print_json(schema_of())


def _peaks(
    database: "Database", checked: "ExperimentCheck", parameters: "PlantParameters", tuning: "TuningSettings"
) -> "dict[str, float | None]":
    """Play an experiment on a simulator of its own, with its banks, and return its figures by name."""
    from tempfile import TemporaryDirectory

    from backend.execution import RunRequest, dry_run, list_plan_banks
    from backend.experiments import LoopSettings
    from backend.storage import banks

    plan = checked.plan
    numbers = {tuning.bank, *list_plan_banks(plan)}
    with database.reading() as session:
        used_banks = [bank for bank in banks.find(session) if bank.id in numbers]
    request = RunRequest(plan, LoopSettings(**tuning.document()), current_user())
    with TemporaryDirectory() as folder:
        simulated = dry_run(
            parameters=parameters,
            request=request,
            used_banks=used_banks,
            signals=("q",),
            points=2,
            folder=Path(folder),
        )
    figures = () if simulated.result is None else simulated.result.metrics.figures
    return {figure.name: figure.value for figure in figures}


def _tuning(settings: Settings) -> "TuningSettings":
    from backend.banks import TuningSettings

    return TuningSettings.of(in_force(settings).parts)


# Queue ---------------------------------------------------------------------------------------------
#
# ``sinew queue``: the queue of the running service, as its page Experiments shows it.


queue_app = typer.Typer(
    help="Experiments that wait for their turn at the running service.", no_args_is_help=True, rich_markup_mode=None
)

Item = Annotated[int, typer.Argument(metavar="ITEM", help="Number of a waiting experiment, as `show` lists it.")]
_LOOK_S = 0.5


@queue_app.command("show")
def show_queue(data: DataFolder = None, as_json: AsJson = False) -> None:
    """List what waits, in order, and tell what runs with the time that is left."""
    service = running_service(load_settings(data=data))
    _show(service, _queue(service), as_json=as_json)


@queue_app.command()
def add(
    name: Annotated[str, typer.Argument(help="Experiment, ready-made or kept: tracking, mine, mine@2.")],
    values: Annotated[list[str] | None, typer.Option("--set", help="key=value, in SI; 60deg is an angle.")] = None,
    data: DataFolder = None,
    as_json: AsJson = False,
) -> None:
    """Put an experiment at the end; it waits with the tuning that is in force now. Nothing starts by that."""
    service = running_service(load_settings(data=data))
    request = {"name": name, "settings": values_of(values or [])}
    waiting = _queue(service, "POST", "", request)
    tell_deprecated(name)
    _show(service, waiting, as_json=as_json)


@queue_app.command()
def move(
    item: Item,
    place: Annotated[int, typer.Argument(min=1, help="Where it is to wait: 1 is the next one.")],
    data: DataFolder = None,
    as_json: AsJson = False,
) -> None:
    """Let an experiment wait at another place."""
    service = running_service(load_settings(data=data))
    _show(service, _queue(service, "PUT", f"/{item}/place", {"place": place - 1}), as_json=as_json)


@queue_app.command()
def remove(item: Item, data: DataFolder = None, as_json: AsJson = False) -> None:
    """Take a waiting experiment out."""
    service = running_service(load_settings(data=data))
    _show(service, _queue(service, "DELETE", f"/{item}"), as_json=as_json)


@queue_app.command()
def run(
    watch: Annotated[
        bool, typer.Option(help="Show how far it is until the queue stands; Ctrl-C ends the look only.")
    ] = True,
    data: DataFolder = None,
    as_json: AsJson = False,
) -> None:
    """Start the first experiment and go on until none is left, it is paused, or one does not complete: exit 1 then."""
    service = running_service(load_settings(data=data))
    found = _queue(service, "POST", "/run")
    if watch:
        found = _watch(service, hidden=as_json)
    _show(service, found, as_json=as_json)
    if found.problem:
        fail(f"the queue is {found.problem}")


@queue_app.command()
def pause(data: DataFolder = None, as_json: AsJson = False) -> None:
    """Pause behind the experiment that runs: there the references stand still and the tendons are taut."""
    service = running_service(load_settings(data=data))
    _show(service, _queue(service, "POST", "/hold"), as_json=as_json)


@queue_app.command()
def stop(data: DataFolder = None, as_json: AsJson = False) -> None:
    """STOP the actuator, as the red button does; what runs is kept and ends as stopped, what waits goes on waiting."""
    from backend.schemas import StopProof

    service = running_service(load_settings(data=data))
    service.ask("POST", "/stop", None, StopProof)
    _show(service, _queue(service), as_json=as_json)


def _queue(service: RunningService, method: str = "GET", path: str = "", body: Any = None) -> "QueueView":
    """Order something of the queue, or look at it: the answer is what waits."""
    from backend.schemas import QueueView

    return service.ask(method, f"/experiments/queue{path}", body, QueueView)


def _task(service: RunningService) -> "TaskView | None":
    from backend.schemas import State

    return service.ask("GET", "/state", None, State).task


def _watch(service: RunningService, *, hidden: bool) -> "QueueView":
    """Show how far the runs of the queue are until none is under way and none starts by itself."""
    from rich.progress import BarColumn, Progress, TextColumn

    columns = (TextColumn("{task.description}", markup=False), BarColumn(), TextColumn("{task.fields[left]}"))
    with Progress(*columns, console=errors, disable=hidden, transient=True) as progress:
        bar = progress.add_task("starting", total=1.0, left="")
        while True:
            found = _queue(service)
            task = _task(service)
            if task is None and found.run is None and not found.running:
                return found
            if task is not None:
                words = as_line(f"run {task.run}, {task.phase}; {len(found.items)} wait")
                total = max(task.duration_s, 1e-9)
                progress.update(bar, description=words, total=total, completed=task.elapsed_s, left=_left(task))
            time.sleep(_LOOK_S)


def _left(task: "TaskView") -> str:
    return f"{max(0.0, task.duration_s - task.elapsed_s):.0f} s left"


def _show(service: RunningService, found: "QueueView", *, as_json: bool) -> None:
    if as_json:
        print_json(found.model_dump(mode="json"))
        return
    rows = [
        (
            place,
            item.id,
            item.name,
            " ".join(f"{name}={value}" for name, value in item.settings.items()),
            f"{item.who}, kept" if item.kept else item.who,
        )
        for place, item in enumerate(found.items, start=1)
    ]
    if rows:
        print_table(("place", "item", "experiment", "settings", "by"), rows)
    else:
        out.print("nothing waits", highlight=False)
    task = _task(service)
    if task is not None:
        out.print(f"run {task.run} is under way: {task.kind}, {_left(task)}", highlight=False, markup=False)
    out.print("the queue goes on by itself" if found.running else "the queue waits for a start", highlight=False)
    if found.problem:
        out.print(found.problem, highlight=False, markup=False, soft_wrap=True)
