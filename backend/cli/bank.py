"""Commands ``sinew bank``: list, build, compare, export and import banks."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from backend.cli import messages
from backend.cli.experiments import current_user, parse_values
from backend.cli.options import (
    DataFolder,
    ParameterSet,
    StationName,
    load_plant_parameters,
    load_settings,
    open_configured_database,
)
from backend.cli.output import AsJson, console, fail, format_cell, print_json, print_table

if TYPE_CHECKING:
    from backend.banks import BankEntryChange, OuterLoopFigures
    from backend.storage import Bank, Database, StoredFit

    Fits = Mapping[int, Mapping[str, StoredFit]]

LambdaOptions = Annotated[
    list[str] | None, typer.Option("--set", metavar="KEY=VALUE", help="λ for the comparison [s]; repeatable.")
]

app = typer.Typer(
    help="Controller banks: list, build from identifications, compare, export, import.",
    no_args_is_help=True,
    rich_markup_mode=None,
)


@app.command("list")
def list_banks(data: DataFolder = None, station: StationName = None, as_json: AsJson = False) -> None:
    """List all versions of all banks, newest first."""
    from backend.storage import banks

    with (
        open_configured_database(load_settings(data=data, station=station), read_only=True) as database,
        database.reading() as session,
    ):
        found = banks.find(session)
    if as_json:
        print_json([asdict(bank) for bank in found])
        return
    rows = [(b.id, b.name, b.version, len(b.entries), b.who, f"{b.created_at:%Y-%m-%d %H:%M}") for b in found]
    print_table(("bank", "name", "version", "points", "by", "created (UTC)"), rows)


@app.command()
def show(
    bank: Annotated[int, typer.Argument(help="Number of the bank.")],
    data: DataFolder = None,
    station: StationName = None,
    as_json: AsJson = False,
) -> None:
    """Show the operating points of a bank and their identifications."""
    from backend.storage import banks, identifications, load_bank_fits

    with (
        open_configured_database(load_settings(data=data, station=station), read_only=True) as database,
        database.reading() as session,
    ):
        found = banks.get(session, bank)
        _print_bank(found, identifications.find_estimate_runs(session), load_bank_fits(session, found), as_json=as_json)


@app.command()
def build(
    name: Annotated[str, typer.Argument(help="Name of the bank; an existing one gets its next version.")],
    identifications: Annotated[list[int], typer.Argument(help="Numbers of the identification runs.")],
    params: ParameterSet = None,
    data: DataFolder = None,
    station: StationName = None,
    as_json: AsJson = False,
) -> None:
    """Build a bank from actuator identifications.

    `sinew identify actuator` prints their numbers.
    """
    from backend.banks import build_bank
    from backend.storage import find_estimate_runs, load_bank_fits

    settings = load_settings(data=data, station=station)
    with open_configured_database(settings) as database:
        parameter_set = params or _find_parameters_name(database, identifications)
        parameters = load_plant_parameters(settings.model_copy(update={"params": parameter_set}), database)
        bank = build_bank(database, parameters, name, identifications, current_user())
        with database.reading() as session:
            _print_bank(bank, find_estimate_runs(session), load_bank_fits(session, bank), as_json=as_json)


@app.command()
def diff(
    before: Annotated[int, typer.Argument(help="Number of the first bank.")],
    after: Annotated[int | None, typer.Argument(help="Number of the second bank.")] = None,
    again: Annotated[
        list[int] | None,
        typer.Option("--with", help="Instead of a second bank: run number of a new identification; repeatable."),
    ] = None,
    values: LambdaOptions = None,
    params: ParameterSet = None,
    data: DataFolder = None,
    station: StationName = None,
    as_json: AsJson = False,
) -> None:
    """Compare models, gains and M_s of a bank with another one or new identifications.

    Settings: lam_q, lam_S, lam_motor [s].
    """
    from backend.banks import build_entry, compare_entries, merge_entries
    from backend.experiments import LoopSettings
    from backend.models import build_plan
    from backend.storage import banks, identifications

    if (after is None) == (not again):
        fail(messages.bank_or_identifications(), status=2)
    lambdas = build_plan(LoopSettings, parse_values(values or [])).lambdas
    settings = load_settings(data=data, params=params, station=station)
    with open_configured_database(settings, read_only=True) as database, database.reading() as session:
        old = banks.get(session, before).entries
        if after is None:
            new = merge_entries(old, [build_entry(identifications.of_run(session, run_id)) for run_id in again or ()])
        else:
            new = banks.get(session, after).entries
        parameters = load_plant_parameters(settings, database)
    changes = compare_entries(parameters, lambdas, old, new)
    if as_json:
        print_json([asdict(change) for change in changes])
    else:
        _print_changes(changes)


@app.command()
def export(
    bank: Annotated[int, typer.Argument(help="Number of the bank.")],
    file: Annotated[Path, typer.Argument(help="File to write, JSON.")],
    data: DataFolder = None,
    station: StationName = None,
) -> None:
    """Write a bank to a file that another data folder can import."""
    from backend.banks import build_bank_document
    from backend.exports import write_file_whole
    from backend.storage import banks

    with (
        open_configured_database(load_settings(data=data, station=station), read_only=True) as database,
        database.reading() as session,
    ):
        document = build_bank_document(banks.get(session, bank))
    write_file_whole((json.dumps(document, indent=2, ensure_ascii=False).encode() + b"\n",), file)
    console.print(messages.wrote(files=str(file)), highlight=False, markup=False)


@app.command("import")
def import_file(
    file: Annotated[Path, typer.Argument(help="File that sinew bank export wrote.")],
    name: Annotated[str, typer.Option("--name", help="Name for the bank. [the name in the file]")] = "",
    params: ParameterSet = None,
    data: DataFolder = None,
    station: StationName = None,
    as_json: AsJson = False,
) -> None:
    """Check an exported bank and store it as the next version of its name."""
    from backend.banks import import_bank, parse_bank_file

    settings = load_settings(data=data, params=params, station=station)
    document = parse_bank_file(file.read_text(encoding="utf-8", errors="replace"))
    with open_configured_database(settings) as database:
        bank = import_bank(database, load_plant_parameters(settings, database), document, current_user(), name)
        _print_bank(bank, {}, {}, as_json=as_json)


def _find_parameters_name(database: "Database", run_ids: list[int]) -> str:
    """Return the name of the parameter set of the first identification."""
    from backend.storage import identifications, runs

    with database.reading() as session:
        return runs.get(session, identifications.of_run(session, run_ids[0]).run_id or 0).parameters_name


def _print_changes(changes: "Sequence[BankEntryChange]") -> None:
    from backend.storage import entry_name

    columns = ("operating point", "loop", "K", "T [s]", "k_p", "k_i", "M_s")
    rows = []
    for change in changes:
        entry = change.after or change.before
        for symbol, loop in (("q", "position"), ("S", "stiffness")):
            old, new = (getattr(side, loop) if side else None for side in (change.before, change.after))
            cells = [
                _format_change(getattr(old, name, None), getattr(new, name, None)) for name in ("K", "T", "k_p", "k_i")
            ]
            name = entry_name(entry.S_nominal, entry.tension_N) if entry else ""
            rows.append((name, symbol, *cells, _format_change(_format_peak(old), _format_peak(new))))
    print_table(columns, rows)


def _format_peak(loop: "OuterLoopFigures | None") -> float | str | None:
    return None if loop is None else "unstable" if loop.M_s is None else loop.M_s


def _format_change(old: float | str | None, new: float | str | None) -> str:
    return format_cell(new) if old == new else f"{format_cell(old)} → {format_cell(new)}"


def _print_bank(bank: "Bank", runs: "Mapping[int, int | None]", fits: "Fits", *, as_json: bool) -> None:
    """Print a bank.

    ``runs`` and ``fits`` are by the number of the entry's stored identification.
    """
    from backend.models import CHANNELS
    from backend.storage import stored_entry_name

    if as_json:
        document = asdict(bank)
        for entry in document["entries"]:
            entry["estimate"] = entry.pop("identification_id")
            entry["identification"] = runs.get(entry["estimate"] or 0)
            entry["fits"] = {name: asdict(fit) for name, fit in fits.get(entry["estimate"] or 0, {}).items()}
        print_json(document)
        return
    columns = ("operating point", "S [N·m/rad]", "K_q", "T_q [s]", "K_S [N·m/rad²]", "T_S [s]", "identification")
    rows = [
        (
            stored_entry_name(entry),
            entry.S_nominal,
            entry.known.K_q,
            entry.known.T_q,
            entry.known.K_S,
            entry.known.T_S,
            runs.get(entry.identification_id or 0),
        )
        for entry in bank.entries
    ]
    print_table(columns, rows, title=messages.bank_title(bank_id=bank.id, name=bank.name, version=bank.version))
    for entry in bank.entries:
        entry_fits = fits.get(entry.identification_id or 0, {})
        texts = [f"{name} {entry_fits[name].in_words()}" for name in CHANNELS if name in entry_fits]
        console.print(messages.fits_of_entry(entry=stored_entry_name(entry), fits=texts), highlight=False)
