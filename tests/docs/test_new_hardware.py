"""docs/how-to/new-hardware.md names existing parts of a Plant, columns, modules, commands and example code."""

import importlib
import re
import tomllib
from pathlib import Path
from typing import Any

from typer.testing import CliRunner

from backend.cli import app
from plant import interface, replay
from plant.conformance import CHECKS
from plant.factory import ATTRIBUTES, GROUP, METHODS
from plant.parameters import PlantParameters, load_parameters
from plant.simulator import Simulator
from tests.plant import example

ROOT = Path(__file__).parents[2]
TEXT = (ROOT / "docs" / "how-to" / "new-hardware.md").read_text(encoding="utf-8")
BLOCKS = re.findall(r"^```(\w*)\n(.*?)^```$", TEXT, re.MULTILINE | re.DOTALL)
PROSE = re.sub(r"^```.*?^```$", "", TEXT, flags=re.MULTILINE | re.DOTALL)


def blocks(language: str) -> list[str]:
    return [code for name, code in BLOCKS if name == language]


def test_the_table_lists_every_part_of_a_plant() -> None:
    rows = re.findall(r"^\| (`.*?) \|", TEXT, re.MULTILINE)
    listed = [name for row in rows for name in re.findall(r"`(\w+)`", row)]
    assert len(listed) == len(set(listed))
    assert {*ATTRIBUTES, *METHODS} <= set(listed) <= {*ATTRIBUTES, *METHODS, *vars(replay.Replay)}


def test_code_names_on_the_page_exist() -> None:
    known = {*vars(interface), *vars(replay), *vars(replay), *vars(replay.Replay), *ATTRIBUTES, *METHODS}
    known |= {*replay.UNITS, *replay.FURTHER}
    for name in re.findall(r"`([A-Za-z_]\w*)`", PROSE):
        assert name in known, name
    for file in re.findall(r"`((?:\w+/)+[\w.]+)`", PROSE):
        assert (ROOT / file).exists(), file
    assert f"`{GROUP}`" in PROSE
    assert set(replay.UNITS) <= set(re.findall(r"`(\w+)`", PROSE))


def test_code_on_the_page_equals_the_example_package_or_runs() -> None:
    (entry,) = blocks("toml")
    assert tomllib.loads(entry)["project"]["entry-points"][GROUP][example.NAME]
    assert entry in (example.SOURCE / "pyproject.toml").read_text(encoding="utf-8")
    made, used = blocks("python")
    assert made in (example.SOURCE / "sinew_two_springs.py").read_text(encoding="utf-8")

    def make(parameters: PlantParameters, seed: int) -> Simulator:
        return Simulator(parameters, seed)

    names: dict[str, Any] = {"make": make, "parameters": load_parameters("ideal")}
    exec(used, names)  # the code itself asserts that all checks pass
    assert len(names["findings"]) == len(CHECKS)


def test_commands_on_the_page_accept_their_options() -> None:
    commands = [line for code in blocks("") for line in code.splitlines()]
    commands += re.findall(r"`(sinew [^`]+)`", PROSE)
    assert len(commands) >= 5
    for command in commands:
        words = [word for word in command.split()[1:] if not word.startswith("--")]
        group = words[: 2 if words[0] in ("rig", "runs") else 1]
        helped = CliRunner().invoke(app, [*group, "--help"], env={"COLUMNS": "200", "TERM": "dumb"})
        assert helped.exit_code == 0, command
        for option in re.findall(r"--[\w-]+", command):
            assert option in helped.output, command


def test_modules_imported_on_the_page_exist() -> None:
    for module in re.findall(r"^from (\S+) import", "\n".join(blocks("python")), re.MULTILINE):
        assert importlib.import_module(module)
