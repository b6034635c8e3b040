"""``sinew identify``, on the rig or on a record from elsewhere."""

import math
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from backend.cli.experiments import (
    OutFolder,
    RunConfiguration,
    SetWords,
    Together,
    current_user,
    in_force,
    ordered,
    run_headless,
    run_in_turn,
    values_of,
)
from backend.cli.options import (
    DataFolder,
    ParameterSet,
    PlantName,
    StationName,
    VirtualCard,
    WiringFile,
    database_of,
    load_settings,
)
from backend.cli.output import AsJson, fail, out, print_json, print_table
from backend.cli.output import out as screen
from backend.settings import Settings
from backend.units import percent

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


# Identify data -------------------------------------------------------------------------------------
#
# ``sinew identify data``: a record from elsewhere through the same estimators.


METHODS = "default, srivc, rivc, output_error, low_frequency, arx"
MOTOR = "motor"
_TEXT_FILES = (".csv", ".txt", ".tsv", ".dat", ".asc", ".log", ".lvm")
_SAID = ("format", "rows")
"""What the table of a reading says in words of its own."""
STRUCTURES = (
    "first, third, lags2 .. lags6, order:1 .. order:4, each also with a dead time as in first+delay;"
    " motor: angle from voltage, with dead time and dry friction"
)


def data(
    file: Annotated[Path, typer.Argument(help="Table of samples: .csv, .mat (version 7) or .parquet.")],
    u: Annotated[str, typer.Option("--input", metavar="COLUMN", help="Column of the input u, held between samples.")],
    y: Annotated[str, typer.Option("--output", metavar="COLUMN", help="Column of the output y.")],
    structure: Annotated[str, typer.Option(metavar="NAME", help=f"Structure: {STRUCTURES}.")],
    period_s: Annotated[
        float | None,
        typer.Option("--period", metavar="SECONDS", help="Sample time [s]; a time column gives it or is checked."),
    ] = None,
    time: Annotated[
        str | None,
        typer.Option(
            metavar="COLUMN", help="Column of the time, or none: the file's time column is not read beside --period."
        ),
    ] = None,
    time_unit: Annotated[
        str | None,
        typer.Option(metavar="UNIT", help="Unit of the time: s, ms, us, ns, min, h, d; of dates: dmy or mdy."),
    ] = None,
    header: Annotated[
        int | None,
        typer.Option(metavar="LINE", min=1, help="Line of the file that names the columns; what is above is not read."),
    ] = None,
    decimal: Annotated[
        str | None,
        typer.Option(metavar="MARK", help="Mark before the decimals of a table of text: point or comma."),
    ] = None,
    setpoint: Annotated[
        str | None,
        typer.Option(metavar="COLUMN", help="Column of what enters the loop from outside: set point or excitation."),
    ] = None,
    controller: Annotated[
        str | None,
        typer.Option(
            metavar="KP,KI", help="Feedback u = kp (r - y) + ki ∫(r - y), ki per second; needs no --setpoint."
        ),
    ] = None,
    skip: Annotated[int, typer.Option(metavar="ROWS", min=0, help="Leave out so many rows at the start.")] = 0,
    take: Annotated[
        int | None, typer.Option(metavar="ROWS", min=1, help="Take so many rows, after those left out.")
    ] = None,
    within: Annotated[
        str | None, typer.Option("--range", metavar="FROM:TO", help="Take these seconds of the file, as in 2:30 or 2:")
    ] = None,
    resample: Annotated[
        bool, typer.Option("--resample", help="Take rows of uneven times at even ones, across short gaps.")
    ] = False,
    gain: Annotated[
        float | None,
        typer.Option(metavar="K", help="Static gain that is known otherwise, as from geometry; the verdict compares."),
    ] = None,
    resolution: Annotated[
        float | None,
        typer.Option(metavar="STEP", help="One count of the output's sensor; found where the values are few."),
    ] = None,
    method: Annotated[str, typer.Option(metavar="NAME", help=f"Estimator: {METHODS}.")] = "default",
    as_json: AsJson = False,
) -> None:
    """Identify a model from a file, and say what was read of it; nothing is stored.

    A record taken in closed loop needs --setpoint or --controller. Exit status 2 for a file that cannot be read and
    a record that identifies nothing.
    """
    from backend.identification import IdentificationError, Selection, TimeChoice, estimate_model, import_record
    from backend.models import replace_non_finite

    try:
        record, reading = import_record(
            _read(file, header, decimal_mark(decimal)),
            u,
            y,
            period_s,
            setpoint=setpoint,
            controller=_controller(controller) if controller else None,
            selection=Selection(skip, *_range(within), resample, take),
            time=TimeChoice(time, time_unit),
            file=file.name,
        )
        if structure == MOTOR:
            _show_motor(record, reading, resolution, as_json=as_json)
            return
        found = estimate_model(record, structure, _method(method), gain_geometry=gain, y_resolution=resolution)
    except (IdentificationError, OSError) as error:
        fail(" ".join(str(error).split()), status=2)
    if as_json:
        print_json(replace_non_finite({"read": reading.to_json(), **found.summary()}))
    else:
        _show_reading(reading)
        _show(found)


def _read(file: Path, header: int | None, decimal: "DecimalMark | None") -> "Columns":
    from backend.identification import DataFileError, FileFault, decode_text, read_csv, read_mat, read_parquet

    suffix = file.suffix.lower()
    if suffix in _TEXT_FILES:
        return read_csv(decode_text(file.read_bytes(), file.name), header=header, decimal=decimal)
    if header is not None or decimal is not None:
        raise DataFileError(
            f"{file.name} is no table of text: --header and --decimal are for those",
            FileFault.OPTION,
            option="--header" if header is not None else "--decimal",
        )
    if suffix in (".mat", ".parquet"):
        with file.open("rb") as stream:
            return read_mat(stream) if suffix == ".mat" else read_parquet(stream)
    raise DataFileError(
        f"{file} is neither .csv, .mat nor .parquet: save the columns as one of these", FileFault.FORMAT
    )


def decimal_mark(words: str | None) -> "DecimalMark | None":
    """Return the mark that an option names. Raises DataFileError."""
    from backend.identification import DataFileError, DecimalMark, FileFault

    try:
        return None if words is None else DecimalMark(words)
    except ValueError:
        raise DataFileError(f"--decimal {words}: write point or comma", FileFault.OPTION, option="--decimal") from None


def _range(words: str | None) -> tuple[float, float]:
    from backend.identification import DataFileError, FileFault

    try:
        first, last = (words or ":").split(":")
        start_s, end_s = float(first or 0.0), float(last or math.inf)
        if not end_s > start_s:
            raise ValueError
        return start_s, end_s
    except ValueError:
        raise DataFileError(
            f"--range {words}: write two times in seconds FROM:TO, for example 2:30 or 2:",
            FileFault.OPTION,
            option="--range",
        ) from None


def _controller(words: str) -> "Controller":
    from backend.identification import Controller, DataFileError, FileFault

    try:
        k_p, k_i = (float(word) for word in words.split(","))
    except ValueError:
        raise DataFileError(
            f"--controller {words}: write two numbers kp,ki, for example 200,256",
            FileFault.OPTION,
            option="--controller",
        ) from None
    return Controller(k_p, k_i)


def _method(name: str) -> Any:
    from backend.identification import Method, StructureError

    try:
        return Method(name)
    except ValueError:
        raise StructureError(f"method '{name}' does not exist: choose one of {METHODS}") from None


def _show_reading(reading: "ImportSummary") -> None:
    """Print what was read of the file."""
    rows = [
        *((role, _with_unit(column, reading.units.get(column))) for role, column in reading.columns.items()),
        ("time column", _time(reading)),
        ("sample time", f"{reading.sample_time_s:.6g} s, from {reading.sample_time_from}{_steps(reading)}"),
        ("rows used", f"{reading.rows_used} of {reading.rows_in_file}, {reading.first_row} to {reading.last_row}"),
        *([("samples, taken at even instants", str(reading.samples))] if reading.resampled else []),
    ]
    show_layout(reading.file, reading.layout, rows, reading.not_read, reading.notes)


def show_layout(
    file: str,
    layout: "Mapping[str, str | int]",
    rows: "Sequence[tuple[str, str]]",
    not_read: "Mapping[str, str]",
    notes: "Iterable[str]",
) -> None:
    """Print how a file is laid out, ``rows`` that say what was read of it, and what was not."""
    told = [
        ("file", f"{file}, {layout['format']}"),
        *((name.replace("_", " "), str(value)) for name, value in layout.items() if name not in _SAID and value != 0),
        *rows,
        *(
            ("not read", f"{', '.join(name for name, other in not_read.items() if other == reason)}: {reason}")
            for reason in dict.fromkeys(not_read.values())
        ),
        *(("note", note) for note in notes),
    ]
    print_table(("", "read"), told)


def _with_unit(column: str, unit: str | None) -> str:
    return f"{column} [{unit}]" if unit else column


def _time(reading: "ImportSummary") -> str:
    if reading.time_column is None:
        return "none"
    if reading.time_unit_from == "dates":
        return f"{reading.time_column}, {reading.time_unit}"
    return f"{reading.time_column}, unit {reading.time_unit} ({reading.time_unit_from})"


def _steps(reading: "ImportSummary") -> str:
    if reading.least_step_s is None or reading.largest_step_s is None:
        return ""
    return f"; rows are {reading.least_step_s:.6g} to {reading.largest_step_s:.6g} s apart"


def _show_motor(record: "Record", reading: "ImportSummary", resolution: float | None, *, as_json: bool) -> None:
    from backend.identification import NAMES, identify_motor_record
    from backend.models import replace_non_finite

    found = identify_motor_record(record, resolution)
    if as_json:
        print_json(replace_non_finite({"read": reading.to_json(), **found.summary()}))
        return
    _show_reading(reading)
    units = dict(zip(NAMES, ("rad/(V·s)", "s", "V", "s", "V"), strict=True))
    rows = [
        (f"{name} [{units[name]}]", value, std or "left out: does not differ from 0")
        for (name, value), std in zip(found.parameters.items(), found.std_errors, strict=True)
    ]
    print_table(("parameter", "value", "standard error"), rows)
    results = [
        ("method", found.method),
        ("fit on unseen data [%]", _share(found.fit_percent)),
        *_tests(found.whiteness, found.input_correlation),
    ]
    print_table(("", "result"), results)
    out.print(found.verdict.sentence, highlight=False, markup=False)


def _show(found: "Estimate") -> None:
    print_table(
        ("parameter", "value", "standard error"),
        [(name, value, _measured(found.std_errors[name], ".4g")) for name, value in found.model.parameters.items()],
    )
    reduced, tests = found.first_order, found.residuals
    rows = [
        ("method", found.method),
        ("gain K", f"{reduced.K:.4g} ± {_measured(reduced.K_std, '.2g')}"),
        (
            "sum of lags" + (" and dead time" if found.model.dead_time else "") + " T [s]",
            f"{reduced.T:.4g} ± {_measured(reduced.T_std, '.2g')}",
        ),
        *_friction(found),
        *_input_offset(found),
        ("fit on unseen data [%]", _share(found.fit_percent)),
        *_tests(tests.whiteness, tests.input_correlation),
    ]
    print_table(("", "result"), rows)
    out.print(found.verdict.sentence, highlight=False, markup=False)


def _tests(whiteness: "CorrelationTest", input_correlation: "CorrelationTest") -> list[tuple[str, str]]:
    return [
        ("residuals", _tested(whiteness, "white", "coloured")),
        ("residuals and input", _tested(input_correlation, "independent", "correlated")),
    ]


def _tested(test: "CorrelationTest", good: str, bad: str) -> str:
    from backend.identification import read_whiteness_test

    return f"{good if test.passed else bad}: {read_whiteness_test(test).sentence}"


def _friction(found: "Estimate") -> list[tuple[str, str]]:
    friction = found.friction
    if friction is None:
        return []
    if not friction.found:
        return [("dry friction u_c", f"none told ({friction.u_c:.2g} ± {friction.u_c_std:.2g})")]
    return [
        ("dry friction u_c", f"{friction.u_c:.4g} ± {friction.u_c_std:.2g}"),
        ("gain K with friction", f"{friction.K:.4g} ± {friction.K_std:.2g}"),
        ("lag T with friction [s]", f"{friction.T:.4g} ± {friction.T_std:.2g}"),
        ("fit with friction [%]", percent(friction.fit_percent, 2)),
    ]


def _input_offset(found: "Estimate") -> list[tuple[str, str]]:
    offset = found.input_offset
    return [] if offset is None else [("input offset u_0", f"{offset.u_0:.4g} ± {offset.u_0_std:.2g}")]


def _share(value: float) -> str:
    return percent(value, 2) if math.isfinite(value) else "not measured"


def _measured(value: float | None, form: str) -> str:
    return format(value, form) if value is not None and math.isfinite(value) else "not measured"


# Identify ------------------------------------------------------------------------------------------
#
# ``sinew identify``.


app = typer.Typer(
    help="Identify models from experiments on the simulator or from files.", no_args_is_help=True, rich_markup_mode=None
)

app.command()(data)

Tensions = Annotated[
    str | None,
    typer.Option("--tensions", metavar="N,N,...", help="Tensions [N], one run at each, one after the other."),
]
Header = Annotated[
    int | None, typer.Option("--header", metavar="LINE", min=1, help="Line of the table that names its columns.")
]
Decimal = Annotated[
    str | None, typer.Option("--decimal", metavar="MARK", help="Mark before the decimals of the table: point or comma.")
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
    """Identify K_m, T_m and dry friction of both motors from unloaded voltage steps (method section 2).

    Settings: u_low, u_high [V], levels, travel_rad [rad], step_s, settle_s [s].
    Settings of the loop: lam_motor [s], seed. What is not set is as it is in force in the data folder.
    """
    from backend.experiments import MotorIdentificationPlan

    _identify(
        MotorIdentificationPlan,
        values_of(values or []),
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
    """Identify both springs from a slow sweep of the tension, or one from a measured table (method section 3).

    Settings: F_low, F_high [N], sweep_s [s], cycles, settle_s [s].
    Settings of the loop: lam_motor [s], seed. What is not set is as it is in force in the data folder.
    """
    from backend.experiments import SpringIdentificationPlan

    settings = load_settings(
        plant=plant, virtual_card=virtual_card, wiring=wiring, params=params, data=data, station=station
    )
    if table is None and (header is not None or decimal is not None):
        fail("--header and --decimal are for a --table", status=2)
    elif table is None:
        _identify(SpringIdentificationPlan, values_of(values or []), out, settings, as_json)
    elif values or out:
        fail("a table is identified as it is: leave --set and --out away", status=2)
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
    """Identify G_q and G_S in closed loop, at one tendon tension or at several in turn (method section 4).

    Runs at tensions at least 5 N apart also give the Coulomb friction of motor A over the load, c0 + c1 r_m F.

    Settings: tension_N [N], amplitude_rad [rad], chip_s [s], bits, periods, settle_s [s],
    estimator (default or arx, the paper's).
    Settings of the loop: lam_q, lam_S, lam_motor [s], seed. What is not set is as it is in force in the data folder.
    """
    from backend.experiments import ActuatorIdentificationPlan

    settings, chosen = (
        load_settings(plant=plant, virtual_card=virtual_card, wiring=wiring, params=params, data=data, station=station),
        values_of(values or []),
    )
    if tensions is None:
        _identify(
            plan=ActuatorIdentificationPlan,
            values=chosen,
            out=out,
            settings=settings,
            as_json=as_json,
            together=_load_friction,
        )
        return
    if "tension_N" in chosen:
        fail("--tensions and --set tension_N=... exclude each other", status=2)
    standing = in_force(settings)
    orders = [
        _order(ActuatorIdentificationPlan, {**chosen, "tension_N": word}, standing) for word in tensions.split(",")
    ]
    run_in_turn(settings, [order for order, _ in orders], orders[0][1], out, as_json=as_json, together=_load_friction)


def _load_friction(sources: "Sequence[RunData]") -> tuple[dict[str, Any], str]:
    """Return the friction of motor A over the load from all runs of the command, or why it is not measured."""
    from backend.analysis import MOTOR_B, build_identification_document, estimate_run_friction

    found = estimate_run_friction([(source.run, source.columns) for source in sources])
    return {"load_friction": build_identification_document(found)}, "; ".join(
        (found.sentence, *found.left_out, MOTOR_B)
    )


def _identify(
    plan: "type[IdentificationPlan]",
    values: dict[str, object],
    out: Path | None,
    settings: Settings,
    as_json: bool,
    together: Together | None = None,
) -> None:
    order, tuning = _order(plan, values, in_force(settings))
    run_headless(settings, order, tuning, out, as_json=as_json, together=together)


def _order(
    plan: "type[IdentificationPlan]", values: dict[str, object], standing: RunConfiguration
) -> "tuple[RunRequest, str]":
    from functools import partial

    from backend.execution import RunRequest
    from backend.models import build_plan, describe_settings

    chosen, loop_settings, tuning = ordered(describe_settings(plan), partial(build_plan, plan), values, standing)
    return RunRequest(chosen, loop_settings, current_user()), tuning


def _identify_table(table: Path, settings: Settings, header: int | None, decimal: str | None, *, as_json: bool) -> None:
    from backend import __version__
    from backend.analysis import fit_spring_table
    from backend.identification import IdentificationError, decode_text
    from backend.storage import identifications

    try:
        mark = decimal_mark(decimal)
        text = decode_text(table.read_bytes(), table.name)
        new = fit_spring_table(table.name, text, current_user(), __version__, header=header, decimal=mark)
    except (IdentificationError, OSError) as error:
        fail(f"{table}: {error}", status=2)
    with database_of(settings) as database, database.session() as session:
        found = identifications.add(session, new)
    if as_json:
        print_json(asdict(found))
        return
    read = found.table.read
    assert read is not None
    columns = [("elongation", f"x [{read.x_unit}]"), ("force", f"F [{read.F_unit}]")]
    show_layout(
        table.name,
        read.layout,
        [*columns, ("rows used", f"{found.table.points} of {read.layout['rows']}")],
        read.not_read,
        read.notes,
    )
    fits = found.springs["table"].model.fits
    rows = [(fit.order, fit.rms_N, fit.max_N, fit.cross_validation_N) for fit in fits]
    print_table(("order", "RMS [N]", "largest [N]", "left out [N]"), rows, title=f"identification {found.id}")
    screen.print(found.verdict, highlight=False, markup=False)
