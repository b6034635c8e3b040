"""``python -m backend.compile_ahead``: compiles and computes at the installation what a first start would wait for.

This is the half of the service. ``python -m backend.realtime.compile_ahead`` is that of the loop; both run in parallel.
"""

import backend.api.app
import backend.app
import backend.cli.server
import backend.main
import backend.server.server
from backend.realtime import heartbeat
from backend.services.tuning_state import KeptFigures, default_tuning
from plant.parameters import load_parameters

PARAMETERS = "lab"
STARTED = (backend.main, backend.app, backend.api.app, backend.cli.server, backend.server.server)
"""What a start imports: it is bytecode from now on."""


def compile_ahead() -> None:
    """Go through what the service and a tuning compile, and keep what they compute."""
    figures = KeptFigures()
    figures.restore()
    default_tuning(load_parameters(PARAMETERS))
    figures.keep()
    heartbeat.prepare()


if __name__ == "__main__":
    compile_ahead()
