"""A plant from an installed package: found by its name, driven, and its errors reported."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

from backend.cli import messages
from plant.factory import ATTRIBUTES, GROUP, METHODS, make_plant, require_available
from plant.interface import NAME_MAX, PlantChoice, PlantError, PlantKind
from plant.parameters import PlantParameters
from tests.plant import example
from tests.refusals import refused

SHORT = ["--set", "q_duration_s=0.5", "--set", "S_duration_s=0.5"]


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return example.installed_in(tmp_path_factory.mktemp("example"))


def sinew(site: Path, *words: str) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "backend", *words]
    return subprocess.run(
        command, capture_output=True, text=True, check=False, env=os.environ | {"PYTHONPATH": str(site)}
    )


def test_a_plant_from_a_package_is_checked_driven_and_reported(site: Path, tmp_path: Path) -> None:
    checked = sinew(site, "rig", "conformance", "--plant", example.NAME, "--json")
    assert checked.returncode == 0, checked.stderr
    document = json.loads(checked.stdout)
    assert document["plant"] == example.NAME
    assert {finding["outcome"] for finding in document["findings"]} == {"holds"}

    data, out = ["--data", str(tmp_path / "data")], tmp_path / "out"
    order = ["experiment", "tracking", "--plant", example.NAME, "--params", "ideal", "--out", str(out), *SHORT]
    ran = sinew(site, *order, *data)
    assert ran.returncode == 0, ran.stderr
    assert "| two-springs, parameters" in " | ".join((out / "report.html").read_text("utf-8").split(">"))
    metrics = json.loads((out / "metrics.json").read_text("utf-8"))
    assert (metrics["plant"], metrics["end_state"]) == (example.NAME, "completed")

    file = tmp_path / "run.parquet"
    assert sinew(site, "runs", "export", "1", str(file), *data).returncode == 0
    played = sinew(site, "rig", "conformance", "--plant", "replay", "--recording", str(file))
    assert played.returncode == 0, played.stderr
    assert "not tried" in played.stdout
    assert messages.requirements_met(plant="replay") in played.stderr


def package(folder: Path, name: str, entry: str, code: str, plant: str = "odd") -> None:
    """Write the files of an installed package with one module and one entry point."""
    (folder / f"{name.replace('-', '_')}.py").write_text(code)
    metadata = folder / f"{name.replace('-', '_')}-1.0.dist-info"
    metadata.mkdir()
    (metadata / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {name}\nVersion: 1.0\n")
    (metadata / "entry_points.txt").write_text(f"[{GROUP}]\n{plant} = {entry}\n")


@pytest.mark.parametrize(
    ("source", "code", "values"),
    [
        (
            "import no_such_driver",
            "plant_not_imported",
            {"reason": "ModuleNotFoundError: No module named 'no_such_driver'"},
        ),
        ("", "plant_not_imported", {"reason": "AttributeError: module 'odd_plant' has no attribute 'make'"}),
        ("make = 3", "maker_not_callable", {"maker": "odd_plant:make", "kind": "an int"}),
        (
            "def make(parameters): ...",
            "plant_not_created",
            {"reason": "TypeError: make() takes 1 positional argument but 2 were given"},
        ),
        (
            "def make(parameters, seed): raise OSError('no card\\nin slot 2')",
            "plant_not_created",
            {"reason": "OSError: no card in slot 2"},
        ),
        (
            "def make(parameters, seed): ...",
            "created_object_is_not_a_plant",
            {"kind": "None", "missing": ", ".join([*ATTRIBUTES, *(f"{name}()" for name in METHODS)])},
        ),
        (
            "def make(parameters, seed): return 3",
            "created_object_is_not_a_plant",
            {"maker": "odd_plant:make", "kind": "an int"},
        ),
    ],
)
def test_a_package_without_a_plant_is_reported_in_one_line(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    lab: PlantParameters,
    source: str,
    code: str,
    values: dict[str, object],
) -> None:
    assert {"open", "read"} <= set(METHODS)
    package(tmp_path, "odd-plant", "odd_plant:make", source)
    monkeypatch.syspath_prepend(str(tmp_path))
    monkeypatch.delitem(sys.modules, "odd_plant", raising=False)
    with pytest.raises(PlantError) as error:
        make_plant(PlantChoice(PlantKind.PACKAGE, package="odd"), lab, 0)
    message = error.value.message
    assert message.code == code
    assert message.values.items() >= ({"plant": "odd", "package": "odd-plant"} | values).items()
    assert len(message.splitlines()) == 1


def test_an_error_of_a_package_is_reported_unchanged(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, lab: PlantParameters
) -> None:
    code = "from plant.interface import PlantError\ndef make(parameters, seed): raise PlantError('plug it in')"
    package(tmp_path, "plugged", "plugged:make", code, plant="far")
    monkeypatch.syspath_prepend(str(tmp_path))
    with pytest.raises(PlantError, match=r"^plug it in$"):
        make_plant(PlantChoice(PlantKind.PACKAGE, package="far"), lab, 0)


def test_the_name_of_a_plant_must_exist(site: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(str(site))
    for name in ("toaster", "virtual_card", ""):
        with refused(PlantError, "unknown_plant", plant=name, installed=["two-springs"]):
            require_available(PlantChoice(PlantKind.PACKAGE, package=name))
    package(tmp_path, "other", "other:make", "", plant=example.NAME)
    monkeypatch.syspath_prepend(str(tmp_path))
    with refused(PlantError, "plant_not_unique", plant="two-springs", packages=["other", "sinew-two-springs"]):
        require_available(PlantChoice(PlantKind.PACKAGE, package=example.NAME))


@pytest.mark.parametrize("length", [NAME_MAX, NAME_MAX + 1])
def test_a_name_too_long_to_store_is_rejected_at_the_start(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, length: int
) -> None:
    name = "x" * length
    package(tmp_path, "long", "plant.simulator:Simulator", "", plant=name)
    monkeypatch.syspath_prepend(str(tmp_path))
    choice = PlantChoice(PlantKind.PACKAGE, package=name)
    if length <= NAME_MAX:
        require_available(choice)
    else:
        with refused(PlantError, "plant_name_too_long", plant=name, maximum=100):
            require_available(choice)


def test_a_plant_from_a_package_cannot_use_the_name_of_another_kind(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    package(tmp_path, "other", "other:make", "", plant="virtual_card")
    monkeypatch.syspath_prepend(str(tmp_path))
    with refused(PlantError, "unknown_plant", plant="virtual_card"):
        require_available(PlantChoice(PlantKind.PACKAGE, package="virtual_card"))


def test_a_plant_that_violates_the_contract_fails_the_check_with_one_line(tmp_path: Path) -> None:
    code = (
        "from plant.simulator import Simulator\n"
        "class Mute(Simulator):\n    description = ''\n"
        "def make(parameters, seed): return Mute(parameters, seed)\n"
    )
    package(tmp_path, "mute", "mute:make", code, plant="mute")
    checked = sinew(tmp_path, "rig", "conformance", "--plant", "mute")
    assert checked.returncode == 1
    assert "broken     Once it is open, its description names" in checked.stdout
    assert checked.stderr.strip() == f"sinew: {messages.requirements_not_met(plant='mute', broken=1, checked=16)}"
