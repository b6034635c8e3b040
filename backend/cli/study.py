"""``sinew study``: many simulated runs at once, their table, their maps."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn

from backend.cli.experiments import current_user, in_force, text_in
from backend.cli.options import DataFolder, ParameterSet, StationName, database_of, load_settings, parameters_in_force
from backend.cli.output import AsJson, angle_unit, errors, fail, out, print_json, print_table
from backend.units import counted, digits_over, in_digits, read, reading_of

if TYPE_CHECKING:
    from backend.schemas import StudyDetail, StudyView
    from backend.studies import Map, PointExecutor, Spreading, StudyBase
    from backend.studies import Progress as Done

app = typer.Typer(
    help="Studies: many simulated runs, over settings, plants and noise.", no_args_is_help=True, rich_markup_mode=None
)
PICTURES = (".png", ".svg", ".pdf")
Number = Annotated[int, typer.Argument(metavar="NUMBER", help="Number of a study, of sinew study list.")]


@app.command()
def run(
    file: Annotated[Path | None, typer.Argument(help="File of a study, YAML or JSON (docs/how-to/studies.md).")] = None,
    resume: Annotated[int | None, typer.Option("--resume", metavar="NUMBER", help="Go on with this study.")] = None,
    jobs: Annotated[int, typer.Option("--jobs", min=0, max=1024, help="Processes; 0 for one on each core.")] = 0,
    again: Annotated[bool, typer.Option("--again", help="With --resume: anew what failed or was lost.")] = False,
    scheduler: Annotated[
        str | None, typer.Option("--scheduler", metavar="ADDRESS", help="Compute on a Dask cluster: tcp://HOST:8786.")
    ] = None,
    params: ParameterSet = None,
    data: DataFolder = None,
    station: StationName = None,
    as_json: AsJson = False,
) -> None:
    """Compute a study, row by row into the database. Ctrl+C stops it; --resume computes what is missing.

    What the study does not say is as it is now: the parameter set, and the tuning that is in force.
    """
    if (file is None) == (resume is None):
        fail("name the file of a study, or the number of one with --resume", status=2)
    if again and resume is None:
        fail("--again needs --resume: a study that is begun has nothing that failed", status=2)
    from backend.services import Studies
    from backend.studies import run_study

    settings = load_settings(params=params, data=data, station=station)
    tuning: dict[str, Any] = {} if file is None else in_force(settings).parts
    with database_of(settings) as database:
        kept = Studies(database)
        if resume is None:
            assert file is not None
            resume = kept.begin(text_in(file), current_user(), parameters_in_force(settings, database), tuning).id
        else:
            kept.resume(resume)
        if not as_json:
            out.print(f"study {resume}: sinew study run --resume {resume} goes on with it", highlight=False)
        with _progress(hidden=as_json) as notify:
            whole = run_study(database, resume, _choose_executor(jobs, scheduler), notify, again=again)
        _say(kept.detail(resume, 0), as_json=as_json)
    if not whole:
        fail(f"study {resume} was stopped: sinew study run --resume {resume} goes on with it")


@app.command("list")
def list_studies(data: DataFolder = None, station: StationName = None, as_json: AsJson = False) -> None:
    """List studies, newest first, and how far they are."""
    from backend.services import Studies

    with database_of(load_settings(data=data, station=station), reading=True) as database:
        found = Studies(database).all()
    if as_json:
        print_json([study.model_dump(mode="json") for study in found])
        return
    rows = [
        (study.id, study.name, study.title, study.who, study.state, f"{study.done} of {study.points}", _left(study))
        for study in found
    ]
    print_table(("study", "name", "title", "by", "state", "runs", "left"), rows)


@app.command()
def show(
    study: Number,
    rows: Annotated[bool, typer.Option("--rows", help="The whole table, row by row; always so with --json.")] = False,
    data: DataFolder = None,
    station: StationName = None,
    as_json: AsJson = False,
) -> None:
    """Show how far a study is and how its figures are spread."""
    from backend.services import Studies

    with database_of(load_settings(data=data, station=station), reading=True) as database:
        found = Studies(database).detail(study, None if rows or as_json else 0)
    _say(found, as_json=as_json)


@app.command()
def stop(study: Number, data: DataFolder = None, station: StationName = None, as_json: AsJson = False) -> None:
    """Have a study stop, wherever it is computed; what is computed stays."""
    from backend.services import Studies

    with database_of(load_settings(data=data, station=station)) as database:
        found = Studies(database).stop(study)
    if as_json:
        print_json(found.model_dump(mode="json"))
    else:
        out.print(f"study {study}: {found.state}, {found.done} of {found.points} runs", highlight=False)


@app.command("map")
def draw(
    study: Number,
    figure: Annotated[
        str, typer.Option("--figure", help="Which figure or share, of sinew study show.")
    ] = "overshoot_q_percent",
    over: Annotated[
        tuple[str, str] | None,
        typer.Option("--over", metavar="X Y", help="Two axes. [lam_q lam_S, else the first two]"),
    ] = None,
    pick: Annotated[
        str,
        typer.Option(
            "--pick", help="Of several runs in a cell: worst, mean, least, largest, deviation, p5, median or p95."
        ),
    ] = "worst",
    to: Annotated[Path | None, typer.Option("--out", help="Picture to write: png, svg or pdf.")] = None,
    data: DataFolder = None,
    station: StationName = None,
    as_json: AsJson = False,
) -> None:
    """Map a figure over two axes of a study: as a table, or as a picture."""
    if to is not None and to.suffix.lower() not in PICTURES:
        fail(f"{to}: a picture ends in {', '.join(PICTURES)}", status=2)
    from dataclasses import asdict

    from backend.experiments import parse_canonical
    from backend.services import Studies, axis_symbol, axis_unit
    from backend.studies import SHARES, STATISTIC_LABELS, UNSTABLE, format_axis_labels, list_metric_names

    with database_of(load_settings(data=data, station=station), reading=True) as database:
        found, design = Studies(database).map(study, figure, pick, over)
    named = list_metric_names(parse_canonical(design.base.experiment)) | SHARES
    if figure not in named:
        fail(f"there is no figure {figure}; known are {', '.join(named)}", status=2)
    unit = named[figure].unit
    label = (
        f"{_with_unit(named[figure].label, unit)}, {STATISTIC_LABELS.get(found.pick, found.pick)} of the runs in a cell"
    )
    with_number, computed = (sum(map(sum, table)) for table in (found.counts, found.runs))
    if with_number < computed:
        label += f", {computed - with_number} of {computed} runs without a number"
    cells = [[None if value is None else read(value, unit, angle_unit()) for value in row] for row in found.cells]
    (x, at_x), (y, at_y) = (
        (
            _with_unit(axis_symbol(name, design), axis_unit(name, design)),
            format_axis_labels(values, axis_unit(name, design), angle_unit()),
        )
        for name, values in ((found.x, found.x_values), (found.y, found.y_values))
    )
    if to is not None:
        from backend.reports import draw_map

        blank = f", blank: {UNSTABLE}" if any(any(row) for row in found.unstable) else ""
        draw_map(cells=cells, x=(x, at_x), y=(y, at_y), label=label + blank, file=to, notes=_notes(found))
    if as_json:
        print_json(asdict(found))
        return
    digits = digits_over([value for row in cells for value in row if value is not None])
    rows = [
        (name, *(_cell(value, is_unstable, digits) for value, is_unstable in zip(row, unstable, strict=True)))
        for name, row, unstable in zip(at_y, cells, found.unstable, strict=True)
    ]
    print_table((f"{y} \\ {x}", *at_x), rows, title=label)
    if any(note for row in _notes(found) for note in row):
        print_table(
            (f"{y} \\ {x}", *at_x), list(zip(at_y, *zip(*_notes(found), strict=True), strict=True)), title=_NOTE
        )


_NOTE = "95 % confidence interval of a share, or runs with a number of those that are computed"


def _notes(found: "Map") -> list[list[str]]:
    """Return what belongs to the number of each cell: of how many runs it is, of a share its interval."""
    most = max((count for row in found.runs for count in row), default=0)

    def note(place: tuple[int, int]) -> str:
        row, column = place
        interval = found.intervals[row][column]
        if interval is not None:
            return f"{interval[0]:.3g} to {interval[1]:.3g}, {found.counts[row][column]} runs"
        return f"{found.counts[row][column]} of {found.runs[row][column]}" if most > 1 else ""

    return [[note((row, column)) for column in range(len(found.cells[row]))] for row in range(len(found.cells))]


def _with_unit(words: str, unit: str) -> str:
    shown = reading_of(unit, angle_unit()).unit
    return words if shown in ("1", "") else f"{words} [{shown}]"


def _cell(value: float | None, unstable: bool, digits: int) -> str | None:
    from backend.studies import UNSTABLE

    if unstable:
        return UNSTABLE
    return None if value is None else in_digits(value, digits)


def _choose_executor(jobs: int, scheduler: str | None) -> "Callable[[StudyBase], PointExecutor]":
    from backend.studies import count_cores, use_local_processes

    if scheduler is None:
        return use_local_processes(jobs or count_cores())
    from backend.studies import use_cluster

    return use_cluster(scheduler)


@contextmanager
def _progress(*, hidden: bool) -> "Iterator[Callable[[Done], None]]":
    columns = (TextColumn("runs"), BarColumn(), MofNCompleteColumn(), TextColumn("{task.description}"))
    with Progress(*columns, console=errors, disable=hidden, transient=True) as progress:
        task = progress.add_task("", total=None)

        def notify(done: "Done") -> None:
            left = "" if done.left_s is None else f"{_in_time(done.left_s)} left"
            progress.update(task, completed=done.done, total=done.points, description=left)

        yield notify


def _say(found: "StudyDetail", *, as_json: bool) -> None:
    if as_json:
        print_json(found.model_dump(mode="json"))
        return
    study = found.study
    ends = ", ".join(f"{count} {state}" for state, count in study.ends.items())
    out.print(f"study {study.id}, {study.title}: {study.state}, {study.done} of {study.points} runs", highlight=False)
    out.print(f"{ends or 'none yet'}{f'; {study.problem}' if study.problem else ''}", highlight=False, markup=False)
    for share in found.shares:
        if share.percent is None or share.low is None or share.high is None:
            out.print(f"{share.label}: {counted(share.left_out, 'run')} not judged", highlight=False)
            continue
        left = f", {counted(share.left_out, 'run')} not judged" if share.left_out else ""
        out.print(
            f"{share.label}: {share.count} of {share.of}, {share.percent:.1f} % "
            f"(95 % confidence interval {share.low:.1f} to {share.high:.1f} %){left}",
            highlight=False,
        )
    print_table(("figure", "runs", "mean", "std. dev.", "unit"), [_mean(item) for item in found.figures])
    print_table(("figure", "least", "5 %", "median", "95 %", "largest"), [_percentiles(item) for item in found.figures])
    if found.rows:
        names = list(found.rows[0].values)
        rows = [(row.number, *(row.values.get(name) for name in names), row.state, row.detail) for row in found.rows]
        print_table(("run", *names, "end", "detail"), rows)


def _mean(item: "Spreading") -> tuple[object, ...]:
    runs = f"{item.count} of {item.count + item.missing}"
    unit = reading_of(item.unit, angle_unit()).unit
    return item.name, runs, _statistic(item, item.mean), _statistic(item, item.deviation), unit


def _percentiles(item: "Spreading") -> tuple[object, ...]:
    values = (item.least, item.p5, item.median, item.p95, item.largest)
    return item.name, *(_statistic(item, value) for value in values)


def _statistic(item: "Spreading", value: float | None) -> float | str:
    from backend.studies import UNSTABLE

    if value is None:
        return UNSTABLE if item.unstable else "one run"
    return read(value, item.unit, angle_unit())


def _left(study: "StudyView") -> str:
    return "" if study.left_s is None else _in_time(study.left_s)


def _in_time(seconds: float) -> str:
    minutes, rest = divmod(round(seconds), 60)
    return f"{minutes // 60:02}:{minutes % 60:02}:{rest:02}"
