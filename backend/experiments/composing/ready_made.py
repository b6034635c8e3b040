"""The experiments that come with Sinew: files of data, with nothing that an own one cannot do."""

from functools import cache
from importlib.resources import files

from backend.documents.experiment import Experiment
from backend.experiments.composing.refused import Lines
from backend.experiments.composing.text import read

NAMES = (
    "tracking",
    "compliance",
    "robustness",
    "step_battery",
    "stiffness_sweep",
    "lambda_sweep",
    "motion_comparison",
    "bank_comparison",
    "disturbance_battery",
    "frequency_response",
    "hold_at_rest",
    "impact",
)
"""In the order in which they are offered."""


@cache
def ready_made(name: str) -> tuple[Experiment, Lines]:
    """Return one with the lines of its file. Raises KeyError."""
    return read(text_of(name))


def text_of(name: str) -> str:
    """Return the text of one, to begin an own one with. Raises KeyError."""
    if name not in NAMES:
        raise KeyError(name)
    return files(__package__).joinpath("ready", f"{name}.yaml").read_text(encoding="utf-8")
