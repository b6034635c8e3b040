"""Where a command works: data folder, parameter set, database."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from backend.settings import Settings, settings_of_environment

if TYPE_CHECKING:
    from backend.storage import Database

DataFolder = Annotated[
    Path | None,
    typer.Option("--data", readable=False, help="Folder with the database and the tokens. [./data]"),
]
StationName = Annotated[
    str | None, typer.Option("--station", help="Name of the rig among several on one database; also SINEW_STATION.")
]
ParameterSet = Annotated[str | None, typer.Option("--params", help="Parameter set: lab, ideal or a TOML file. [lab]")]

PlantName = Annotated[
    str | None,
    typer.Option("--plant", help="simulator, rig, replay, or a plant of an installed package. [simulator]"),
]
VirtualCard = Annotated[
    bool | None,
    typer.Option("--virtual-card/--real-card", help="With --plant rig: a simulated card in place of the real one."),
]
WiringFile = Annotated[
    str | None, typer.Option("--wiring", help="With --plant rig: pcie-6323 or a TOML file. [pcie-6323]")
]
CardAddress = Annotated[
    str | None, typer.Option("--card-address", help="With --plant rig: HOST:PORT of NI's gRPC device server.")
]
Recording = Annotated[
    Path | None, typer.Option("--recording", help="With --plant replay: the recording to play back, a file.")
]


def settings_with(**chosen: object) -> Settings:
    """Return the settings: what the command line leaves out comes from the environment or is the default."""
    environment = settings_of_environment().model_dump()
    return Settings.model_validate({**environment, **{k: v for k, v in chosen.items() if v is not None}})


@contextmanager
def database_of(settings: Settings) -> "Iterator[Database]":
    """Open the database, migrated to the newest schema, for the block."""
    from backend.storage import open_database

    database = open_database(settings.data, settings.database_url, settings.database_password(), settings.station)
    try:
        yield database
    finally:
        database.close()
