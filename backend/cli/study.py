"""Commands ``sinew study``: compute studies, print their tables and maps."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn

from backend.cli import messages
from backend.cli.experiments import current_user, load_active_tuning, read_text_file
from backend.cli.options import (
    DataFolder,
    ParameterSet,
    StationName,
    load_plant_parameters,
    load_settings,
    open_configured_database,
)
from backend.cli.output import AsJson, angle_unit, console, error_console, fail, print_json, print_table
from backend.units import convert_to_display, count_range_digits, format_number, get_display_unit

if TYPE_CHECKING:
    from backend.schemas import StudyDetail, StudyView
    from backend.studies import Map, PointExecutor, Spreading, StudyBase
    from backend.studies import Progress as Done

app = typer.Typer(
    help="Studies: many simulated runs over settings, plants and noise.", no_args_is_help=True, rich_markup_mode=None
)
PICTURE_SUFFIXES = (".png", ".svg", ".pdf")
Number = Annotated[int, typer.Argument(metavar="NUMBER", help="Number of a study from sinew study list.")]


@app.command()
def run(
    file: Annotated[Path | None, typer.Argument(help="File of a study, YAML or JSON (docs/how-to/studies.md).")] = None,
    resume: Annotated[int | None, typer.Option("--resume", metavar="NUMBER", help="Continue this study.")] = None,
    jobs: Annotated[int, typer.Option("--jobs", min=0, max=1024, help="Number of processes; 0 for one per core.")] = 0,
    again: Annotated[bool, typer.Option("--again", help="With --resume: repeat failed and lost runs.")] = False,
    scheduler: Annotated[
        str | None, typer.Option("--scheduler", metavar="ADDRESS", help="Compute on a Dask cluster: tcp://HOST:8786.")
    ] = None,
    params: ParameterSet = None,
    data: DataFolder = None,
    station: StationName = None,
    as_json: AsJson = False,
) -> None:
    """Compute a study and store each run in the database. Ctrl+C stops it.

    --resume computes the missing runs. The study uses the active parameter set and tuning, unless it sets them.
    """
    if (file is None) == (resume is None):
        fail(messages.file_or_number_of_study(), status=2)
    if again and resume is None:
        fail(messages.again_requires_resume(), status=2)
    from backend.services import Studies
    from backend.studies import run_study

    settings = load_settings(params=params, data=data, station=station)
    tuning: dict[str, Any] = {} if file is None else load_active_tuning(settings).parts
    with open_configured_database(settings) as database:
        studies = Studies(database)
        if resume is None:
            assert file is not None
            resume = studies.create(
                read_text_file(file), current_user(), load_plant_parameters(settings, database), tuning
            ).id
        else:
            studies.resume(resume)
        if not as_json:
            console.print(messages.how_to_resume_study(study=resume), highlight=False)
        with _show_progress(hidden=as_json) as notify:
            is_complete = run_study(database, resume, _choose_executor(jobs, scheduler), notify, again=again)
        _print_study(studies.build_detail(resume, 0), as_json=as_json)
    if not is_complete:
        fail(messages.study_stopped(study=resume))


@app.command("list")
def list_studies(data: DataFolder = None, station: StationName = None, as_json: AsJson = False) -> None:
    """List studies, newest first, with their progress."""
    from backend.services import Studies

    with open_configured_database(load_settings(data=data, station=station), read_only=True) as database:
        found = Studies(database).list_newest()
    if as_json:
        print_json([study.model_dump(mode="json") for study in found])
        return
    rows = [
        (
            study.id,
            study.name,
            study.title,
            study.who,
            study.state,
            messages.part_of_whole(part=study.done, whole=study.points),
            _format_time_left(study),
        )
        for study in found
    ]
    print_table(("study", "name", "title", "by", "state", "runs", "time left"), rows)


@app.command()
def show(
    study: Number,
    rows: Annotated[bool, typer.Option("--rows", help="Print the table of all runs, as --json always does.")] = False,
    data: DataFolder = None,
    station: StationName = None,
    as_json: AsJson = False,
) -> None:
    """Show the progress of a study and the distribution of its metrics."""
    from backend.services import Studies

    with open_configured_database(load_settings(data=data, station=station), read_only=True) as database:
        found = Studies(database).build_detail(study, None if rows or as_json else 0)
    _print_study(found, as_json=as_json)


@app.command()
def stop(study: Number, data: DataFolder = None, station: StationName = None, as_json: AsJson = False) -> None:
    """Stop a study, in whichever process it runs; finished runs are kept."""
    from backend.services import Studies

    with open_configured_database(load_settings(data=data, station=station)) as database:
        found = Studies(database).request_stop(study)
    if as_json:
        print_json(found.model_dump(mode="json"))
    else:
        text = messages.study_progress(study=study, state=found.state, done=found.done, points=found.points)
        console.print(text, highlight=False)


@app.command("map")
def map_metric(
    study: Number,
    figure: Annotated[
        str, typer.Option("--figure", help="Metric or share from sinew study show.")
    ] = "overshoot_q_percent",
    over: Annotated[
        tuple[str, str] | None,
        typer.Option("--over", metavar="X Y", help="Two axes. [lam_q lam_S, else the first two]"),
    ] = None,
    pick: Annotated[
        str,
        typer.Option(
            "--pick", help="Statistic of the runs in a cell: worst, mean, least, largest, deviation, p5, median, p95."
        ),
    ] = "worst",
    to: Annotated[Path | None, typer.Option("--out", help="Image file to write: png, svg or pdf.")] = None,
    data: DataFolder = None,
    station: StationName = None,
    as_json: AsJson = False,
) -> None:
    """Map a metric over two axes of a study, as a table or an image."""
    if to is not None and to.suffix.lower() not in PICTURE_SUFFIXES:
        fail(messages.unknown_image_suffix(file=to, suffixes=PICTURE_SUFFIXES), status=2)
    from dataclasses import asdict

    from backend.experiments import parse_canonical
    from backend.services import Studies, get_axis_symbol, get_axis_unit
    from backend.studies import SHARES, STATISTIC_LABELS, UNSTABLE, format_axis_labels, list_metric_names

    with open_configured_database(load_settings(data=data, station=station), read_only=True) as database:
        found, design = Studies(database).build_map(study, figure, pick, over)
    metrics = list_metric_names(parse_canonical(design.base.experiment)) | SHARES
    if figure not in metrics:
        fail(messages.unknown_metric(name=figure, known=tuple(metrics)), status=2)
    unit = metrics[figure].unit
    statistic = STATISTIC_LABELS.get(found.pick, found.pick)
    with_number, computed = (sum(map(sum, table)) for table in (found.counts, found.runs))
    label = messages.map_title(
        metric=_format_label(metrics[figure].label, unit),
        statistic=statistic,
        computed=computed,
        without_value=max(computed - with_number, 0),
    )
    cells = [
        [None if value is None else convert_to_display(value, unit, angle_unit()) for value in row]
        for row in found.cells
    ]
    (x, at_x), (y, at_y) = (
        (
            _format_label(get_axis_symbol(name, design), get_axis_unit(name, design)),
            format_axis_labels(values, get_axis_unit(name, design), angle_unit()),
        )
        for name, values in ((found.x, found.x_values), (found.y, found.y_values))
    )
    if to is not None:
        from backend.reports import draw_map

        has_blanks = any(any(row) for row in found.unstable)
        title = messages.map_title_with_blanks(title=label, blank=UNSTABLE) if has_blanks else label
        draw_map(cells=cells, x=(x, at_x), y=(y, at_y), label=title, file=to, notes=_build_notes(found))
    if as_json:
        print_json(asdict(found))
        return
    digits = count_range_digits([value for row in cells for value in row if value is not None])
    rows = [
        (name, *(_format_cell(value, is_unstable, digits) for value, is_unstable in zip(row, unstable, strict=True)))
        for name, row, unstable in zip(at_y, cells, found.unstable, strict=True)
    ]
    print_table((f"{y} \\ {x}", *at_x), rows, title=label)
    if any(note for row in _build_notes(found) for note in row):
        print_table(
            (f"{y} \\ {x}", *at_x),
            list(zip(at_y, *zip(*_build_notes(found), strict=True), strict=True)),
            title=messages.notes_of_map(),
        )


def _build_notes(found: "Map") -> list[list[str]]:
    """Return a note for each cell: number of runs, confidence interval of a share."""
    most = max((count for row in found.runs for count in row), default=0)

    def note(row: int, column: int) -> str:
        interval = found.intervals[row][column]
        if interval is not None:
            return messages.interval_of_cell(low=interval[0], high=interval[1], runs=found.counts[row][column])
        if most <= 1:
            return ""
        return messages.part_of_whole(part=found.counts[row][column], whole=found.runs[row][column])

    return [[note(row, column) for column in range(len(found.cells[row]))] for row in range(len(found.cells))]


def _format_label(text: str, unit: str) -> str:
    symbol = get_display_unit(unit, angle_unit()).unit
    return text if symbol in ("1", "") else f"{text} [{symbol}]"


def _format_cell(value: float | None, is_unstable: bool, digits: int) -> str | None:
    from backend.studies import UNSTABLE

    if is_unstable:
        return UNSTABLE
    return None if value is None else format_number(value, digits)


def _choose_executor(jobs: int, scheduler: str | None) -> "Callable[[StudyBase], PointExecutor]":
    from backend.studies import count_cores, use_local_processes

    if scheduler is None:
        return use_local_processes(jobs or count_cores())
    from backend.studies import use_cluster

    return use_cluster(scheduler)


@contextmanager
def _show_progress(*, hidden: bool) -> "Iterator[Callable[[Done], None]]":
    columns = (TextColumn("runs"), BarColumn(), MofNCompleteColumn(), TextColumn("{task.description}"))
    with Progress(*columns, console=error_console, disable=hidden, transient=True) as progress:
        task = progress.add_task("", total=None)

        def notify(done: "Done") -> None:
            left = "" if done.left_s is None else messages.duration_left(duration=_format_duration(done.left_s))
            progress.update(task, completed=done.done, total=done.points, description=left)

        yield notify


def _print_study(found: "StudyDetail", *, as_json: bool) -> None:
    if as_json:
        print_json(found.model_dump(mode="json"))
        return
    study = found.study
    title = messages.study_title(
        study=study.id, title=study.title, state=study.state, done=study.done, points=study.points
    )
    console.print(title, highlight=False)
    console.print(messages.ends_of_runs(ends=study.ends, problem=study.problem), highlight=False, markup=False)
    for share in found.shares:
        if share.percent is None or share.low is None or share.high is None:
            text = messages.share_without_verdict(share=share.label, left_out=share.left_out)
        else:
            text = messages.share_of_runs(
                share=share.label,
                count=share.count,
                of=share.of,
                percent=share.percent,
                low_percent=share.low,
                high_percent=share.high,
                left_out=share.left_out,
            )
        console.print(text, highlight=False)
    print_table(("metric", "runs", "mean", "std. dev.", "unit"), [_build_mean_row(item) for item in found.figures])
    print_table(
        ("metric", "least", "5 %", "median", "95 %", "largest"), [_build_percentile_row(item) for item in found.figures]
    )
    if found.rows:
        names = list(found.rows[0].values)
        rows = [(row.number, *(row.values.get(name) for name in names), row.state, row.detail) for row in found.rows]
        print_table(("run", *names, "end", "detail"), rows)


def _build_mean_row(item: "Spreading") -> tuple[object, ...]:
    runs = messages.part_of_whole(part=item.count, whole=item.count + item.missing)
    unit = get_display_unit(item.unit, angle_unit()).unit
    return item.name, runs, _convert_statistic(item, item.mean), _convert_statistic(item, item.deviation), unit


def _build_percentile_row(item: "Spreading") -> tuple[object, ...]:
    values = (item.least, item.p5, item.median, item.p95, item.largest)
    return item.name, *(_convert_statistic(item, value) for value in values)


def _convert_statistic(item: "Spreading", value: float | None) -> float | str:
    from backend.studies import UNSTABLE

    if value is None:
        return UNSTABLE if item.unstable else messages.one_run()
    return convert_to_display(value, item.unit, angle_unit())


def _format_time_left(study: "StudyView") -> str:
    return "" if study.left_s is None else _format_duration(study.left_s)


def _format_duration(seconds: float) -> str:
    minutes, rest = divmod(round(seconds), 60)
    return f"{minutes // 60:02}:{minutes % 60:02}:{rest:02}"
