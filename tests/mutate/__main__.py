"""``python -m tests.mutate``: change one place of the code at a time, and list the changes that no test detects.

The places are spread evenly over the code, from an offset that the seed determines. Each change is made in a copy of
the project. There all tests that reach the file run except browser tests, the nearest and fastest first, until one
fails. A change that causes an endless loop counts as detected. `explained.toml` gives the reason why no test can detect
a change; such changes are not counted.
"""

import argparse
import os
import random
import sys
import time
import tomllib
from concurrent.futures import ThreadPoolExecutor
from functools import cache
from pathlib import Path
from queue import SimpleQueue

from rich.console import Console
from rich.table import Table

from tests.mutate.belonging import sources
from tests.mutate.mutants import Mutant, mutants
from tests.mutate.trees import ROOT, Tree, tracked
from tests.mutate.trial import EVERY, HUNG, SURVIVED, Memory, Trials, digest

FOLDER = ROOT / ".cache" / "mutate"
EXPLAINED = Path(__file__).with_name("explained.toml")
AT_LEAST = 0.95


@cache
def all_there() -> list[Mutant]:
    """Return every possible mutant."""
    return [mutant for path in sources() for mutant in mutants(path, (ROOT / path).read_text(encoding="utf-8"))]


def chosen(count: int, seed: int) -> list[Mutant]:
    """Return ``count`` mutants, spread as evenly as whole numbers allow."""
    there = all_there()
    step = len(there) / count
    start = random.Random(seed).random() * step
    return [there[int(start + index * step)] for index in range(count)]


def explained() -> dict[tuple[str, str, str], str]:
    """Return why no test can detect certain changes, by file, line before and line after."""
    listed = tomllib.loads(EXPLAINED.read_text(encoding="utf-8")).get("equivalent", [])
    return {(entry["file"], entry["before"], entry["after"]): entry["because"] for entry in listed}


def verdicts(wanted: list[Mutant], given: argparse.Namespace) -> dict[Mutant, str]:
    """Return the result of each mutant that was tried within the time limit."""
    until = time.monotonic() + 60.0 * given.minutes
    FOLDER.mkdir(parents=True, exist_ok=True)
    memory, files = Memory(FOLDER / "memory.json"), tracked()
    trees: SimpleQueue[Tree] = SimpleQueue()
    for name in ("base", *map(str, range(given.jobs))):
        tree = Tree(FOLDER / name)
        tree.bring_up_to_date(files)
        trees.put(tree)
    state = digest(
        name for name in files if name.startswith(("plant/", "backend/")) and name.endswith((".py", ".toml"))
    )
    trials = Trials(trees.get(), memory, state, given.limit, given.steps)
    found: dict[Mutant, str] = {}

    def trial(mutant: Mutant) -> None:
        key = f"{mutant.path}:{mutant.line} {mutant.at} {mutant.old} -> {mutant.new} on {state}"
        known = memory.get(key) if given.go_on else None
        if known is None:
            if time.monotonic() > until:
                return
            tree = trees.get()
            try:
                known = trials.verdict(mutant, tree)
            finally:
                trees.put(tree)
            if known != SURVIVED:
                memory.put(key, known)
            print(f"{mutant.path}:{mutant.line}  {mutant.before}  ->  {mutant.after}\n    {known}", flush=True)
        found[mutant] = str(known)

    with ThreadPoolExecutor(given.jobs) as pool:
        list(pool.map(trial, wanted))
    return found


def main() -> int:
    parser = argparse.ArgumentParser(prog="python -m tests.mutate", description=__doc__)
    parser.add_argument("--count", type=int, default=100, help="mutants")
    parser.add_argument("--seed", type=int, default=1, help="decides which")
    parser.add_argument("--jobs", type=int, default=os.cpu_count() or 1, help="mutants at a time")
    parser.add_argument("--limit", type=float, default=900.0, help="seconds of processor time, more is a hang")
    parser.add_argument(
        "--steps",
        type=int,
        default=EVERY,
        help="leave out tests further from a file, counted in imports, and live ones but its own: what survives is "
        "still to be tried, without --steps and with --go-on",
    )
    parser.add_argument("--minutes", type=float, default=float("inf"), help="begin no mutant after so many")
    parser.add_argument(
        "--go-on", action="store_true", help="leave out mutants of the same sources that were killed before"
    )
    given = parser.parse_args()
    wanted = chosen(given.count, given.seed)
    found = verdicts(wanted, given)
    reasons, console = explained(), Console(width=None if sys.stdout.isatty() else 160, markup=False)
    survivors = [mutant for mutant in wanted if found.get(mutant) == SURVIVED]
    table = Table("place", "before", "after", "why no test can notice it", title="survivors", show_lines=True)
    for mutant in survivors:
        why = reasons.get((mutant.path, mutant.before, mutant.after), "not explained")
        table.add_row(f"{mutant.path}:{mutant.line}", mutant.before, mutant.after, why)
    console.print(table)
    there = {(mutant.path, mutant.before, mutant.after) for mutant in all_there()}
    for path, before, after in sorted(set(reasons) - there):
        console.print(f"explained, but no longer there: {path}  {before}  ->  {after}")
    hung = sum(verdict.startswith(HUNG) for verdict in found.values())
    equal = sum((mutant.path, mutant.before, mutant.after) in reasons for mutant in survivors)
    killed, counted = len(found) - len(survivors), len(found) - equal
    console.print(
        f"{len(found)} of {len(wanted)} mutants tried: {killed} noticed ({hung} of them by hanging), "
        f"{len(survivors) - equal} not, {equal} explained and not counted"
    )
    return int(len(found) < len(wanted) or killed < AT_LEAST * counted)


if __name__ == "__main__":
    sys.exit(main())
