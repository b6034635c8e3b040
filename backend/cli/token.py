"""``sinew token``."""

from enum import StrEnum
from typing import Annotated

import typer

from backend.cli.output import fail
from backend.cli.place import DataFolder, settings_with

app = typer.Typer(help="The tokens that open the dashboard.", no_args_is_help=True, rich_markup_mode=None)


class Whose(StrEnum):
    """Whose token is meant."""

    OPERATOR = "operator"
    VIEWER = "viewer"
    BOTH = "both"


@app.callback()
def _group() -> None:
    """Keep ``rotate`` a word of its own."""


@app.command()
def rotate(
    role: Annotated[Whose, typer.Option(help="Whose token to replace.")] = Whose.BOTH,
    data: DataFolder = None,
) -> None:
    """Replace tokens. A running service notices within a second; all sessions of the old ones end then."""
    from backend.auth.sessions import FILES, rotate
    from backend.schemas.state import Role

    settings = settings_with(data=data)
    if not settings.data.is_dir():
        fail(f"there is no data folder {settings.data}: choose one with --data")
    roles = list(Role) if role is Whose.BOTH else [Role(role)]
    rotate(settings.data, roles)
    for one in roles:
        file = settings.data / FILES[one]
        print(f"{one}: /?token={file.read_text().strip()}  (kept in {file})")
