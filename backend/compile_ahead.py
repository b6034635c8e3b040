"""``python -m backend.compile_ahead``: compiles and computes at the installation what a first start would wait for.

This is the half of the service. ``python -m backend.realtime.compile_ahead`` is that of the loop; both run in parallel.
"""

from backend import app, main
from backend.api import create_app
from backend.cli import server
from backend.realtime import heartbeat
from backend.server import prepare_routes
from backend.services import RobustnessCache, default_tuning
from plant import load_parameters

PARAMETERS = "lab"
STARTED = (main, app, create_app, server, prepare_routes)
"""What a start imports: it is bytecode from now on."""


def compile_ahead() -> None:
    """Go through what the service and a tuning compile, and keep what they compute."""
    figures = RobustnessCache()
    figures.load()
    default_tuning(load_parameters(PARAMETERS))
    figures.save()
    heartbeat.compile_heartbeat()


if __name__ == "__main__":
    compile_ahead()
