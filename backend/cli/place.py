"""Where a command works: data folder, parameter set, database."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from backend.settings import Settings

if TYPE_CHECKING:
    from backend.storage import Database

DataFolder = Annotated[Path | None, typer.Option("--data", help="Folder with the database and the tokens. [./data]")]
ParameterSet = Annotated[str | None, typer.Option("--params", help="Parameter set: lab, ideal or a TOML file. [lab]")]


def settings_with(**chosen: object) -> Settings:
    """Return the settings: what the command line leaves out comes from the environment or is the default."""
    return Settings.model_validate({**Settings().model_dump(), **{k: v for k, v in chosen.items() if v is not None}})


@contextmanager
def database_of(settings: Settings) -> "Iterator[Database]":
    """Open the database, migrated to the newest schema, for the block."""
    from backend.storage import open_database

    database = open_database(settings.data, settings.database_url)
    try:
        yield database
    finally:
        database.close()
