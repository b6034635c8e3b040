"""What the README says of the commands holds for each of them."""

from collections.abc import Iterator

from typer.core import TyperCommand, TyperGroup
from typer.main import get_command

from backend.cli import app

DO_AND_SAY_SO = {
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


def test_every_command_that_shows_something_shows_it_to_programs_too() -> None:
    found = dict(commands(get_command(app)))
    silent = {words for words, command in found.items() if not any("--json" in p.opts for p in command.params)}
    assert silent == DO_AND_SAY_SO
