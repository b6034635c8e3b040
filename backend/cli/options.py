"""Options that commands share: data folder, parameter set, database, running service."""

import http.client
import json
import os
from collections.abc import Iterator
from contextlib import contextmanager, nullcontext, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, TypeVar
from urllib.parse import urlsplit

import typer
from pydantic import BaseModel, ValidationError

from backend.cli.output import fail
from backend.settings import Settings, settings_of_environment

if TYPE_CHECKING:
    from backend.storage import Database
    from plant import PlantParameters


# Place ---------------------------------------------------------------------------------------------
#
# Where a command works: data folder, parameter set, database.


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


def load_settings(**chosen: object) -> Settings:
    """Return the settings: what the command line leaves out comes from the environment or is the default."""
    environment = settings_of_environment().model_dump()
    settings = Settings.model_validate({**environment, **{k: v for k, v in chosen.items() if v is not None}})
    os.environ[CACHE_FALLBACK] = str(settings.data.absolute())  # of plant.compilation, which takes long to import
    return settings


@contextmanager
def database_of(settings: Settings, *, reading: bool = False, held: bool = False) -> "Iterator[Database]":
    """Open the database for the block, to write, or only for ``reading``; ``held`` says that the folder is ours.

    A writer migrates a database of an earlier schema, unless a service works on it. A reader never does: it reads the
    database as it is, where it can. Raises SchemaError.
    """
    from backend.storage import OutdatedError, is_outdated, open_database

    _complete_restore(settings, held=held)
    where = settings.data, settings.database_url, settings.database_password(), settings.station
    try:
        database = open_database(*where, outdated="read" if reading else "refuse")
    except OutdatedError:
        if reading:
            raise
        database = _migrated(settings, held=held)
    try:
        if not (reading and is_outdated(database.engine)):
            _close_interrupted(settings, database)
        yield database
    finally:
        database.close()


def _complete_restore(settings: Settings, *, held: bool) -> None:
    """Complete or take back a restore that was killed, unless somebody works in the folder; say so."""
    from backend.cli.output import errors
    from backend.data_folder import held_by_nobody
    from backend.storage import find_database_file, is_restore_incomplete, recover_database

    file = find_database_file(settings.data, settings.database_url)
    if file is None or not is_restore_incomplete(file):
        return
    with nullcontext(True) if held else held_by_nobody(settings.data) as free:
        for sentence in recover_database(file) if free else []:
            errors.print(sentence, highlight=False, markup=False, soft_wrap=True)


def _migrated(settings: Settings, *, held: bool) -> "Database":
    """Migrate the database and open it, unless somebody works in its folder: that may be a service of before claims."""
    from backend.data_folder import held_by_nobody
    from backend.storage import SchemaError, open_database

    with nullcontext(True) if held or settings.database_url else held_by_nobody(settings.data) as free:
        if not free:
            raise SchemaError(
                f"a service or command of another version works on {settings.data}, and this version would migrate its "
                "database: end it first"
            )
        return open_database(
            settings.data, settings.database_url, settings.database_password(), settings.station, outdated="migrate"
        )


def parameters_in_force(settings: Settings, database: "Database") -> "PlantParameters":
    """Return the parameter set with what was applied to it in this folder. Raises ParameterError."""
    from backend.services import load_active_parameters
    from plant import load_parameters

    return load_active_parameters(database, load_parameters(settings.params))


def has_database(settings: Settings) -> bool:
    """Whether there is, or was, something to read: to open it would make a folder that is not there."""
    from backend.storage import FILE_NAME, find_database_traces, is_restore_incomplete

    file = settings.data / FILE_NAME
    was_there = is_restore_incomplete(file) or bool(find_database_traces(file, settings.data / "backups"))
    return settings.database_url is not None or file.exists() or was_there


def _close_interrupted(settings: Settings, database: "Database") -> None:
    """Close the runs of commands and services that were killed; of a database server only a service can tell them."""
    from backend.data_folder import held_by_nobody
    from backend.storage import StorageError, describe_claim, runs

    if settings.database_url is not None:
        return
    with suppress(StorageError):  # of a damaged file as much is done as can be
        with database.reading() as session:
            interrupted = runs.open_ones(session)
        if interrupted and not describe_claim(database.engine):
            with held_by_nobody(settings.data) as free:
                if free:
                    with database.session() as session:
                        runs.close_interrupted(session, _INTERRUPTED)


# Running service -----------------------------------------------------------------------------------
#
# The service that works on a data folder, asked over HTTP by a command: with the operator's token
# of that folder.


_PATIENCE_S = 30.0
_Answer = TypeVar("_Answer", bound=BaseModel)


@dataclass(frozen=True)
class RunningService:
    """``address`` is where it answers; ``token`` is empty where it asks for none."""

    address: str
    token: str

    def ask(self, method: str, path: str, body: Any, answer: type[_Answer]) -> _Answer:
        """Return what a request below ``/api`` is answered with; a refusal ends the command with its words."""
        headers = {"Authorization": f"Bearer {self.token}"} if self.token else {}
        content = None if body is None else json.dumps(body).encode()
        if content is not None:
            headers["Content-Type"] = "application/json"
        where = urlsplit(self.address)
        connection = http.client.HTTPConnection(where.hostname or "", where.port, timeout=_PATIENCE_S)
        try:
            connection.request(method, f"{where.path}/api{path}", content, headers)
            said = connection.getresponse()
            text = said.read()
        except (OSError, http.client.HTTPException) as error:
            fail(f"the service at {self.address} does not answer: {error or type(error).__name__}")
        finally:
            connection.close()
        return self._read(said.status, text, answer)

    def _read(self, status: int, text: bytes, answer: type[_Answer]) -> _Answer:
        """Return what an answer says; one that refuses, or is none of Sinew's, ends the command."""
        from backend.schemas import ErrorResponse

        try:
            if status < http.client.BAD_REQUEST:
                return answer.model_validate_json(text)
            refused = ErrorResponse.model_validate_json(text).error.message
        except ValidationError:
            fail(
                f"what answers at {self.address} is no Sinew: status {status}, {text[:80]!a}; look what works "
                "there, and start `sinew serve` again"
            )
        fail(refused)


def running_service(settings: Settings) -> RunningService:
    """Return the service of a data folder; without one the command ends."""
    from backend.auth import load_tokens
    from backend.data_folder import address_of_service, why_no_address

    address = address_of_service(settings.data)
    if address is None:
        fail(why_no_address(settings.data))
    return RunningService(address, load_tokens(settings.data).operator if settings.require_token else "")
