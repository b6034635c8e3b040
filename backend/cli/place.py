"""Where a command works: data folder, parameter set, database."""

import os
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from backend.settings import Settings, settings_of_environment

if TYPE_CHECKING:
    from backend.storage import Database
    from plant.parameters import PlantParameters

CACHE_FALLBACK = "SINEW_CACHE_FALLBACK"
"""Variable with the data folder: compiled code is kept there where no cache folder can be written."""
_INTERRUPTED = "what played it ended while this run was open; found when its folder was opened next"

DataFolder = Annotated[
    Path | None,
    typer.Option("--data", readable=False, help="Folder with the database and the tokens. [./data]"),
]
StationName = Annotated[
    str | None, typer.Option("--station", help="Name of the rig among several on one database; also SINEW_STATION.")
]
ParameterSet = Annotated[
    str | None, typer.Option("--params", help="Parameter set: lab, lab-stick, ideal or a TOML file. [lab]")
]

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
    settings = Settings.model_validate({**environment, **{k: v for k, v in chosen.items() if v is not None}})
    os.environ[CACHE_FALLBACK] = str(settings.data.absolute())  # of plant.compiled, which takes long to import
    return settings


@contextmanager
def database_of(settings: Settings) -> "Iterator[Database]":
    """Open the database, migrated to the newest schema, for the block."""
    from backend.storage import open_database

    database = open_database(settings.data, settings.database_url, settings.database_password(), settings.station)
    try:
        _close_interrupted(settings, database)
        yield database
    finally:
        database.close()


def parameters_in_force(settings: Settings, database: "Database") -> "PlantParameters":
    """Return the parameter set with what was applied to it in this folder. Raises ParameterError."""
    from backend.experiments.applied_parameters import in_force
    from plant.parameters import load_parameters

    return in_force(database, load_parameters(settings.params))


def has_database(settings: Settings) -> bool:
    """Whether there is something to read: to open it would make a folder that is not there."""
    from backend.storage.database import FILE_NAME

    return settings.database_url is not None or (settings.data / FILE_NAME).exists()


def _close_interrupted(settings: Settings, database: "Database") -> None:
    """Close the runs of commands and services that were killed; of a database server only a service can tell them."""
    from backend.data_folder import held_by_nobody
    from backend.storage import StorageError, runs

    if settings.database_url is not None:
        return
    with suppress(StorageError):  # of a damaged file as much is done as can be
        with database.reading() as session:
            interrupted = runs.open_ones(session)
        if interrupted:
            with held_by_nobody(settings.data) as free:
                if free:
                    with database.session() as session:
                        runs.close_interrupted(session, _INTERRUPTED)
