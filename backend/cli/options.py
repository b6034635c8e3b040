"""Options that commands share, and access to data folder, database and service."""

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

from backend.cli import messages
from backend.cli.output import error_console, fail
from backend.settings import Settings, load_environment_settings

if TYPE_CHECKING:
    from backend.storage import Database
    from plant import PlantParameters


# Options -------------------------------------------------------------------------------------------


DataFolder = Annotated[
    Path | None,
    typer.Option("--data", readable=False, help="Folder with the database and the tokens. [./data]"),
]
StationName = Annotated[
    str | None,
    typer.Option("--station", help="Name of the rig, if several rigs share one database; also SINEW_STATION."),
]
ParameterSet = Annotated[
    str | None,
    typer.Option(
        "--params",
        help="Parameter set: lab, lab-stick, ideal, for experiments also qbmove, bavs, awas2, maccepa; or a TOML "
        "file. [lab]",
    ),
]

PlantName = Annotated[
    str | None,
    typer.Option("--plant", help="Plant: simulator, rig, replay, or a plant of an installed package. [simulator]"),
]
VirtualCard = Annotated[
    bool | None,
    typer.Option("--virtual-card/--real-card", help="With --plant rig: a simulated card instead of a real one."),
]
WiringFile = Annotated[
    str | None, typer.Option("--wiring", help="With --plant rig: pcie-6323 or a TOML file. [pcie-6323]")
]
CardAddress = Annotated[
    str | None, typer.Option("--card-address", help="With --plant rig: HOST:PORT of NI's gRPC device server.")
]
Recording = Annotated[
    Path | None, typer.Option("--recording", help="With --plant replay: file of the recording to play back.")
]


# Database ------------------------------------------------------------------------------------------


CACHE_FALLBACK = "SINEW_CACHE_FALLBACK"
"""Environment variable with the folder for compiled code if no cache folder is writable."""


def load_settings(**options: object) -> Settings:
    """Return the settings from options, environment and defaults, in this order.

    An option that is None counts as not given.
    """
    environment = load_environment_settings().model_dump()
    given = {name: value for name, value in options.items() if value is not None}
    settings = Settings.model_validate({**environment, **given})
    os.environ[CACHE_FALLBACK] = str(settings.data.absolute())  # of plant.compilation, which takes long to import
    return settings


@contextmanager
def open_configured_database(
    settings: Settings, *, read_only: bool = False, owns_folder: bool = False
) -> "Iterator[Database]":
    """Open the database of the settings for the block.

    A writer migrates a database of an earlier schema, unless a service uses it. A reader never migrates: it reads the
    database as it is, if possible. ``owns_folder`` says that the caller holds the lock of the data folder. Raises
    SchemaError.
    """
    from backend.storage import OutdatedError, is_outdated, open_database

    _complete_restore(settings, owns_folder=owns_folder)
    location = settings.data, settings.database_url, settings.database_password(), settings.station
    try:
        database = open_database(*location, outdated="read" if read_only else "refuse")
    except OutdatedError:
        if read_only:
            raise
        database = _open_migrated(settings, owns_folder=owns_folder)
    try:
        if not (read_only and is_outdated(database.engine)):
            _close_interrupted_runs(settings, database)
        yield database
    finally:
        database.close()


def has_database(settings: Settings) -> bool:
    """Whether there is or was a database to read.

    Opening one would create a missing folder.
    """
    from backend.storage import FILE_NAME, find_database_traces, is_restore_incomplete

    file = settings.data / FILE_NAME
    has_traces = is_restore_incomplete(file) or bool(find_database_traces(file, settings.data / "backups"))
    return settings.database_url is not None or file.exists() or has_traces


def load_plant_parameters(settings: Settings, database: "Database") -> "PlantParameters":
    """Return the parameter set with applied identified values. Raises ParameterError."""
    from backend.services import load_active_parameters
    from plant import load_parameters

    return load_active_parameters(database, load_parameters(settings.params))


def _complete_restore(settings: Settings, *, owns_folder: bool) -> None:
    """Complete or revert a restore that was killed, and print what was done.

    Nothing is done if another process uses the folder.
    """
    from backend.data_folder import lock_if_unused
    from backend.storage import find_database_file, is_restore_incomplete, recover_database

    file = find_database_file(settings.data, settings.database_url)
    if file is None or not is_restore_incomplete(file):
        return
    with nullcontext(True) if owns_folder else lock_if_unused(settings.data) as is_free:
        for sentence in recover_database(file) if is_free else []:
            error_console.print(sentence, highlight=False, markup=False, soft_wrap=True)


def _open_migrated(settings: Settings, *, owns_folder: bool) -> "Database":
    """Migrate the database and open it, unless another process uses its folder.

    The lock of the folder is checked too, because services of old versions did not claim the database.
    """
    from backend.data_folder import lock_if_unused
    from backend.storage import SchemaError, open_database

    with nullcontext(True) if owns_folder or settings.database_url else lock_if_unused(settings.data) as is_free:
        if not is_free:
            raise SchemaError(messages.folder_used_by_another_version(folder=str(settings.data)))
        return open_database(
            settings.data, settings.database_url, settings.database_password(), settings.station, outdated="migrate"
        )


def _close_interrupted_runs(settings: Settings, database: "Database") -> None:
    """Close the runs of killed commands and services.

    On a database server only a service can recognize them.
    """
    from backend.data_folder import lock_if_unused
    from backend.storage import StorageError, describe_claim, runs

    if settings.database_url is not None:
        return
    with suppress(StorageError):  # a damaged file: the command itself reports it
        with database.reading() as session:
            interrupted = runs.open_ones(session)
        if interrupted and not describe_claim(database.engine):
            with lock_if_unused(settings.data) as is_free:
                if is_free:
                    with database.session() as session:
                        runs.close_interrupted(session, messages.run_interrupted())


# Running service -----------------------------------------------------------------------------------


_TIMEOUT_S = 30.0
_Response = TypeVar("_Response", bound=BaseModel)


@dataclass(frozen=True)
class RunningService:
    """HTTP client of the service that uses a data folder.

    ``token`` is the operator's token of that folder, empty if the service requires none.
    """

    address: str
    token: str

    def request(self, method: str, path: str, body: Any, response_type: type[_Response]) -> _Response:
        """Send a request below ``/api`` and return its response.

        An error response ends the command.
        """
        headers = {"Authorization": f"Bearer {self.token}"} if self.token else {}
        content = None if body is None else json.dumps(body).encode()
        if content is not None:
            headers["Content-Type"] = "application/json"
        url = urlsplit(self.address)
        connection = http.client.HTTPConnection(url.hostname or "", url.port, timeout=_TIMEOUT_S)
        try:
            connection.request(method, f"{url.path}/api{path}", content, headers)
            response = connection.getresponse()
            text = response.read()
        except (OSError, http.client.HTTPException) as error:
            fail(messages.service_does_not_respond(address=self.address, reason=f"{error or type(error).__name__}"))
        finally:
            connection.close()
        return self._parse_response(response.status, text, response_type)

    def _parse_response(self, status: int, text: bytes, response_type: type[_Response]) -> _Response:
        """Return the parsed response.

        An error, or a response that is not Sinew's, ends the command.
        """
        from backend.schemas import ErrorResponse

        try:
            if status < http.client.BAD_REQUEST:
                return response_type.model_validate_json(text)
            message = ErrorResponse.model_validate_json(text).error.message
        except ValidationError:
            fail(messages.other_program_responds(address=self.address, status=status, response=text))
        fail(message)


def find_running_service(settings: Settings) -> RunningService:
    """Return the service that uses the data folder; without one the command ends."""
    from backend.auth import load_tokens
    from backend.data_folder import describe_missing_address, read_service_address

    address = read_service_address(settings.data)
    if address is None:
        fail(describe_missing_address(settings.data))
    return RunningService(address, load_tokens(settings.data).operator if settings.require_token else "")
