import pytest

from backend.realtime.gains import make_tuning_command
from backend.realtime.program import SetTuning
from backend.tuning.gains import TuningParameters
from plant.parameters import PlantParameters, load_parameters


@pytest.fixture(scope="session")
def ideal() -> PlantParameters:
    return load_parameters("ideal")


@pytest.fixture(scope="session")
def tuning(ideal: PlantParameters) -> SetTuning:
    return make_tuning_command(ideal, TuningParameters())
