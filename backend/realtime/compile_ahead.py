"""``python -m backend.realtime.compile_ahead``: compiles the loop at installation."""

from backend.realtime.gains import make_tuning_command
from backend.realtime.process import warm_up
from backend.tuning import TuningParameters
from plant import load_parameters

PARAMETERS = "lab"


def compile_ahead() -> None:
    """Compile what the loop executes, with geometric gains."""
    parameters = load_parameters(PARAMETERS)
    warm_up(parameters, make_tuning_command(parameters, TuningParameters()))


if __name__ == "__main__":
    compile_ahead()
