"""Commands ``sinew experiment``, ``experiments`` and ``queue``, and headless runs."""

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

from backend.cli import messages
from backend.cli.options import (
    DataFolder,
    ParameterSet,
    PlantName,
    RunningService,
    StationName,
    VirtualCard,
    WiringFile,
    find_running_service,
    load_plant_parameters,
    load_settings,
    open_configured_database,
)
from backend.cli.output import (
    AsJson,
    angle_unit,
    console,
    error_console,
    fail,
    print_json,
    print_run,
    print_table,
    show_progress,
)
from backend.plain_text import escape_line, escape_lines
from backend.settings import Settings

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


# Settings of a run ---------------------------------------------------------------------------------


_Plan = TypeVar("_Plan")


def parse_values(words: list[str]) -> dict[str, object]:
    """Return the values of ``key=value`` words by key.

    A word of another form ends the command.
    """
    values: dict[str, object] = {}
    for word in words:
        name, equals, value = word.partition("=")
        if not equals or not name:
            fail(messages.not_a_setting(word=word), status=2)
        values[name.strip()] = value.strip()
    return values


@dataclass(frozen=True)
class BaseTuning:
    """Tuning parts that a command does not set, with their origin as text."""

    parts: dict[str, object]
    origin: str


def resolve_settings(
    settings: "Sequence[Setting]",
    make: "Callable[[Mapping[str, object]], _Plan]",
    values: dict[str, object],
    base: BaseTuning,
) -> "tuple[_Plan, LoopSettings, str]":
    """Return plan, loop settings, and a text with the origin of each tuning part.

    ``make`` builds the plan, which has ``settings``. ``values`` are those that the command sets; ``base`` completes
    the tuning. Raises SettingError, OutOfRangeError.
    """
    from backend.experiments import split_values
    from backend.models import complete_motion

    values = complete_motion(values)
    plan, loop = split_values(settings, make, {**base.parts, **values})
    parts = [(text, "set" if name in values else base.origin) for name, text in loop.format_parts().items()]
    return plan, loop, messages.tuning_of_run(parts=parts)


def load_active_tuning(settings: Settings) -> BaseTuning:
    """Return the tuning last used for this plant, or the defaults if none is usable."""
    from backend.banks import tuning_settings
    from backend.errors import OutOfRangeError
    from backend.models import SettingError, UnreadableDocumentError

    _robustness_cache().load()
    with open_configured_database(settings, read_only=True) as database:
        parameters = load_plant_parameters(settings, database)
        try:
            stored = tuning_settings.load_last_tuning(database, parameters)
        except (SettingError, OutOfRangeError, UnreadableDocumentError) as error:
            error_console.print(
                messages.tuning_not_valid(reason=str(error)),
                highlight=False,
                markup=False,
            )
            return _build_default_tuning(parameters)
    if stored is None:
        return _build_default_tuning(parameters)
    if not stored.same_plant:
        error_console.print(messages.tuning_of_other_parameters(), highlight=False)
        return _build_default_tuning(parameters)
    return BaseTuning(stored.tuning.to_document(), "active")


def current_user() -> str:
    """Return the name of the user's account, or its number if it has none."""
    try:
        return getpass.getuser()
    except (KeyError, OSError):  # KeyError until Python 3.12
        return str(os.getuid())


def _build_default_tuning(parameters: "PlantParameters") -> BaseTuning:
    from backend.banks import compute_default_tuning

    default = compute_default_tuning(parameters)
    if default.moved:
        error_console.print(default.moved, highlight=False, markup=False, soft_wrap=True)
    return BaseTuning(default.tuning.to_document(), "default")


# Headless runs -------------------------------------------------------------------------------------


CombineRuns = Callable[[Sequence["RunData"]], tuple[dict[str, Any], str]]
"""Computes a result of several runs: entries for the JSON document of each, and a line of text."""


@dataclass(frozen=True)
class _HeadlessRun:
    """A finished run with its stored data and the files written for it."""

    result: "RunResult"
    source: "RunData"
    files: tuple[Path, ...]

    def document(self) -> dict[str, Any]:
        """Return metrics and file names as a JSON document."""
        from backend.reports import build_metrics_document

        return {**build_metrics_document(self.source), "files": [str(path) for path in self.files]}


class _RunFunction(Protocol):
    def __call__(
        self, request: "RunRequest", folder: Path | None, *, hidden: bool, own_folder: bool = False
    ) -> _HeadlessRun: ...


def run_headless(
    settings: Settings,
    request: "RunRequest",
    tuning: str,
    folder: Path | None,
    *,
    as_json: bool,
    combine: CombineRuns | None = None,
) -> None:
    """Run one experiment on the simulator, store and print it.

    Exit 1 if it does not complete. ``tuning`` is the text to print before the run, ``folder`` receives the report
    files.
    """
    with _open_simulator(settings, request) as run_one:
        _print_line("" if as_json else tuning)
        done = run_one(request, folder, hidden=as_json)
        entries, line = combine([done.source]) if combine else ({}, "")
        if as_json:
            print_json(done.document() | entries)
        else:
            print_run(done.source, done.files)
            _print_line(line)
    _fail_unless_completed(done.result)


def run_headless_sequence(
    settings: Settings,
    requests: "Sequence[RunRequest]",
    tuning: str,
    folder: Path | None,
    *,
    as_json: bool,
    combine: CombineRuns | None = None,
) -> None:
    """Run experiments until one does not complete, each with a folder of files."""
    documents, sources = [], []
    with _open_simulator(settings, requests[0]) as run_one:
        _print_line("" if as_json else tuning)
        for request in requests:
            done = run_one(request, folder, hidden=as_json, own_folder=True)
            documents.append(done.document())
            sources.append(done.source)
            if not as_json:
                print_run(done.source, done.files)
            if done.result.run.end_state != "completed" or done.result.evaluation.problem:
                break
    entries, line = combine(sources) if combine else ({}, "")
    if as_json:
        print_json([document | entries for document in documents])
    else:
        _print_line(line)
    _fail_unless_completed(done.result)


@contextmanager
def _open_simulator(settings: Settings, first: "RunRequest") -> "Iterator[_RunFunction]":
    """Open database and simulator, and yield the function that runs a request.

    The simulator has the loop settings of ``first``.
    """
    from backend.data_folder import lock_for_command
    from backend.execution import open_headless_rig, run_experiment
    from backend.reports import load_source

    with (
        open_configured_database(settings) as database,
        lock_for_command(settings.data),
        open_headless_rig(
            database, load_plant_parameters(settings, database), first.loop_settings, settings.plant_choice
        ) as rig,
    ):

        def run_one(
            request: "RunRequest", folder: Path | None, *, hidden: bool, own_folder: bool = False
        ) -> _HeadlessRun:
            with show_progress(request.plan.program().duration_s, hidden=hidden) as progress:
                result = asyncio.run(run_experiment(rig, request, progress))
            run_folder = folder / f"run-{result.run.id}" if folder and own_folder else folder
            files: tuple[Path, ...] = ()
            if run_folder:
                from backend.reports import write_report_files  # slow import, which most runs do not need

                files = write_report_files(database, result.run.id, run_folder, angle_unit())
            return _HeadlessRun(result, load_source(database, result.run.id), files)

        yield run_one
    _robustness_cache().save()


@cache
def _robustness_cache() -> "RobustnessCache":
    """Return the cache of results that service and commands compute for a tuning."""
    from backend.services import RobustnessCache

    return RobustnessCache()


def _print_line(line: str) -> None:
    if line:
        console.print(line, highlight=False, markup=False, soft_wrap=True)


def _fail_unless_completed(result: "RunResult") -> None:
    from backend.storage import EndState

    run = result.run
    if run.end_state != EndState.COMPLETED:
        fail(messages.run_not_completed(run_id=run.id, end=run.end_state, reason=run.end_detail))
    if result.evaluation.problem:
        fail(messages.problem_of_run(run_id=run.id, reason=result.evaluation.problem), status=2)


# sinew experiment ----------------------------------------------------------------------------------


SetWords = Annotated[
    list[str] | None,
    typer.Option(
        "--set", metavar="KEY=VALUE", help="Setting of the experiment or the control loop, in SI units; repeatable."
    ),
]
OutFolder = Annotated[
    Path | None, typer.Option("--out", help="Folder for report.html, report.pdf, data.csv and metrics.json.")
]


def experiment(
    names: Annotated[
        list[str],
        typer.Argument(
            metavar="NAME...",
            help="Name from sinew experiments list, name@2 for a version, or a file; several are run in sequence.",
        ),
    ],
    values: SetWords = None,
    controller: Annotated[
        str | None,
        typer.Option("--controller", help="Control law of tracking: cascade, single-loop or feedback-linearization."),
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
    """Run experiments on a simulated plant, faster than real time, and store them.

    Several experiments run one after the other with the same settings, until one does not complete. Each run then
    writes its files to its own subfolder.

    sinew experiments show NAME lists the settings, such as q_amplitude [rad], S_hold [N·m/rad] or hold_s [s].
    Settings of the control loop: lam_q, lam_S, lam_motor [s], b (0 to 1), bank (number, 0 for geometric gains),
    interpolate (true, false), motion (lambda, time-optimal), u_plan [V], k_ext (0 to 1), seed. Omitted tuning
    settings come from the active tuning in the data folder.
    """
    from backend.execution import RunRequest

    chosen = parse_values(values or []) | ({} if controller is None else {"controller": controller})
    settings = load_settings(
        plant=plant, virtual_card=virtual_card, wiring=wiring, params=params, data=data, station=station
    )
    base, who = load_active_tuning(settings), current_user()
    requests = []
    for name in names:
        definition = find_definition(name, settings)
        plan, loop_settings, tuning = resolve_settings(definition.settings, definition.make_plan, chosen, base)
        requests.append(RunRequest(plan, loop_settings, who))
    if len(requests) == 1:
        run_headless(settings, requests[0], tuning, out, as_json=as_json)
    else:
        run_headless_sequence(settings, requests, tuning, out, as_json=as_json)


def find_definition(name: str, settings: Settings) -> "ExperimentDefinition":
    """Return the experiment with this name, or in this file.

    Raises SettingError, ExperimentError.
    """
    from backend.experiments import library, parser
    from backend.services import OwnExperiments
    from plant import load_parameters

    if Path(name).suffix in (".yaml", ".yml", ".json"):
        return library.build_experiment_definition(*parser.parse_experiment(read_text_file(Path(name))))
    if name in library.experiments_by_name():
        warn_if_deprecated(name)
        return library.build_fitted_definition(name, load_parameters(settings.params))
    with open_configured_database(settings, read_only=True) as database:
        return OwnExperiments(database).find_definition(name)


def warn_if_deprecated(name: str) -> None:
    """Print the replacement of a deprecated experiment."""
    from backend.experiments import experiments_by_name

    definition = experiments_by_name().get(name)
    if definition is not None and definition.replacement:
        error_console.print(
            messages.deprecated(name=name, replacement=definition.replacement), highlight=False, markup=False
        )


def read_text_file(file: Path) -> str:
    """Return the text of a file; an unreadable file ends the command."""
    try:
        return file.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        fail(messages.file_not_read(file=file, reason=str(error)), status=2)


# sinew experiments ---------------------------------------------------------------------------------


experiments_app = typer.Typer(
    help="Experiments: list, show, check, store your own.", no_args_is_help=True, rich_markup_mode=None
)
File = Annotated[Path, typer.Argument(help="File of an experiment, YAML or JSON.")]
Name = Annotated[str, typer.Argument(help="Name of an experiment, name@2 for a version, or a file.")]


@experiments_app.command("list")
def list_experiments(data: DataFolder = None, as_json: AsJson = False) -> None:
    """List all experiments, your own with their newest version."""
    from backend.services import OwnExperiments

    with open_configured_database(load_settings(data=data), read_only=True) as database:
        found = OwnExperiments(database).list_definitions()
    rows = [(one.name, one.title, f"{one.default_plan.program().duration_s:.6g}") for one in found]
    if as_json:
        print_json([{"name": name, "title": title, "duration_s": float(duration)} for name, title, duration in rows])
    else:
        print_table(("experiment", "title", "duration [s]"), rows)


@experiments_app.command("show")
def show_experiment(name: Name, data: DataFolder = None, as_json: AsJson = False) -> None:
    """Show the settings of an experiment with unit, default and bounds."""
    definition = find_definition(name, load_settings(data=data))
    if as_json:
        print_json([asdict(setting) for setting in definition.settings])
        return
    console.print(f"{definition.title}. {' '.join(definition.description.split())}", highlight=False, markup=False)
    rows = [
        (
            s.name,
            f"{s.default}",
            ", ".join(s.choices or ()) or messages.bounds(minimum=s.minimum, maximum=s.maximum),
            s.unit,
            s.meaning,
        )
        for s in definition.settings
    ]
    print_table(("setting", "default", "bounds", "unit", "meaning"), rows)


@experiments_app.command()
def text(
    name: Annotated[str, typer.Argument(help="Name of an experiment, or name@2 for a version.")],
    data: DataFolder = None,
) -> None:
    """Print the text of an experiment, for a copy or as a template."""
    from backend.services import OwnExperiments

    with open_configured_database(load_settings(data=data), read_only=True) as database:
        source = OwnExperiments(database).load_text(name).text
    print(escape_lines(source) if sys.stdout.isatty() else source, end="")


@experiments_app.command()
def check(file: File, params: ParameterSet = None, data: DataFolder = None, as_json: AsJson = False) -> None:
    """Check an experiment as at its start, and simulate it; nothing is stored."""
    from backend.services import OwnExperiments

    settings = load_settings(params=params, data=data)
    tuning = _load_tuning_settings(settings)
    with open_configured_database(settings, read_only=True) as database:
        parameters = load_plant_parameters(settings, database)
        found = OwnExperiments(database).check(read_text_file(file), parameters, tuning)
        peaks = _simulate_metrics(database, found, parameters, tuning)
    checked = found.build_view(peaks)
    if as_json:
        print_json(checked.model_dump())
        return
    text = messages.experiment_valid(
        name=checked.name,
        duration_s=checked.duration_s,
        segments=checked.segments,
        changes_of_tuning=checked.changes_of_tuning,
    )
    console.print(text, highlight=False, markup=False)
    if checked.peak_voltage_V is not None and checked.min_tension_N is not None and checked.max_tension_N is not None:
        text = messages.simulated_extremes(
            u_max=checked.peak_voltage_V, F_min=checked.min_tension_N, F_max=checked.max_tension_N
        )
        console.print(text, highlight=False, markup=False)


@experiments_app.command("keep")
def save(file: File, params: ParameterSet = None, data: DataFolder = None, as_json: AsJson = False) -> None:
    """Store a valid experiment as the next version of its name."""
    from backend.services import OwnExperiments

    settings = load_settings(params=params, data=data)
    tuning = _load_tuning_settings(settings)
    with open_configured_database(settings) as database:
        own = OwnExperiments(database)
        stored = own.check_and_store(
            read_text_file(file), current_user(), load_plant_parameters(settings, database), tuning
        )
    if as_json:
        print_json({"name": stored.name, "version": stored.version})
    else:
        console.print(
            messages.experiment_saved(name=stored.name, version=stored.version), highlight=False, markup=False
        )


@experiments_app.command()
def schema() -> None:
    """Print the JSON schema of an experiment, for editors."""
    from backend.experiments import build_json_schema

    print_json(build_json_schema())


def _simulate_metrics(
    database: "Database", checked: "ExperimentCheck", parameters: "PlantParameters", tuning: "TuningSettings"
) -> "dict[str, float | None]":
    """Simulate an experiment with its banks and return its metrics by name."""
    from tempfile import TemporaryDirectory

    from backend.execution import RunRequest, dry_run, list_plan_banks
    from backend.experiments import LoopSettings
    from backend.storage import banks

    plan = checked.plan
    bank_ids = {tuning.bank, *list_plan_banks(plan)}
    with database.reading() as session:
        used_banks = [bank for bank in banks.find(session) if bank.id in bank_ids]
    request = RunRequest(plan, LoopSettings(**tuning.to_document()), current_user())
    with TemporaryDirectory() as folder:
        done = dry_run(
            parameters=parameters, request=request, used_banks=used_banks, signals=("q",), points=2, folder=Path(folder)
        )
    metrics = () if done.result is None else done.result.metrics.figures
    return {metric.name: metric.value for metric in metrics}


def _load_tuning_settings(settings: Settings) -> "TuningSettings":
    from backend.banks import TuningSettings

    return TuningSettings.from_values(load_active_tuning(settings).parts)


# sinew queue ---------------------------------------------------------------------------------------


queue_app = typer.Typer(
    help="Queue of experiments of the running service.", no_args_is_help=True, rich_markup_mode=None
)

Item = Annotated[int, typer.Argument(metavar="ITEM", help="Number of a queued experiment, as `show` lists it.")]
_POLL_S = 0.5


@queue_app.command("show")
def show_queue(data: DataFolder = None, as_json: AsJson = False) -> None:
    """List the queued experiments, and the current run with its remaining time."""
    service = find_running_service(load_settings(data=data))
    _print_queue(service, _request_queue(service), as_json=as_json)


@queue_app.command()
def add(
    name: Annotated[str, typer.Argument(help="Built-in or stored experiment, such as tracking, mine or mine@2.")],
    values: Annotated[
        list[str] | None,
        typer.Option("--set", metavar="KEY=VALUE", help="Setting of the experiment, in SI units; repeatable."),
    ] = None,
    data: DataFolder = None,
    as_json: AsJson = False,
) -> None:
    """Add an experiment with the active tuning to the queue, without starting it."""
    service = find_running_service(load_settings(data=data))
    request = {"name": name, "settings": parse_values(values or [])}
    queue = _request_queue(service, "POST", "", request)
    warn_if_deprecated(name)
    _print_queue(service, queue, as_json=as_json)


@queue_app.command()
def move(
    item: Item,
    place: Annotated[int, typer.Argument(min=1, help="New position; 1 is the next to run.")],
    data: DataFolder = None,
    as_json: AsJson = False,
) -> None:
    """Move an experiment to another position in the queue."""
    service = find_running_service(load_settings(data=data))
    _print_queue(service, _request_queue(service, "PUT", f"/{item}/place", {"place": place - 1}), as_json=as_json)


@queue_app.command()
def remove(item: Item, data: DataFolder = None, as_json: AsJson = False) -> None:
    """Remove an experiment from the queue."""
    service = find_running_service(load_settings(data=data))
    _print_queue(service, _request_queue(service, "DELETE", f"/{item}"), as_json=as_json)


@queue_app.command()
def run(
    watch: Annotated[
        bool, typer.Option(help="Show progress until the queue stops; Ctrl+C ends only the display.")
    ] = True,
    data: DataFolder = None,
    as_json: AsJson = False,
) -> None:
    """Run the queue until it is empty or paused, or until a run does not complete (exit 1)."""
    service = find_running_service(load_settings(data=data))
    queue = _request_queue(service, "POST", "/run")
    if watch:
        queue = _follow_queue(service, hidden=as_json)
    _print_queue(service, queue, as_json=as_json)
    if queue.problem:
        fail(messages.queue_ended(problem=queue.problem))


@queue_app.command()
def pause(data: DataFolder = None, as_json: AsJson = False) -> None:
    """Pause the queue after the current experiment.

    References stay constant and the tendons taut.
    """
    service = find_running_service(load_settings(data=data))
    _print_queue(service, _request_queue(service, "POST", "/hold"), as_json=as_json)


@queue_app.command()
def stop(data: DataFolder = None, as_json: AsJson = False) -> None:
    """STOP the actuator, like the red button. The current run ends as stopped.

    The queue keeps its experiments.
    """
    from backend.schemas import StopProof

    service = find_running_service(load_settings(data=data))
    service.request("POST", "/stop", None, StopProof)
    _print_queue(service, _request_queue(service), as_json=as_json)


def _request_queue(service: RunningService, method: str = "GET", path: str = "", body: Any = None) -> "QueueView":
    """Send a request about the queue and return the queue after it."""
    from backend.schemas import QueueView

    return service.request(method, f"/experiments/queue{path}", body, QueueView)


def _request_task(service: RunningService) -> "TaskView | None":
    from backend.schemas import State

    return service.request("GET", "/state", None, State).task


def _follow_queue(service: RunningService, *, hidden: bool) -> "QueueView":
    """Show the progress of the queue until it has stopped, and return it then."""
    from rich.progress import BarColumn, Progress, TextColumn

    columns = (TextColumn("{task.description}", markup=False), BarColumn(), TextColumn("{task.fields[left]}"))
    with Progress(*columns, console=error_console, disable=hidden, transient=True) as progress:
        bar = progress.add_task("starting", total=1.0, left="")
        while True:
            queue = _request_queue(service)
            task = _request_task(service)
            if task is None and queue.run is None and not queue.running:
                return queue
            if task is not None:
                text = escape_line(messages.queue_progress(run_id=task.run, phase=task.phase, queued=len(queue.items)))
                total = max(task.duration_s, 1e-9)
                left = _format_time_left(task)
                progress.update(bar, description=text, total=total, completed=task.elapsed_s, left=left)
            time.sleep(_POLL_S)


def _format_time_left(task: "TaskView") -> str:
    return messages.time_left(left_s=task.duration_s - task.elapsed_s)


def _print_queue(service: RunningService, queue: "QueueView", *, as_json: bool) -> None:
    if as_json:
        print_json(queue.model_dump(mode="json"))
        return
    rows = [
        (
            place,
            item.id,
            item.name,
            " ".join(f"{name}={value}" for name, value in item.settings.items()),
            messages.restored_item(who=item.who) if item.kept else item.who,
        )
        for place, item in enumerate(queue.items, start=1)
    ]
    if rows:
        print_table(("position", "item", "experiment", "settings", "by"), rows)
    else:
        console.print(messages.queue_empty(), highlight=False)
    task = _request_task(service)
    if task is not None:
        left = _format_time_left(task)
        console.print(
            messages.run_in_progress(run_id=task.run, kind=task.kind, left=left), highlight=False, markup=False
        )
    state = messages.queue_continues() if queue.running else messages.queue_not_running()
    console.print(state, highlight=False)
    if queue.problem:
        console.print(queue.problem, highlight=False, markup=False, soft_wrap=True)
