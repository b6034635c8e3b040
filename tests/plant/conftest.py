import pytest

from plant.parameters import PlantParameters, load_parameters


@pytest.fixture(scope="session")
def ideal() -> PlantParameters:
    return load_parameters("ideal")


@pytest.fixture(scope="session")
def lab() -> PlantParameters:
    return load_parameters("lab")
