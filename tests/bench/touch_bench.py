"""Cost of the external force per tick: a loop compared with one compiled without it."""

import math
from contextlib import closing
from typing import Any, cast
from unittest.mock import patch

import numba
from rich.console import Console

from backend.control import step
from backend.realtime.control_loop import Loop
from backend.realtime.program import ConfigureContactDetection
from backend.realtime.ring_buffer import Ring
from backend.sample import INDEX
from plant.compilation import STRICT
from plant.parameters import PlantParameters, load_parameters
from tests.bench.plan_bench import COMPILED_US, LIVE_US, drive_batches, drive_ticks, more_us
from tests.bench.table import Ratio, print_ratios
from tests.bench.tick_bench import loop_in_run, require_run

TICKS, LIVE_TICKS, PIECES = 5_000, 1_000, 101
"""Of a piece, and pieces of each loop: short ones in turns, so that whatever else the machine does meets both alike."""

LEARNED = ConfigureContactDetection(
    bias=tuple((S, 0.1 * S) for S in (8.0, 9.0, 10.0, 11.0, 12.0, 13.0, 14.0, 15.0)), contact_N=30.0
)


def bench(console: Console) -> bool:
    """Print the measurements; return whether all bounds are met."""
    parameters, rings = load_parameters("lab"), (Ring.create(), Ring.create())
    with (
        closing(loop_in_run(parameters, rings[0])) as feeling,
        closing(_loop_without_external_force(parameters, rings[1])) as numb,
    ):
        feeling.handle(0, LEARNED)
        compiled = more_us(feeling, numb, drive_batches, TICKS, PIECES)
        live = more_us(feeling, numb, drive_ticks, LIVE_TICKS, PIECES)
        require_run(feeling)
        require_run(numb)
        _require_difference(*rings)
    lines = [
        Ratio.at_most("compiled tick: what touch adds / 1 µs", compiled / COMPILED_US, 1.0, f"{compiled:.2f} µs"),
        Ratio.at_most("live tick: what touch adds / 5 µs", live / LIVE_US, 1.0, f"{live:.2f} µs"),
    ]
    return print_ratios(console, "Touch: what a tick of it costs", lines)


def _require_difference(feeling: Ring, numb: Ring) -> None:
    """Raise if the two loops do not differ in the external force."""
    forces = [math.nan if row is None else float(row[INDEX["F_ext_hat"]]) for row in (feeling.newest(), numb.newest())]
    if not math.isfinite(forces[0]) or math.isfinite(forces[1]):
        raise RuntimeError(f"one loop was to know the outside force and the other not: {forces} N")


def _loop_without_external_force(parameters: PlantParameters, ring: Ring) -> Loop:
    """Return a loop in mode Run whose tick was compiled without the external force; not cached on disk."""

    def feel_nothing(control: object, m: object, zeroed: object) -> float:
        return math.nan

    strict: Any = numba.njit(**STRICT)
    its_look, its_run = cast(Any, step.detect_faults), cast(Any, step.run_batch)
    with patch.object(step, "_estimate_external_force", strict(feel_nothing)):
        look = strict(its_look.py_func)
        with patch.object(step, "detect_faults", look), patch.object(step, "detect_faults", look):
            run = numba.njit(nogil=True, **STRICT)(its_run.py_func)
            with patch.object(step, "run_batch", run):
                loop = loop_in_run(parameters, ring)
                drive_batches(loop, 1)
    return loop
