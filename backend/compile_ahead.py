"""``python -m backend.compile_ahead``: compiles and computes at the installation what a first start would wait for.

This is the half of the service. ``python -m backend.realtime.compile_ahead`` is that of the loop; both run in parallel.
"""

from backend import assembly, main
from backend.api import app
from backend.cli import serve
from backend.operating.kept_figures import KeptFigures
from backend.operating.tuning_in_use import by_default
from backend.realtime import heartbeat
from backend.server import server
from plant.parameters import load_parameters

PARAMETERS = "lab"
STARTED = (assembly, app, main, serve, server)
"""What a start imports: it is bytecode from now on."""


def compile_ahead() -> None:
    """Go through what the service and a tuning compile, and keep what they compute."""
    figures = KeptFigures()
    figures.restore()
    by_default(load_parameters(PARAMETERS))
    figures.keep()
    heartbeat.prepare()


if __name__ == "__main__":
    compile_ahead()
