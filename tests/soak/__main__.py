"""``python -m tests.soak [PART ...]``: long runs and repeated kills. Ends with 1 if anything was lost."""

import argparse
import sys
from collections.abc import Callable

from rich.console import Console

from tests.soak import kills, page_heap, viewers


def main() -> int:
    parser = argparse.ArgumentParser(prog="python -m tests.soak", description=__doc__)
    parser.add_argument("--kills", type=int, default=20, help="how often each process is killed (20)")
    parser.add_argument("--minutes", type=float, default=10.0, help="length of each watched stretch (10)")
    parser.add_argument("--viewers", type=int, default=20, help="how many watch it (20)")
    console = Console(width=None if sys.stdout.isatty() else 160, markup=False)
    parts: dict[str, Callable[[argparse.Namespace], bool]] = {
        "service-kills": lambda given: kills.kill_service(given.kills, console),
        "loop-kills": lambda given: kills.kill_loop(given.kills, console),
        "page-heap": lambda given: page_heap.streaming_page(given.minutes, console),
        "viewers": lambda given: viewers.watched_simulation(given.minutes, given.viewers, console),
    }
    parser.add_argument("parts", nargs="*", metavar="PART", help=f"{', '.join(parts)}; all if left out")
    given = parser.parse_args()
    unknown = set(given.parts) - set(parts)
    if unknown:
        parser.error(f"unknown part {', '.join(sorted(unknown))}; known are {', '.join(parts)}")
    whole = [parts[name](given) for name in given.parts or parts]
    return 0 if all(whole) else 1


if __name__ == "__main__":
    sys.exit(main())
