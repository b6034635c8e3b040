"""``sinew bank``."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from backend.cli.experiments import current_user, values_of
from backend.cli.options import DataFolder, ParameterSet, StationName, database_of, load_settings, parameters_in_force
from backend.cli.output import AsJson, fail, out, print_json, print_table, shown

if TYPE_CHECKING:
    from backend.banks import BankEntryChange, OuterLoopFigures
    from backend.storage import Bank, Database, StoredFit

    Fits = Mapping[int, Mapping[str, StoredFit]]

LambdaWords = Annotated[
    list[str] | None, typer.Option("--set", metavar="KEY=VALUE", help="λ of the comparison, in s; repeatable.")
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
        database_of(load_settings(data=data, station=station), reading=True) as database,
        database.reading() as session,
    ):
        found = banks.find(session)
    if as_json:
        print_json([asdict(bank) for bank in found])
        return
    rows = [(b.id, b.name, b.version, len(b.entries), b.who, f"{b.created_at:%Y-%m-%d %H:%M}") for b in found]
    print_table(("bank", "name", "version", "entries", "by", "made (UTC)"), rows)


@app.command()
def show(
    bank: Annotated[int, typer.Argument(help="Number of the bank.")],
    data: DataFolder = None,
    station: StationName = None,
    as_json: AsJson = False,
) -> None:
    """Show the entries of a bank and the identifications they came from."""
    from backend.storage import banks, identifications, load_bank_fits

    with (
        database_of(load_settings(data=data, station=station), reading=True) as database,
        database.reading() as session,
    ):
        found = banks.get(session, bank)
        _print(found, identifications.find_estimate_runs(session), load_bank_fits(session, found), as_json=as_json)


@app.command()
def build(
    name: Annotated[str, typer.Argument(help="Name of the bank; an existing one gets its next version.")],
    identifications: Annotated[list[int], typer.Argument(help="Numbers of the identification runs.")],
    params: ParameterSet = None,
    data: DataFolder = None,
    station: StationName = None,
    as_json: AsJson = False,
) -> None:
    """Build a bank from actuator identifications (sinew identify actuator prints their numbers)."""
    from backend.banks import build_bank
    from backend.storage import find_estimate_runs, load_bank_fits

    settings = load_settings(data=data, station=station)
    with database_of(settings) as database:
        named = params or _parameters_name(database, identifications)
        parameters = parameters_in_force(settings.model_copy(update={"params": named}), database)
        bank = build_bank(database, parameters, name, identifications, current_user())
        with database.reading() as session:
            _print(bank, find_estimate_runs(session), load_bank_fits(session, bank), as_json=as_json)


@app.command()
def diff(
    before: Annotated[int, typer.Argument(help="Number of the bank to compare with.")],
    after: Annotated[int | None, typer.Argument(help="Number of the other bank.")] = None,
    again: Annotated[
        list[int] | None,
        typer.Option(
            "--with", help="Instead of another bank: an identification made again, by its run's number; repeatable."
        ),
    ] = None,
    values: LambdaWords = None,
    params: ParameterSet = None,
    data: DataFolder = None,
    station: StationName = None,
    as_json: AsJson = False,
) -> None:
    """Tell what another bank, or points identified again, would change: models, gains and M_s.

    Settings: lam_q, lam_S, lam_motor [s].
    """
    from backend.banks import build_entry, compare_entries, merge_entries
    from backend.experiments import LoopSettings
    from backend.models import build_plan
    from backend.storage import banks, identifications

    if (after is None) == (not again):
        fail("give either a second bank or --with identifications", status=2)
    lambdas = build_plan(LoopSettings, values_of(values or [])).lambdas
    settings = load_settings(data=data, params=params, station=station)
    with database_of(settings, reading=True) as database, database.reading() as session:
        old = banks.get(session, before).entries
        if after is None:
            new = merge_entries(old, [build_entry(identifications.of_run(session, run_id)) for run_id in again or ()])
        else:
            new = banks.get(session, after).entries
        parameters = parameters_in_force(settings, database)
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
    """Write a bank to a file, to take it to another data folder."""
    from backend.banks import build_bank_document
    from backend.exports import write_file_whole
    from backend.storage import banks

    with (
        database_of(load_settings(data=data, station=station), reading=True) as database,
        database.reading() as session,
    ):
        document = build_bank_document(banks.get(session, bank))
    write_file_whole((json.dumps(document, indent=2, ensure_ascii=False).encode() + b"\n",), file)
    out.print(f"wrote {file}", highlight=False, markup=False)


@app.command("import")
def import_file(
    file: Annotated[Path, typer.Argument(help="File that sinew bank export wrote.")],
    name: Annotated[str, typer.Option("--name", help="Name for the bank; that of the file without it.")] = "",
    params: ParameterSet = None,
    data: DataFolder = None,
    station: StationName = None,
    as_json: AsJson = False,
) -> None:
    """Store an exported bank as the next version of its name, after checking it."""
    from backend.banks import import_bank, parse_bank_file

    settings = load_settings(data=data, params=params, station=station)
    document = parse_bank_file(file.read_text(encoding="utf-8", errors="replace"))
    with database_of(settings) as database:
        bank = import_bank(database, parameters_in_force(settings, database), document, current_user(), name)
        _print(bank, {}, {}, as_json=as_json)


def _parameters_name(database: "Database", chosen: list[int]) -> str:
    """Name the parameters that the first identification was made with."""
    from backend.storage import identifications, runs

    with database.reading() as session:
        return runs.get(session, identifications.of_run(session, chosen[0]).run_id or 0).parameters_name


def _print_changes(changes: "Sequence[BankEntryChange]") -> None:
    from backend.storage import entry_name

    columns = ("entry", "loop", "K", "T [s]", "k_p", "k_i", "M_s")
    rows = []
    for change in changes:
        present = change.after or change.before
        for symbol, loop in (("q", "position"), ("S", "stiffness")):
            old, new = (getattr(entry, loop) if entry else None for entry in (change.before, change.after))
            cells = [_change(getattr(old, name, None), getattr(new, name, None)) for name in ("K", "T", "k_p", "k_i")]
            name = entry_name(present.S_nominal, present.tension_N) if present else ""
            rows.append((name, symbol, *cells, _change(_peak(old), _peak(new))))
    print_table(columns, rows)


def _peak(loop: "OuterLoopFigures | None") -> float | str | None:
    return None if loop is None else "unstable" if loop.M_s is None else loop.M_s


def _change(old: float | str | None, new: float | str | None) -> str:
    return shown(new) if old == new else f"{shown(old)} → {shown(new)}"


def _print(bank: "Bank", run_of: "Mapping[int, int | None]", fits: "Fits", *, as_json: bool) -> None:
    from backend.models import CHANNELS
    from backend.storage import stored_entry_name

    if as_json:
        document = asdict(bank)
        for entry in document["entries"]:
            entry["estimate"] = entry.pop("identification_id")
            entry["identification"] = run_of.get(entry["estimate"] or 0)
            entry["fits"] = {name: asdict(fit) for name, fit in fits.get(entry["estimate"] or 0, {}).items()}
        print_json(document)
        return
    columns = ("entry", "S [N·m/rad]", "K_q", "T_q [s]", "K_S [N·m/rad²]", "T_S [s]", "identification")
    rows = [
        (
            stored_entry_name(entry),
            entry.S_nominal,
            entry.known.K_q,
            entry.known.T_q,
            entry.known.K_S,
            entry.known.T_S,
            run_of.get(entry.identification_id or 0),
        )
        for entry in bank.entries
    ]
    print_table(columns, rows, title=f"bank {bank.id}: {bank.name}, version {bank.version}")
    for entry in bank.entries:
        known = fits.get(entry.identification_id or 0, {})
        told = [f"{name} {known[name].in_words()}" for name in CHANNELS if name in known]
        out.print(f"{stored_entry_name(entry)}: {'; '.join(told) or 'imported, its fit is not known'}", highlight=False)
