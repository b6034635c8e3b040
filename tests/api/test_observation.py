"""What the state tells of the newest sample: a reference that is in force is one, all else says that it is measured."""

from math import nan

import pytest

from backend.schemas.state import ReferencesView
from backend.services.state import references_of

SAMPLE = {"q": 0.1, "S": 3.73}


@pytest.mark.parametrize(
    ("sample", "shown"),
    [
        (None, (0.0, None, False)),
        ({"q_ref": nan, "S_ref": nan, "S": nan}, (0.1, None, False)),
        ({"q_ref": 0.2, "S_ref": 10.0}, (0.2, 10.0, True)),
        ({"q_ref": nan, "S_ref": nan}, (0.1, 3.73, False)),
        ({"q_ref": 0.2, "S_ref": nan}, (0.2, 3.73, False)),
    ],
)
def test_what_is_measured_is_not_shown_as_a_reference(
    sample: dict[str, float] | None, shown: tuple[float, float | None, bool]
) -> None:
    q_ref, S_ref, in_force = shown
    told = references_of(None if sample is None else {**SAMPLE, **sample})
    assert told == ReferencesView(q_ref=q_ref, S_ref=S_ref, in_force=in_force)
