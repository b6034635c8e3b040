"""Commands in the documents exist with their options; commands with results have a JSON output."""

import re
import shlex
from collections.abc import Iterator
from pathlib import Path

import pytest
from typer.core import TyperCommand, TyperGroup
from typer.main import get_command

from backend.cli import app

ROOT = Path(__file__).parents[2]
PAGES = ("command-line.md", "installation.md")
PRINTED = [
    pytest.param(line, id=line)
    for name in PAGES
    for page in (ROOT / "docs").glob(f"**/{name}")
    for line in re.findall(r"^    (?:docker compose exec sinew )?(sinew .*)$", page.read_text("utf-8"), re.MULTILINE)
]

WITHOUT_JSON_OUTPUT = {
    "serve",
    "link",
    "foxglove",
    "bank export",
    "experiments schema",
    "experiments text",
    "runs evaluate",
    "runs export",
    "runs layout",
    "runs bundle",
    "runs report",
    "runs tag",
    "runs rename-tag",
    "runs save-search",
    "db upgrade",
    "db backup",
    "db restore",
    "db name-station",
    "token rotate",
}


def commands(of: object, words: str = "") -> Iterator[tuple[str, TyperCommand]]:
    if isinstance(of, TyperCommand):
        yield words, of
        return
    assert isinstance(of, TyperGroup)
    for name, command in of.commands.items():
        yield from commands(command, f"{words} {name}".strip())


def test_commands_are_found_in_the_documents() -> None:
    assert len(PRINTED) > 25


def test_every_command_with_output_has_a_json_option() -> None:
    found = dict(commands(get_command(app)))
    silent = {words for words, command in found.items() if not any("--json" in p.opts for p in command.params)}
    assert silent == WITHOUT_JSON_OUTPUT


@pytest.mark.parametrize("line", PRINTED)
def test_documented_commands_and_options_exist(line: str) -> None:
    words = shlex.split(line, comments=True)[1:]
    command = get_command(app)
    while isinstance(command, TyperGroup):
        assert words, f"{command.name} needs a subcommand"
        name = words.pop(0)
        assert name in command.commands
        command = command.commands[name]
    context = command.context_class(command, info_name=command.name)
    _, left_over, _ = command.make_parser(context).parse_args(words)
    assert left_over == []
