"""``python -m backend.loop.compile_ahead``: compiles at the installation what the loop process would wait for."""

from backend.loop.rehearsal import rehearse
from backend.loop.tuned import tuning_for
from backend.tuning.models import Lambdas
from plant.parameters import load_parameters

PARAMETERS = "lab"


def compile_ahead() -> None:
    """Go through what the loop compiles, with gains from geometry."""
    parameters = load_parameters(PARAMETERS)
    rehearse(parameters, tuning_for(parameters, Lambdas()))


if __name__ == "__main__":
    compile_ahead()
