"""``python -m backend.realtime.compile_ahead``: compiles at the installation what the loop process would wait for."""

from backend.realtime.gains import tuning_for
from backend.realtime.process import warm_up
from backend.tuning.gains import TuningParameters
from plant.parameters import load_parameters

PARAMETERS = "lab"


def compile_ahead() -> None:
    """Go through what the loop compiles, with gains from geometry."""
    parameters = load_parameters(PARAMETERS)
    warm_up(parameters, tuning_for(parameters, TuningParameters()))


if __name__ == "__main__":
    compile_ahead()
