"""What the state tells of the newest sample: a reference that is in force is one, all else says that it is measured."""

from math import nan
from pathlib import Path

import pytest

from backend.faults import FAULTS, Fault
from backend.realtime.modes import MODES, Mode
from backend.sample import NAMES
from backend.schemas.state import ReferencesView
from backend.services.state import Observation, read_references
from backend.storage.database import open_database
from plant.parameters import load_parameters
from tests.api.stepped_service import Parts, stepped

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
    told = read_references(None if sample is None else {**SAMPLE, **sample})
    assert told == ReferencesView(q_ref=q_ref, S_ref=S_ref, in_force=in_force)


def test_all_values_of_a_state_are_of_one_sample(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The loop trips between two reads of the ring: a mode before it never comes with the references after it."""
    rest = dict.fromkeys(NAMES, 0.0) | {"q": 0.1, "S": 3.73}
    running = rest | {"mode": MODES.index(Mode.RUN), "tick": 1.0, "q_ref": 0.2, "S_ref": 10.0}
    tripped = rest | {"mode": MODES.index(Mode.TRIPPED), "tick": 2.0, "q_ref": nan, "S_ref": nan}
    tripped["fault"] = FAULTS.index(Fault.OPERATOR_LOST)
    seen = {"running": (Mode.RUN, None, True, 1), "tripped": (Mode.TRIPPED, "operator_lost", False, 2)}
    samples: list[dict[str, float]] = []
    monkeypatch.setattr(Observation, "sample", lambda _: samples.pop() if samples else tripped)

    async def states(parts: Parts) -> None:
        for reads_before in range(12):
            samples[:] = [running] * reads_before
            state = parts.state()
            fault = state.fault and state.fault.code
            assert (state.mode, fault, state.references.in_force, state.tick) == seen[
                "running" if reads_before else "tripped"
            ]

    database = open_database(tmp_path)
    stepped(database, load_parameters("ideal"), states)
    database.close()
