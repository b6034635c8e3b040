"""The command line: each command reads its words, calls one function, prints what came of it.

The parts are imported by the commands that use them, so that help is there at once.
"""

import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer
from pydantic import ValidationError
from rich.console import Console

from backend.settings import Settings

if TYPE_CHECKING:
    from backend.api.tokens import Tokens

app = typer.Typer(
    name="sinew",
    help="Identify, tune and run antagonistic variable stiffness actuators. SI units throughout.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
)
errors = Console(stderr=True)

DataFolder = Annotated[Path | None, typer.Option("--data", help="Folder with the database and the tokens. [./data]")]


@app.callback()
def _sinew() -> None:
    """Keep ``serve`` a word of its own even while it is the only command."""


@app.command()
def serve(
    plant: Annotated[Literal["simulator", "rig"] | None, typer.Option(help="What to control. [simulator]")] = None,
    params: Annotated[str | None, typer.Option(help="Parameter set: lab, ideal or a TOML file. [lab]")] = None,
    host: Annotated[str | None, typer.Option(help="Address to listen on. [127.0.0.1]")] = None,
    port: Annotated[int | None, typer.Option(help="Port to listen on, 0 for any free one. [8000]")] = None,
    data: DataFolder = None,
) -> None:
    """Run the dashboard and the control loop until interrupted."""
    from backend.main import serve as run_service

    run_service(_settings(plant=plant, params=params, host=host, port=port, data=data), _print_link)


def _settings(**chosen: object) -> Settings:
    """Return the settings: what the command line leaves out comes from the environment or is the default."""
    return Settings.model_validate({**Settings().model_dump(), **{k: v for k, v in chosen.items() if v is not None}})


def _print_link(address: str, tokens: "Tokens | None") -> None:
    if tokens is None:
        print(f"Sinew answers at {address} without sign-in", flush=True)
        return
    print(f"Sinew answers. Sign in: {address}/?token={tokens.operator}", flush=True)
    print(f"To watch only:          {address}/?token={tokens.viewer}", flush=True)


def main() -> None:
    """Run the command line; what goes wrong is one line and a non-zero exit."""
    try:
        app()
    except KeyboardInterrupt:
        sys.exit(130)
    except ValidationError as error:
        _fail("; ".join(_sentence(detail["loc"], detail["msg"]) for detail in error.errors()))
    except Exception as error:
        if not isinstance(error, _expected()):
            raise
        _fail(str(error))


def _expected() -> tuple[type[Exception], ...]:
    """Return what may go wrong without being a mistake of the program; anything else shows where it happened."""
    from backend.loop.access import LoopDiedError
    from backend.main import AlreadyRunningError, CannotListenError
    from backend.recording.recorder import RecordingError
    from backend.refusal import OutOfRangeError
    from backend.storage import StorageError
    from backend.storage.migrate import SchemaError
    from plant.parameters import ParameterError

    return (
        AlreadyRunningError,
        CannotListenError,
        LoopDiedError,
        OutOfRangeError,
        ParameterError,
        RecordingError,
        SchemaError,
        StorageError,
    )


def _sentence(place: tuple[int | str, ...], message: str) -> str:
    named = ".".join(str(part) for part in place)
    said = message.removeprefix("Value error, ")
    return f"{named}: {said}" if named else said


def _fail(message: str) -> None:
    errors.print(f"sinew: {message}", style="red", highlight=False, soft_wrap=True, markup=False)
    sys.exit(1)
