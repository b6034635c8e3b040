"""``python -m tests.bench [PART ...]``: performance as ratios of values from the same run.

The ratios are comparable between machines. Returns 1 if a bound is missed.
"""

import sys
from collections.abc import Callable

from rich.console import Console

from tests.bench import (
    closed_loop_bench,
    compare_bench,
    control_laws,
    identification_bench,
    live_bench,
    page_frames,
    plan_bench,
    recording_bench,
    rig_bench,
    run_search_bench,
    study_bench,
    tick_bench,
    touch_bench,
)

PARTS: dict[str, Callable[[Console], bool]] = {
    "closed-loop": closed_loop_bench.bench,
    "compare": compare_bench.bench,
    "control-laws": control_laws.bench,
    "identification": identification_bench.bench,
    "live": live_bench.bench,
    "page-frames": page_frames.bench,
    "plan": plan_bench.bench,
    "recording": recording_bench.bench,
    "rig": rig_bench.bench,
    "run-search": run_search_bench.bench,
    "studies": study_bench.bench,
    "tick": tick_bench.bench,
    "touch": touch_bench.bench,
}
"""Each prints its tables and returns whether all its bounds were met."""


def main(chosen: list[str]) -> int:
    unknown = [name for name in chosen if name not in PARTS]
    if unknown:
        print(f"unknown part {unknown[0]!r}; known are {', '.join(PARTS)}", file=sys.stderr)
        return 2
    console = Console(width=None if sys.stdout.isatty() else 160, markup=False)
    met = [PARTS[name](console) for name in chosen or PARTS]
    return 0 if all(met) else 1


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
