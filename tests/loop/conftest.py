import pytest

from backend.loop.set_tuning import SetTuning
from backend.loop.tuned import tuning_for
from backend.tuning.models import Lambdas
from plant.parameters import PlantParameters, load_parameters


@pytest.fixture(scope="session")
def ideal() -> PlantParameters:
    return load_parameters("ideal")


@pytest.fixture(scope="session")
def tuning(ideal: PlantParameters) -> SetTuning:
    return tuning_for(ideal, Lambdas())
