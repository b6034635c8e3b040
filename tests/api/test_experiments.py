"""Experiments through the interface: checks of texts, and metrics equal to those of the command line."""

import json
import subprocess
import sys
from dataclasses import asdict
from pathlib import Path

import httpx
import pytest

from backend.experiments.library import experiments_by_name
from backend.experiments.plans import LoopSettings
from backend.services import messages
from backend.tuning.gains import TuningParameters, designed_point
from plant.parameters import load_parameters
from tests.api.conftest import problem

# The text of an experiment is checked without execution; an invalid value is rejected with its path.

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


def test_the_check_lists_the_parts_without_a_dry_run(viewer: httpx.Client) -> None:
    order = {"text": json.dumps(DOCUMENT), "play": False}
    checked = viewer.post("/api/experiments/check", json=order).raise_for_status().json()
    assert checked["duration_s"] == pytest.approx(2.5)
    assert [(part["start_s"], part["end_s"], part["pieces"]) for part in checked["parts"]] == [
        (0.0, pytest.approx(1.0), 1),
        (pytest.approx(1.0), pytest.approx(2.5), 3),
    ]
    assert [part["q_to"] for part in checked["parts"]] == [0.0, 0.2]
    assert (checked["dry_run"], checked["peak_voltage_V"], checked["min_tension_N"]) == (None, None, None)
    assert checked["not_predicted"] == messages.checked_without_dry_run()


def test_the_check_gives_the_path_of_an_invalid_value(viewer: httpx.Client) -> None:
    text = json.dumps(DOCUMENT).replace("0.2", "3.5")
    refused = problem(viewer.post("/api/experiments/check", json={"text": text, "play": False}))
    assert refused["path"] == ["phases", 0, "parts", 1, "parts", 0, "q_ref"]


# Page and command line give identical metrics for each ready-made experiment with the same seed.

SHORT: dict[str, dict[str, object]] = {
    "tracking": {"q_duration_s": 1.0, "S_duration_s": 1.0},
    "step_battery": {"hold_s": 1.5, "sizes": 1},
}
"""Settings that shorten long experiments; the others keep their defaults."""


def bank_file() -> dict[str, object]:
    """Two entries with the designed model at both stiffnesses."""
    parameters = load_parameters("ideal")
    point = designed_point(parameters, TuningParameters().lam_motor)
    models = {name: getattr(point, name) for name in ("K_q", "T_q", "K_S", "T_S")}
    return {
        "format": "sinew-bank",
        "version": 1,
        "name": "two",
        "entries": [{"S_nominal": S, **models} for S in (8.5, 14.0)],
    }


def by_command(name: str, settings: dict[str, object], folder: Path) -> dict[str, object]:
    words = [word for key, value in settings.items() for word in ("--set", f"{key}={value}")]
    found: dict[str, object] = json.loads(sinew("experiment", name, *words, "--json", folder=folder))
    return found


def sinew(*words: str, folder: Path) -> str:
    command = [sys.executable, "-m", "backend", *words, "--params", "ideal", "--data", str(folder)]
    played = subprocess.run(command, capture_output=True, text=True, timeout=300, check=False)
    assert played.returncode == 0, played.stderr
    return played.stdout


@pytest.mark.parametrize("name", sorted(experiments_by_name()))
def test_page_and_command_line_agree(operator: httpx.Client, tmp_path: Path, name: str) -> None:
    settings = SHORT.get(name, {})
    if name == "sequence":
        settings = {"segments": '[{"duration_s": 1, "q_ref": 0.1, "S_ref": 10}]'}
    ordered = settings
    if name == "bank_comparison":  # it needs a bank of several entries, in both runs
        (tmp_path / "bank.json").write_text(json.dumps(bank_file()))
        bank = operator.post("/api/banks/file", json=bank_file()).raise_for_status().json()["id"]
        sinew("bank", "import", str(tmp_path / "bank.json"), folder=tmp_path)
        settings, ordered = {"bank": 1}, {"bank": bank}
    defaults = asdict(LoopSettings())  # other tests may have activated other tunings
    dry = (
        operator.post("/api/experiments/dry-run", json={"name": name, "settings": {**defaults, **ordered}})
        .raise_for_status()
        .json()
    )
    command = by_command(name, {**defaults, **settings}, tmp_path)
    assert {one["name"]: one["value"] for one in dry["metrics"]} == command["metrics"]
    assert dry["verdict"] == command["verdict"]
    assert command["metrics"]
