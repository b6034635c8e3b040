"""``python -m tests.soak [PART ...]``: long runs and attacks. Returns 1 if a check failed."""

import argparse
import sys
import traceback

from rich.console import Console

from tests.soak import (
    eight_panels,
    killed_experiments,
    long_exports,
    page_heap,
    random_commands,
    random_moves,
    random_programs,
    truth,
    viewers,
)
from tests.soak.attack import parts as attack

ATTACK = "attack"


def main() -> int:
    parser = argparse.ArgumentParser(prog="python -m tests.soak", description=__doc__)
    parser.add_argument("--minutes", type=float, default=10.0, help="length of each watched stretch (10)")
    parser.add_argument("--hours", type=float, default=long_exports.HOURS, help="length of what is exported (8)")
    parser.add_argument("--viewers", type=int, default=20, help="how many watch it (20)")
    parser.add_argument("--seed", type=int, help="of what is drawn by chance (drawn afresh)")
    parser.add_argument("--deeds", type=int, default=truth.DEEDS, help=f"of the robot at the page ({truth.DEEDS})")
    attack.add_options(parser)
    console = Console(width=None if sys.stdout.isatty() else 160, markup=False)
    watched = {
        "page-heap": lambda given, console: page_heap.streaming_page(given.minutes, console),
        "eight-panels": lambda given, console: eight_panels.eight_panels(given.minutes, console),
        "viewers": lambda given, console: viewers.watched_simulation(given.minutes, given.viewers, console),
        "killed-experiments": lambda _given, console: killed_experiments.killed_experiments(console),
        "programs": lambda _given, console: random_programs.random_programs(console),
        "moves": lambda _given, console: random_moves.moves_without_contact(console),
        "commands": lambda given, console: random_commands.random_commands(console, given.seed),
        "truth": lambda given, console: truth.truthful_page(given.seed, given.deeds, console),
        "exports": lambda given, console: long_exports.long_exports(given.hours, console),
    }
    known = [ATTACK, *attack.NAMES, *watched]
    parser.add_argument("parts", nargs="*", metavar="PART", help=f"{', '.join(known)}; all if left out")
    given = parser.parse_args()
    unknown = set(given.parts) - set(known)
    if unknown:
        parser.error(f"unknown part {', '.join(sorted(unknown))}; known are {', '.join(known)}")
    chosen = [
        name for part in given.parts or (ATTACK, *watched) for name in (attack.NAMES if part == ATTACK else [part])
    ]
    parts = {**attack.parts(chosen), **watched}
    whole = [_has_passed(name, parts[name], given, console) for name in dict.fromkeys(chosen)]
    return 0 if all(whole) else 1


def _has_passed(name: str, part: attack.Part, given: argparse.Namespace, console: Console) -> bool:
    """Return whether a part passed. A part that raises has failed; the other parts run all the same."""
    try:
        return part(given, console)
    except Exception as error:
        console.print(f"LOST: {name} could not go on: {error!r}")
        console.print(traceback.format_exc(limit=-4))
        return False


if __name__ == "__main__":
    sys.exit(main())
