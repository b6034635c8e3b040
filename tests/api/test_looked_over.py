"""An experiment as text is looked over in no time, without being played; what cannot be run is refused at its place."""

import json

import httpx
import pytest

from tests.api.conftest import problem

DOCUMENT = {
    "format": 1,
    "name": "nudge",
    "title": "Nudge",
    "phases": [
        {
            "name": "only",
            "title": "Only",
            "parts": [
                {"do": "step", "q_ref": 0.0, "S_ref": 10.0, "duration_s": 1.0},
                {"do": "repeat", "times": 3, "parts": [{"do": "ramp", "q_ref": 0.2, "duration_s": 0.5}]},
            ],
        }
    ],
}


def test_it_is_told_part_by_part_and_not_played(viewer: httpx.Client) -> None:
    order = {"text": json.dumps(DOCUMENT), "play": False}
    told = viewer.post("/api/experiments/check", json=order).raise_for_status().json()
    assert told["duration_s"] == pytest.approx(2.5)
    assert [(part["start_s"], part["end_s"], part["pieces"]) for part in told["parts"]] == [
        (0.0, pytest.approx(1.0), 1),
        (pytest.approx(1.0), pytest.approx(2.5), 3),
    ]
    assert [part["q_to"] for part in told["parts"]] == [0.0, 0.2]
    assert (told["dry_run"], told["peak_voltage_V"], told["min_tension_N"]) == (None, None, None)
    assert told["not_predicted"] == "it was looked over only"


def test_what_cannot_be_run_is_refused_at_its_place(viewer: httpx.Client) -> None:
    text = json.dumps(DOCUMENT).replace("0.2", "3.5")
    refused = problem(viewer.post("/api/experiments/check", json={"text": text, "play": False}))
    assert refused["path"] == ["phases", 0, "parts", 1, "parts", 0, "q_ref"]
