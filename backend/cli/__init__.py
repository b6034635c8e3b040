"""The command line ``sinew``: one module per group of commands.

Commands import what they need when they run, so that ``--help`` appears at once.
"""

import os
import sys
from typing import Annotated

import typer
from pydantic import ValidationError

from backend import __version__
from backend.cli import bank, experiments, identify, report, rig, runs, server, study
from backend.cli.output import (
    ANGLES_VARIABLE,
    angle_unit,
    escape_unprintable_output,
    fail,
    relax_garbage_collection,
    restore_garbage_collection,
)
from backend.errors import InvalidValueError
from backend.workers import exclude_working_directory

app = typer.Typer(
    name="sinew",
    help="Identify, tune and run antagonistic variable stiffness actuators. Inputs and JSON are in SI units; an angle "
    f"may be typed as 60deg. Text output shows angles in degrees, or in radians if {ANGLES_VARIABLE} is rad.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,  # markup would read [rad] as a colour
)


def _print_version(wanted: bool) -> None:
    if wanted:
        print(f"sinew {__version__}")
        raise typer.Exit


@app.callback()
def _group(
    version: Annotated[
        bool, typer.Option("--version", callback=_print_version, is_eager=True, help="Print the version and exit.")
    ] = False,
) -> None:
    """Accept options that belong to no command."""


app.command()(server.serve)
app.command()(server.link)
app.command()(experiments.experiment)
app.add_typer(experiments.experiments_app, name="experiments")
app.add_typer(experiments.queue_app, name="queue")
app.add_typer(identify.app, name="identify")
app.add_typer(bank.app, name="bank")
app.add_typer(runs.app, name="runs")
app.add_typer(study.app, name="study")
app.add_typer(report.app, name="report")
app.add_typer(server.database_app, name="db")
app.add_typer(rig.app, name="rig")
app.command()(server.foxglove)
app.add_typer(server.touch_app, name="touch")
app.add_typer(server.wall_app, name="wall")
app.add_typer(server.token_app, name="token")
app.command()(server.doctor)


def main() -> None:
    """Run the command line.

    An error prints one line, a wiring file one per mistake, and exits non-zero.
    """
    from plant import WiringError, compiler_disabled

    exclude_working_directory()
    escape_unprintable_output()
    if os.environ.get("NUMBA_DISABLE_JIT", "0") not in ("", "0"):
        fail(compiler_disabled())
    relax_garbage_collection()
    try:
        app()
    except KeyboardInterrupt:
        sys.exit(130)
    except ValidationError as error:
        fail("; ".join(_format_validation_error(detail["loc"], detail["msg"]) for detail in error.errors()))
    except Exception as error:
        if not isinstance(error, OSError) and getattr(error, "category", None) is None:
            raise
        if isinstance(error.__cause__, WiringError):
            fail(*error.__cause__.sentences)
        fail(error.format_message(angle_unit()) if isinstance(error, InvalidValueError) else str(error))
    finally:
        restore_garbage_collection()


def _format_validation_error(location: tuple[int | str, ...], message: str) -> str:
    field = ".".join(str(part) for part in location)
    reason = message.removeprefix("Value error, ")
    return f"{field}: {reason}" if field else reason
