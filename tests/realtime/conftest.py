import pytest

from backend.realtime.gains import tuning_for
from backend.realtime.program import SetTuning
from backend.tuning.gains import TuningParameters
from plant.parameters import PlantParameters, load_parameters


@pytest.fixture(scope="session")
def ideal() -> PlantParameters:
    return load_parameters("ideal")


@pytest.fixture(scope="session")
def tuning(ideal: PlantParameters) -> SetTuning:
    return tuning_for(ideal, TuningParameters())
