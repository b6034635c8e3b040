"""Commands ``sinew identify``: simulated identification runs, and data from files."""

import math
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from backend.cli import messages
from backend.cli.experiments import (
    BaseTuning,
    CombineRuns,
    OutFolder,
    SetWords,
    current_user,
    load_active_tuning,
    parse_values,
    resolve_settings,
    run_headless,
    run_headless_sequence,
)
from backend.cli.options import (
    DataFolder,
    ParameterSet,
    PlantName,
    StationName,
    VirtualCard,
    WiringFile,
    load_settings,
    open_configured_database,
)
from backend.cli.output import AsJson, console, fail, print_json, print_table
from backend.settings import Settings
from backend.units import format_percent

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping

    from backend.execution import RunRequest
    from backend.experiments import IdentificationPlan
    from backend.identification import (
        Columns,
        Controller,
        CorrelationTest,
        DecimalMark,
        Estimate,
        ImportSummary,
        Record,
    )
    from backend.reports import RunData


# sinew identify data -------------------------------------------------------------------------------


METHODS = "default, srivc, rivc, output_error, low_frequency, arx"
MOTOR = "motor"
_TEXT_FILES = (".csv", ".txt", ".tsv", ".dat", ".asc", ".log", ".lvm")
_OMITTED_ENTRIES = ("format", "rows")
"""Entries of a file's layout that other rows of the printed table contain."""
STRUCTURES = (
    "first, third, lags2 .. lags6, order:1 .. order:4, each also with a dead time as in first+delay;"
    " motor: angle from voltage, with dead time and Coulomb friction"
)


def data(
    file: Annotated[
        Path, typer.Argument(help="Table of samples: text such as .csv, .mat (up to version 7) or .parquet.")
    ],
    u: Annotated[str, typer.Option("--input", metavar="COLUMN", help="Column of the input u, held between samples.")],
    y: Annotated[str, typer.Option("--output", metavar="COLUMN", help="Column of the output y.")],
    structure: Annotated[str, typer.Option(metavar="NAME", help=f"Structure: {STRUCTURES}.")],
    period_s: Annotated[
        float | None,
        typer.Option(
            "--period", metavar="SECONDS", help="Sample time [s]; optional and checked if the file has a time column."
        ),
    ] = None,
    time: Annotated[
        str | None,
        typer.Option(metavar="COLUMN", help="Time column, or none to ignore the file's time column and use --period."),
    ] = None,
    time_unit: Annotated[
        str | None,
        typer.Option(metavar="UNIT", help="Unit of the time: s, ms, us, ns, min, h, d; dmy or mdy for dates."),
    ] = None,
    header: Annotated[
        int | None,
        typer.Option(
            metavar="LINE", min=1, help="Line of the file that names the columns; lines above it are ignored."
        ),
    ] = None,
    decimal: Annotated[
        str | None,
        typer.Option(metavar="MARK", help="Decimal mark of a text table: point or comma."),
    ] = None,
    setpoint: Annotated[
        str | None,
        typer.Option(metavar="COLUMN", help="Column of the external input of the loop: setpoint or excitation."),
    ] = None,
    controller: Annotated[
        str | None,
        typer.Option(
            metavar="KP,KI", help="Controller u = kp (r - y) + ki ∫(r - y), ki per second, instead of --setpoint."
        ),
    ] = None,
    skip: Annotated[int, typer.Option(metavar="ROWS", min=0, help="Number of rows to skip at the start.")] = 0,
    take: Annotated[
        int | None, typer.Option(metavar="ROWS", min=1, help="Number of rows to use after the skipped ones.")
    ] = None,
    within: Annotated[
        str | None,
        typer.Option("--range", metavar="FROM:TO", help="Time range of the file to use [s], such as 2:30 or 2:"),
    ] = None,
    resample: Annotated[
        bool,
        typer.Option("--resample", help="Resample unevenly spaced rows to a constant sample time, across short gaps."),
    ] = False,
    gain: Annotated[
        float | None,
        typer.Option(
            metavar="K", help="Static gain known from geometry or elsewhere; the verdict compares the estimate with it."
        ),
    ] = None,
    resolution: Annotated[
        float | None,
        typer.Option(metavar="STEP", help="Resolution of the output sensor. [estimated if coarse]"),
    ] = None,
    method: Annotated[str, typer.Option(metavar="NAME", help=f"Estimator: {METHODS}.")] = "default",
    as_json: AsJson = False,
) -> None:
    """Identify a model from a file, and print it with the layout of the file; nothing is stored.

    A record from a closed loop needs --setpoint or --controller. Exit 2 if the file is unreadable or the record
    yields no model.
    """
    from backend.identification import IdentificationError, Selection, TimeChoice, estimate_model, import_record
    from backend.models import replace_non_finite

    try:
        record, summary = import_record(
            _read_columns(file, header, parse_decimal_mark(decimal)),
            u,
            y,
            period_s,
            setpoint=setpoint,
            controller=_parse_controller(controller) if controller else None,
            selection=Selection(skip, *_parse_range(within), resample, take),
            time=TimeChoice(time, time_unit),
            file=file.name,
        )
        if structure == MOTOR:
            _identify_motor(record, summary, resolution, as_json=as_json)
            return
        estimate = estimate_model(record, structure, _parse_method(method), gain_geometry=gain, y_resolution=resolution)
    except (IdentificationError, OSError) as error:
        fail(" ".join(str(error).split()), status=2)
    if as_json:
        print_json(replace_non_finite({"read": summary.to_json(), **estimate.summary()}))
    else:
        _print_import(summary)
        _print_estimate(estimate)


def _read_columns(file: Path, header: int | None, decimal: "DecimalMark | None") -> "Columns":
    from backend.identification import DataFileError, FileFault, decode_text, read_csv, read_mat, read_parquet

    suffix = file.suffix.lower()
    if suffix in _TEXT_FILES:
        return read_csv(decode_text(file.read_bytes(), file.name), header=header, decimal=decimal)
    if header is not None or decimal is not None:
        raise DataFileError(
            messages.not_a_text_table(file=file.name),
            FileFault.OPTION,
            option="--header" if header is not None else "--decimal",
        )
    if suffix in (".mat", ".parquet"):
        with file.open("rb") as stream:
            return read_mat(stream) if suffix == ".mat" else read_parquet(stream)
    raise DataFileError(messages.unknown_file_format(file=str(file)), FileFault.FORMAT)


def parse_decimal_mark(option: str | None) -> "DecimalMark | None":
    """Return the decimal mark of the option ``--decimal``. Raises DataFileError."""
    from backend.identification import DataFileError, DecimalMark, FileFault

    if option is None:
        return None
    try:
        return DecimalMark(option)
    except ValueError:
        message = messages.unknown_decimal_mark(value=option)
        raise DataFileError(message, FileFault.OPTION, option="--decimal") from None


def _parse_range(option: str | None) -> tuple[float, float]:
    """Return start and end [s] of the option ``--range``. Raises DataFileError."""
    from backend.identification import DataFileError, FileFault

    times = option or ":"
    try:
        first, last = times.split(":")
        start_s, end_s = float(first or 0.0), float(last or math.inf)
        if not end_s > start_s:
            raise ValueError
        return start_s, end_s
    except ValueError:
        raise DataFileError(messages.invalid_range(value=times), FileFault.OPTION, option="--range") from None


def _parse_controller(option: str) -> "Controller":
    from backend.identification import Controller, DataFileError, FileFault

    try:
        k_p, k_i = (float(gain) for gain in option.split(","))
    except ValueError:
        message = messages.invalid_controller(value=option)
        raise DataFileError(message, FileFault.OPTION, option="--controller") from None
    return Controller(k_p, k_i)


def _parse_method(name: str) -> Any:
    from backend.identification import Method, StructureError

    try:
        return Method(name)
    except ValueError:
        raise StructureError(messages.unknown_method(name=name, known=METHODS)) from None


def _print_import(summary: "ImportSummary") -> None:
    steps = messages.sample_time(
        sample_time_s=summary.sample_time_s,
        origin=summary.sample_time_from,
        least_step_s=summary.least_step_s,
        largest_step_s=summary.largest_step_s,
    )
    rows_used = messages.rows_used(
        used=summary.rows_used, available=summary.rows_in_file, first=summary.first_row, last=summary.last_row
    )
    rows = [
        *((role, _format_column(column, summary.units.get(column))) for role, column in summary.columns.items()),
        ("time column", _describe_time_column(summary)),
        ("sample time", steps),
        ("rows used", rows_used),
        *([(messages.samples_resampled(), str(summary.samples))] if summary.resampled else []),
    ]
    print_layout(summary.file, summary.layout, rows, summary.not_read, summary.notes)


def print_layout(
    file: str,
    layout: "Mapping[str, str | int]",
    rows: "Sequence[tuple[str, str]]",
    not_read: "Mapping[str, str]",
    notes: "Iterable[str]",
) -> None:
    """Print the layout of a file, then ``rows``, ignored columns and notes.

    ``not_read`` has the reason by the name of the column.
    """
    lines = [
        ("file", f"{file}, {layout['format']}"),
        *(
            (name.replace("_", " "), str(value))
            for name, value in layout.items()
            if name not in _OMITTED_ENTRIES and value != 0
        ),
        *rows,
        *(
            ("ignored", f"{', '.join(name for name, other in not_read.items() if other == reason)}: {reason}")
            for reason in dict.fromkeys(not_read.values())
        ),
        *(("note", note) for note in notes),
    ]
    print_table(("", "content"), lines)


def _format_column(column: str, unit: str | None) -> str:
    return f"{column} [{unit}]" if unit else column


def _describe_time_column(summary: "ImportSummary") -> str:
    if summary.time_column is None:
        return "none"
    if summary.time_unit_from == "dates":
        return f"{summary.time_column}, {summary.time_unit}"
    return messages.time_column(column=summary.time_column, unit=summary.time_unit, origin=summary.time_unit_from)


def _identify_motor(record: "Record", summary: "ImportSummary", resolution: float | None, *, as_json: bool) -> None:
    """Identify a motor from the record of a file and print its parameters.

    ``resolution`` is one count [rad].
    """
    from backend.identification import NAMES, identify_motor_record
    from backend.models import replace_non_finite

    estimate = identify_motor_record(record, resolution)
    if as_json:
        print_json(replace_non_finite({"read": summary.to_json(), **estimate.summary()}))
        return
    _print_import(summary)
    units = dict(zip(NAMES, ("rad/(V·s)", "s", "V", "s", "V"), strict=True))
    rows = [
        (f"{name} [{units[name]}]", value, std or messages.parameter_omitted())
        for (name, value), std in zip(estimate.parameters.items(), estimate.std_errors, strict=True)
    ]
    print_table(("parameter", "value", "standard error"), rows)
    results = [
        ("method", estimate.method),
        ("fit on validation data [%]", _format_percent(estimate.fit_percent)),
        *_build_test_rows(estimate.whiteness, estimate.input_correlation),
    ]
    print_table(("", "result"), results)
    console.print(estimate.verdict.sentence, highlight=False, markup=False)


def _print_estimate(estimate: "Estimate") -> None:
    parameters, std_errors = estimate.model.parameters, estimate.std_errors
    print_table(
        ("parameter", "value", "standard error"),
        [(name, value, _format_number(std_errors[name], ".4g")) for name, value in parameters.items()],
    )
    reduced, tests = estimate.first_order, estimate.residuals
    rows = [
        ("method", estimate.method),
        ("gain K", f"{reduced.K:.4g} ± {_format_number(reduced.K_std, '.2g')}"),
        (
            "sum of lags" + (" and dead time" if estimate.model.dead_time else "") + " T [s]",
            f"{reduced.T:.4g} ± {_format_number(reduced.T_std, '.2g')}",
        ),
        *_build_friction_rows(estimate),
        *_build_offset_rows(estimate),
        ("fit on validation data [%]", _format_percent(estimate.fit_percent)),
        *_build_test_rows(tests.whiteness, tests.input_correlation),
    ]
    print_table(("", "result"), rows)
    console.print(estimate.verdict.sentence, highlight=False, markup=False)


def _build_test_rows(whiteness: "CorrelationTest", input_correlation: "CorrelationTest") -> list[tuple[str, str]]:
    return [
        ("residuals", _describe_test(whiteness, "white", "coloured")),
        ("input–residual cross-correlation", _describe_test(input_correlation, "independent", "correlated")),
    ]


def _describe_test(test: "CorrelationTest", good: str, bad: str) -> str:
    from backend.identification import read_whiteness_test

    return f"{good if test.passed else bad}: {read_whiteness_test(test).sentence}"


def _build_friction_rows(estimate: "Estimate") -> list[tuple[str, str]]:
    friction = estimate.friction
    if friction is None:
        return []
    if not friction.found:
        negligible = messages.friction_not_significant(u_c=friction.u_c, u_c_std=friction.u_c_std)
        return [("Coulomb friction u_c", negligible)]
    return [
        ("Coulomb friction u_c", f"{friction.u_c:.4g} ± {friction.u_c_std:.2g}"),
        ("gain K with friction", f"{friction.K:.4g} ± {friction.K_std:.2g}"),
        ("time constant T with friction [s]", f"{friction.T:.4g} ± {friction.T_std:.2g}"),
        ("fit with friction [%]", format_percent(friction.fit_percent, 2)),
    ]


def _build_offset_rows(estimate: "Estimate") -> list[tuple[str, str]]:
    offset = estimate.input_offset
    return [] if offset is None else [("input offset u_0", f"{offset.u_0:.4g} ± {offset.u_0_std:.2g}")]


def _format_percent(value: float) -> str:
    return format_percent(value, 2) if math.isfinite(value) else messages.not_measured()


def _format_number(value: float | None, format_spec: str) -> str:
    return format(value, format_spec) if value is not None and math.isfinite(value) else messages.not_measured()


# sinew identify motor, spring and actuator ---------------------------------------------------------


app = typer.Typer(
    help="Identify models from experiments on a simulated plant or from files.",
    no_args_is_help=True,
    rich_markup_mode=None,
)

app.command()(data)

Tensions = Annotated[
    str | None,
    typer.Option("--tensions", metavar="N,N,...", help="Tensions [N] of several runs, one after the other."),
]
Header = Annotated[
    int | None, typer.Option("--header", metavar="LINE", min=1, help="Line of the table that names the columns.")
]
Decimal = Annotated[
    str | None, typer.Option("--decimal", metavar="MARK", help="Decimal mark of the table: point or comma.")
]
Table = Annotated[
    Path | None,
    typer.Option("--table", help="Identify from this CSV instead: columns 'x [m]' or 'x [mm]', and 'F [N]'."),
]


@app.command()
def motor(
    values: SetWords = None,
    out: OutFolder = None,
    plant: PlantName = None,
    virtual_card: VirtualCard = None,
    wiring: WiringFile = None,
    params: ParameterSet = None,
    data: DataFolder = None,
    station: StationName = None,
    as_json: AsJson = False,
) -> None:
    """Identify K_m, T_m and Coulomb friction of both motors (method section 2).

    The motors make unloaded voltage steps. Settings: u_low, u_high [V], levels, travel_rad [rad], step_s, settle_s [s].
    Settings of the control loop: lam_motor [s], seed. Others come from the active tuning in the data folder.
    """
    from backend.experiments import MotorIdentificationPlan

    _run_identification(
        MotorIdentificationPlan,
        parse_values(values or []),
        out,
        load_settings(plant=plant, virtual_card=virtual_card, wiring=wiring, params=params, data=data, station=station),
        as_json,
    )


@app.command()
def spring(
    values: SetWords = None,
    table: Table = None,
    header: Header = None,
    decimal: Decimal = None,
    out: OutFolder = None,
    plant: PlantName = None,
    virtual_card: VirtualCard = None,
    wiring: WiringFile = None,
    params: ParameterSet = None,
    data: DataFolder = None,
    station: StationName = None,
    as_json: AsJson = False,
) -> None:
    """Identify the springs from a slow sweep, or one from a table (method section 3).

    Settings: F_low, F_high [N], sweep_s [s], cycles, settle_s [s].
    Settings of the control loop: lam_motor [s], seed. Others come from the active tuning in the data folder.
    """
    from backend.experiments import SpringIdentificationPlan

    settings = load_settings(
        plant=plant, virtual_card=virtual_card, wiring=wiring, params=params, data=data, station=station
    )
    if table is None and (header is not None or decimal is not None):
        fail(messages.header_requires_table(), status=2)
    elif table is None:
        _run_identification(SpringIdentificationPlan, parse_values(values or []), out, settings, as_json)
    elif values or out:
        fail(messages.options_exclude_table(), status=2)
    else:
        _identify_table(table, settings, header, decimal, as_json=as_json)


@app.command()
def actuator(
    values: SetWords = None,
    tensions: Tensions = None,
    out: OutFolder = None,
    plant: PlantName = None,
    virtual_card: VirtualCard = None,
    wiring: WiringFile = None,
    params: ParameterSet = None,
    data: DataFolder = None,
    station: StationName = None,
    as_json: AsJson = False,
) -> None:
    """Identify G_q and G_S at one or several tendon tensions (method section 4).

    Runs at tensions at least 5 N apart also yield the Coulomb friction of motor A as a function of load, c0 + c1 r_m F.

    Settings: tension_N [N], amplitude_rad [rad], chip_s [s], bits, periods, settle_s [s],
    estimator (default, or arx as in the paper).
    Settings of the control loop: lam_q, lam_S, lam_motor [s], seed. Others come from the active tuning in the data
    folder.
    """
    from backend.experiments import ActuatorIdentificationPlan

    settings = load_settings(
        plant=plant, virtual_card=virtual_card, wiring=wiring, params=params, data=data, station=station
    )
    chosen = parse_values(values or [])
    if tensions is None:
        _run_identification(
            plan=ActuatorIdentificationPlan,
            values=chosen,
            out=out,
            settings=settings,
            as_json=as_json,
            combine=_estimate_load_friction,
        )
        return
    if "tension_N" in chosen:
        fail(messages.tensions_set_twice(), status=2)
    _require_tendons(settings)
    base = load_active_tuning(settings)
    built = [
        _build_request(ActuatorIdentificationPlan, {**chosen, "tension_N": tension}, base)
        for tension in tensions.split(",")
    ]
    requests, tuning = [request for request, _ in built], built[0][1]
    run_headless_sequence(settings, requests, tuning, out, as_json=as_json, combine=_estimate_load_friction)


def _estimate_load_friction(sources: "Sequence[RunData]") -> tuple[dict[str, Any], str]:
    """Return the load-dependent friction of motor A as JSON entries and as a sentence."""
    from backend.analysis import MOTOR_B, build_friction_document, estimate_run_friction

    found = estimate_run_friction([(source.run, source.columns) for source in sources])
    return {"load_friction": build_friction_document(found)}, "; ".join((found.sentence, *found.left_out, MOTOR_B))


def _run_identification(
    plan: "type[IdentificationPlan]",
    values: dict[str, object],
    out: Path | None,
    settings: Settings,
    as_json: bool,
    combine: CombineRuns | None = None,
) -> None:
    _require_tendons(settings)
    request, tuning = _build_request(plan, values, load_active_tuning(settings))
    run_headless(settings, request, tuning, out, as_json=as_json, combine=combine)


def _require_tendons(settings: Settings) -> None:
    """Raise ParameterError for an actuator without tendons: identifications need load cells."""
    from plant import load_parameters, require_tendons

    require_tendons(load_parameters(settings.params))


def _build_request(
    plan: "type[IdentificationPlan]", values: dict[str, object], base: BaseTuning
) -> "tuple[RunRequest, str]":
    from functools import partial

    from backend.execution import RunRequest
    from backend.models import build_plan, describe_settings

    built, loop_settings, tuning = resolve_settings(describe_settings(plan), partial(build_plan, plan), values, base)
    return RunRequest(built, loop_settings, current_user()), tuning


def _identify_table(table: Path, settings: Settings, header: int | None, decimal: str | None, *, as_json: bool) -> None:
    from backend import __version__
    from backend.analysis import fit_spring_table
    from backend.identification import IdentificationError, decode_text
    from backend.storage import identifications

    try:
        mark = parse_decimal_mark(decimal)
        text = decode_text(table.read_bytes(), table.name)
        fitted = fit_spring_table(table.name, text, current_user(), __version__, header=header, decimal=mark)
    except (IdentificationError, OSError) as error:
        fail(messages.error_in_file(file=table, reason=str(error)), status=2)
    with open_configured_database(settings) as database, database.session() as session:
        stored = identifications.add(session, fitted)
    if as_json:
        print_json(asdict(stored))
        return
    read = stored.table.read
    assert read is not None
    columns = [("elongation", f"x [{read.x_unit}]"), ("force", f"F [{read.F_unit}]")]
    print_layout(
        table.name,
        read.layout,
        [*columns, ("rows used", messages.part_of_whole(part=stored.table.points, whole=int(read.layout["rows"])))],
        read.not_read,
        read.notes,
    )
    fits = stored.springs["table"].model.fits
    rows = [(fit.order, fit.rms_N, fit.max_N, fit.cross_validation_N) for fit in fits]
    print_table(
        ("order", "RMS [N]", "max. error [N]", "cross-validation [N]"),
        rows,
        title=messages.identification_title(number=stored.id),
    )
    console.print(stored.verdict, highlight=False, markup=False)
