"""``python -m backend.compile_ahead``: compiles and computes during installation.

The first start of the service then does not wait for it. ``python -m backend.realtime.compile_ahead`` does the same for
the control loop; both run in parallel.
"""

from backend import app, main
from backend.api import create_app
from backend.cli import server
from backend.realtime import heartbeat
from backend.server import prepare_routes
from backend.services import RobustnessCache, default_tuning
from plant import load_parameters

PARAMETER_FILE = "lab"
IMPORTED_AT_START = (main, app, create_app, server, prepare_routes)
"""Modules that a start imports; importing them here writes their bytecode."""


def compile_ahead() -> None:
    """Compile what service and tuning use, and cache the numbers they compute."""
    figures = RobustnessCache()
    figures.load()
    default_tuning(load_parameters(PARAMETER_FILE))
    figures.save()
    heartbeat.compile_heartbeat()


if __name__ == "__main__":
    compile_ahead()
