"""``sinew queue``: the queue of the running service, as its page Experiments shows it."""

import time
from typing import TYPE_CHECKING, Annotated, Any

import typer

from backend.cli.ordering import values_of
from backend.cli.output import AsJson, errors, fail, out, print_json, print_table
from backend.cli.place import DataFolder, settings_with
from backend.cli.running_service import RunningService, running_service
from backend.plain_text import as_line

if TYPE_CHECKING:  # schemas take a tenth of a second, which no other command shall wait for
    from backend.schemas.experiment import QueueView
    from backend.schemas.state import TaskView

app = typer.Typer(
    help="Experiments that wait for their turn at the running service.", no_args_is_help=True, rich_markup_mode=None
)

Item = Annotated[int, typer.Argument(metavar="ITEM", help="Number of a waiting experiment, as `show` lists it.")]
_LOOK_S = 0.5


@app.command()
def show(data: DataFolder = None, as_json: AsJson = False) -> None:
    """List what waits, in order, and tell what runs with the time that is left."""
    service = running_service(settings_with(data=data))
    _show(service, _queue(service), as_json=as_json)


@app.command()
def add(
    name: Annotated[str, typer.Argument(help="Experiment, ready-made or kept: tracking, mine, mine@2.")],
    values: Annotated[list[str] | None, typer.Option("--set", help="key=value, in SI; 60deg is an angle.")] = None,
    data: DataFolder = None,
    as_json: AsJson = False,
) -> None:
    """Put an experiment at the end; it waits with the tuning that is in force now. Nothing starts by that."""
    service = running_service(settings_with(data=data))
    request = {"name": name, "settings": values_of(values or [])}
    _show(service, _queue(service, "POST", "", request), as_json=as_json)


@app.command()
def move(
    item: Item,
    place: Annotated[int, typer.Argument(min=1, help="Where it is to wait: 1 is the next one.")],
    data: DataFolder = None,
    as_json: AsJson = False,
) -> None:
    """Let an experiment wait at another place."""
    service = running_service(settings_with(data=data))
    _show(service, _queue(service, "PUT", f"/{item}/place", {"place": place - 1}), as_json=as_json)


@app.command()
def remove(item: Item, data: DataFolder = None, as_json: AsJson = False) -> None:
    """Take a waiting experiment out."""
    service = running_service(settings_with(data=data))
    _show(service, _queue(service, "DELETE", f"/{item}"), as_json=as_json)


@app.command()
def run(
    watch: Annotated[
        bool, typer.Option(help="Show how far it is until the queue stands; Ctrl-C ends the look only.")
    ] = True,
    data: DataFolder = None,
    as_json: AsJson = False,
) -> None:
    """Start the first experiment and go on until none is left, it is paused, or one does not complete: exit 1 then."""
    service = running_service(settings_with(data=data))
    found = _queue(service, "POST", "/run")
    if watch:
        found = _watch(service, hidden=as_json)
    _show(service, found, as_json=as_json)
    if found.problem:
        fail(f"the queue is {found.problem}")


@app.command()
def pause(data: DataFolder = None, as_json: AsJson = False) -> None:
    """Pause behind the experiment that runs: there the references stand still and the tendons are taut."""
    service = running_service(settings_with(data=data))
    _show(service, _queue(service, "POST", "/hold"), as_json=as_json)


@app.command()
def stop(data: DataFolder = None, as_json: AsJson = False) -> None:
    """STOP the actuator, as the red button does; what runs is kept and ends as stopped, what waits goes on waiting."""
    from backend.schemas.state import StopProof

    service = running_service(settings_with(data=data))
    service.ask("POST", "/stop", None, StopProof)
    _show(service, _queue(service), as_json=as_json)


def _queue(service: RunningService, method: str = "GET", path: str = "", body: Any = None) -> "QueueView":
    """Order something of the queue, or look at it: the answer is what waits."""
    from backend.schemas.experiment import QueueView

    return service.ask(method, f"/experiments/queue{path}", body, QueueView)


def _task(service: RunningService) -> "TaskView | None":
    from backend.schemas.state import State

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
