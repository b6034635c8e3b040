"""``sinew identify``."""

from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from backend.cli import identify_data
from backend.cli.experiment import OutFolder, SetWords
from backend.cli.ordering import (
    Standing,
    Together,
    current_user,
    in_force,
    ordered,
    run_headless,
    run_in_turn,
    values_of,
)
from backend.cli.output import AsJson, fail, print_json, print_table
from backend.cli.output import out as screen
from backend.cli.place import (
    DataFolder,
    ParameterSet,
    PlantName,
    StationName,
    VirtualCard,
    WiringFile,
    database_of,
    settings_with,
)
from backend.settings import Settings

if TYPE_CHECKING:
    from backend.execution.runner import Order
    from backend.experiments.plans import IdentificationPlan
    from backend.reports.model import Source

app = typer.Typer(
    help="Identify models from experiments on the simulator or from files.", no_args_is_help=True, rich_markup_mode=None
)

app.command()(identify_data.data)

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
    from backend.experiments.plans import MotorIdentificationPlan

    _identify(
        MotorIdentificationPlan,
        values_of(values or []),
        out,
        settings_with(plant=plant, virtual_card=virtual_card, wiring=wiring, params=params, data=data, station=station),
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
    from backend.experiments.plans import SpringIdentificationPlan

    settings = settings_with(
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
    from backend.experiments.plans import ActuatorIdentificationPlan

    settings, chosen = (
        settings_with(plant=plant, virtual_card=virtual_card, wiring=wiring, params=params, data=data, station=station),
        values_of(values or []),
    )
    if tensions is None:
        _identify(ActuatorIdentificationPlan, chosen, out, settings, as_json, _load_friction)
        return
    if "tension_N" in chosen:
        fail("--tensions and --set tension_N=... exclude each other", status=2)
    standing = in_force(settings)
    orders = [
        _order(ActuatorIdentificationPlan, {**chosen, "tension_N": word}, standing) for word in tensions.split(",")
    ]
    run_in_turn(settings, [order for order, _ in orders], orders[0][1], out, as_json=as_json, together=_load_friction)


def _load_friction(sources: "Sequence[Source]") -> tuple[dict[str, Any], str]:
    """Return the friction of motor A over the load from all runs of the command, or why it is not measured."""
    from backend.analysis.identification import MOTOR_B, document_of, load_friction_of

    found = load_friction_of([(source.run, source.columns) for source in sources])
    return {"load_friction": document_of(found)}, "; ".join((found.sentence, *found.left_out, MOTOR_B))


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


def _order(plan: "type[IdentificationPlan]", values: dict[str, object], standing: Standing) -> "tuple[Order, str]":
    from functools import partial

    from backend.execution.runner import Order
    from backend.models.settings import describe, from_values

    chosen, loop_settings, tuning = ordered(describe(plan), partial(from_values, plan), values, standing)
    return Order(chosen, loop_settings, current_user()), tuning


def _identify_table(table: Path, settings: Settings, header: int | None, decimal: str | None, *, as_json: bool) -> None:
    from backend import __version__
    from backend.analysis.identification import from_table
    from backend.cli.identify_data import decimal_mark, show_layout
    from backend.identification.importer import decoded
    from backend.identification.records import IdentificationError
    from backend.storage import identifications

    try:
        mark = decimal_mark(decimal)
        text = decoded(table.read_bytes(), table.name)
        new = from_table(table.name, text, current_user(), __version__, header=header, decimal=mark)
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
