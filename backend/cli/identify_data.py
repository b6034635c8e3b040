"""``sinew identify data``: a record from elsewhere through the same estimators."""

import math
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from backend.cli.output import AsJson, fail, out, print_json, print_table

if TYPE_CHECKING:
    from backend.identification.record import Controller, Record
    from backend.identification.result import CorrelationTest, Estimate
    from backend.identification.table import Columns

METHODS = "default, srivc, rivc, output_error, low_frequency, arx"
MOTOR = "motor"
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
    """Identify a model from a file; nothing is stored.

    A record taken in closed loop needs --setpoint or --controller. Exit status 2 for a file that cannot be read and
    a record that identifies nothing.
    """
    from backend.documents.edge import json_ready
    from backend.identification.errors import IdentificationError
    from backend.identification.estimate import estimate
    from backend.identification.import_data import Selection, record_from

    try:
        record = record_from(
            _read(file),
            u,
            y,
            period_s,
            setpoint=setpoint,
            controller=_controller(controller) if controller else None,
            selection=Selection(skip, *_range(within), resample),
        )
        if structure == MOTOR:
            _show_motor(record, resolution, as_json=as_json)
            return
        found = estimate(record, structure, _method(method), gain_geometry=gain, y_resolution=resolution)
    except (IdentificationError, OSError) as error:
        fail(" ".join(str(error).split()), status=2)
    else:
        print_json(json_ready(found.summary())) if as_json else _show(found)


def _read(file: Path) -> "Columns":
    from backend.identification import import_data
    from backend.identification.errors import DataFileError
    from backend.identification.table import read_csv

    match file.suffix.lower():
        case ".mat":
            with file.open("rb") as stream:
                return import_data.read_mat(stream)
        case ".parquet":
            with file.open("rb") as stream:
                return import_data.read_parquet(stream)
        case ".csv" | ".txt" | ".tsv" | ".dat":
            try:
                return read_csv(file.read_text(encoding="utf-8"))
            except UnicodeDecodeError:
                raise DataFileError(f"{file} is not text in UTF-8: save it as CSV in UTF-8") from None
        case _:
            raise DataFileError(f"{file} is neither .csv, .mat nor .parquet: save the columns as one of these")


def _range(words: str | None) -> tuple[float, float]:
    from backend.identification.errors import DataFileError

    try:
        first, last = (words or ":").split(":")
        return float(first or 0.0), float(last or math.inf)
    except ValueError:
        raise DataFileError(f"--range {words}: write two times in seconds FROM:TO, for example 2:30 or 2:") from None


def _controller(words: str) -> "Controller":
    from backend.identification.errors import DataFileError
    from backend.identification.record import Controller

    try:
        k_p, k_i = (float(word) for word in words.split(","))
    except ValueError:
        raise DataFileError(f"--controller {words}: write two numbers kp,ki, for example 200,256") from None
    return Controller(k_p, k_i)


def _method(name: str) -> Any:
    from backend.identification.errors import StructureError
    from backend.identification.fit import Method

    try:
        return Method(name)
    except ValueError:
        raise StructureError(f"method '{name}' does not exist: choose one of {METHODS}") from None


def _show_motor(record: "Record", resolution: float | None, *, as_json: bool) -> None:
    from backend.documents.edge import json_ready
    from backend.identification.motor_record import NAMES, identify_motor_record

    found = identify_motor_record(record, resolution)
    if as_json:
        print_json(json_ready(found.summary()))
        return
    units = dict(zip(NAMES, ("rad/(V·s)", "s", "V", "s", "V"), strict=True))
    rows = [
        (f"{name} [{units[name]}]", value, std or "left out: does not differ from 0")
        for (name, value), std in zip(found.parameters.items(), found.std_errors, strict=True)
    ]
    print_table(("parameter", "value", "standard error"), rows)
    results = [
        ("method", found.method),
        ("fit on unseen data [%]", _measured(found.fit_percent, ".2f")),
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
        ("fit on unseen data [%]", _measured(found.fit_percent, ".2f")),
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
    from backend.identification.residuals import judged

    return f"{good if test.passed else bad}: {judged(test).sentence}"


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
        ("fit with friction [%]", f"{friction.fit_percent:.2f}"),
    ]


def _input_offset(found: "Estimate") -> list[tuple[str, str]]:
    offset = found.input_offset
    return [] if offset is None else [("input offset u_0", f"{offset.u_0:.4g} ± {offset.u_0_std:.2g}")]


def _measured(value: float, form: str) -> str:
    return format(value, form) if math.isfinite(value) else "not measured"
