"""``sinew bank``."""

from dataclasses import asdict
from typing import TYPE_CHECKING, Annotated

import typer

from backend.cli.ordering import current_user
from backend.cli.output import AsJson, print_json, print_table
from backend.cli.place import DataFolder, database_of, settings_with

if TYPE_CHECKING:
    from backend.storage.banks import Bank

app = typer.Typer(
    help="Controller banks: list them, build them from identifications.", no_args_is_help=True, rich_markup_mode=None
)


@app.command("list")
def list_banks(data: DataFolder = None, as_json: AsJson = False) -> None:
    """List all versions of all banks, newest first."""
    from backend.storage import banks

    with database_of(settings_with(data=data)) as database, database.reading() as session:
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
    as_json: AsJson = False,
) -> None:
    """Show the entries of a bank and the identifications they came from."""
    from backend.storage import banks

    with database_of(settings_with(data=data)) as database, database.reading() as session:
        _print(banks.get(session, bank), as_json=as_json)


@app.command()
def build(
    name: Annotated[str, typer.Argument(help="Name of the bank; an existing one gets its next version.")],
    identifications: Annotated[list[int], typer.Argument(help="Numbers of actuator identifications.")],
    data: DataFolder = None,
    as_json: AsJson = False,
) -> None:
    """Build a bank from actuator identifications (sinew identify actuator prints their numbers)."""
    from backend.experiments.bank_building import build_bank

    with database_of(settings_with(data=data)) as database:
        _print(build_bank(database, name, identifications, current_user()), as_json=as_json)


def _print(bank: "Bank", *, as_json: bool) -> None:
    if as_json:
        print_json(asdict(bank))
        return
    columns = ("S [N·m/rad]", "K_q", "T_q [s]", "K_S [N·m/rad²]", "T_S [s]", "identification")
    rows = [
        (entry.S_nominal, *(entry.model[name] for name in ("K_q", "T_q", "K_S", "T_S")), entry.identification_id)
        for entry in bank.entries
    ]
    print_table(columns, rows, title=f"bank {bank.id}: {bank.name}, version {bank.version}")
