"""The declarations that forms are made from: what is left at its default, and where a field ends, is the service's too.

What the forms of the page show, send and leave behind is looked at in the browser: ``tests/e2e/test_forms.py``.
"""

import pytest

from backend.experiments.library import IDENTIFICATIONS
from backend.models.settings import describe_settings
from backend.schemas.identification import ActuatorRequest, MotorRequest, SpringRequest


@pytest.mark.parametrize(
    ("name", "request_type"), [("actuator", ActuatorRequest), ("motor", MotorRequest), ("spring", SpringRequest)]
)
def test_the_boxes_of_an_identification_are_those_of_its_order(
    name: str, request_type: type[ActuatorRequest | MotorRequest | SpringRequest]
) -> None:
    """What the page leaves at its default is the default of the service too, and no box is missing on either side."""
    boxes = {box.name: box.default for box in describe_settings(IDENTIFICATIONS[name].plan)}
    assert request_type.model_validate({"kind": name}).model_dump(exclude={"kind", "tensions_N"}) == boxes
