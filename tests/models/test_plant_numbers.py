"""A plant's numbers, read back from what a run keeps of them."""

import json
from dataclasses import replace

import pytest

from backend.banks.builder import BankError, require_same_parameters
from backend.models.document import UnreadableDocumentError
from backend.models.run import PLANT_NUMBERS, StoredPlantNumber
from plant.parameters import SHIPPED, load_parameters


@pytest.mark.parametrize("name", SHIPPED)
def test_they_are_those_of_the_plant(name: str) -> None:
    parameters = load_parameters(name)
    kept = PLANT_NUMBERS.read(json.loads(json.dumps(parameters.to_document())), "run 1")
    assert kept["motor"]["u_max"] == StoredPlantNumber(
        parameters.motor.u_max, "V", parameters.sources.get("motor.u_max", "")
    )
    assert kept["geometry"]["r_j"].value == parameters.geometry.r_j
    assert PLANT_NUMBERS.write(kept) == parameters.to_document()


def test_a_number_without_unit_and_source_is_one() -> None:
    assert PLANT_NUMBERS.read({"motor": {"u_max": {"value": 10.0}}}, "run 1")["motor"]["u_max"].value == 10.0


def test_what_are_no_numbers_is_refused_by_its_place() -> None:
    with pytest.raises(
        UnreadableDocumentError, match=r"^run 3: numbers of its plant cannot be read, field motor\.u_max"
    ):
        PLANT_NUMBERS.read({"motor": {"u_max": 10.0}}, "run 3")


@pytest.mark.parametrize("then", [11.0, None])
def test_one_other_number_makes_another_plant(then: float | None) -> None:
    parameters = load_parameters("lab")
    kept = parameters.to_document()
    if then is None:
        del kept["motor"]["u_max"]
    else:
        kept = replace(parameters, motor=replace(parameters.motor, u_max=then)).to_document()
    with pytest.raises(BankError, match=rf"motor\.u_max was {then}, it is {parameters.motor.u_max} now"):
        require_same_parameters(parameters, "identification 3", kept)
