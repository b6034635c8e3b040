"""A thousand random programs on each parameter set: tendons stay taut, and no trip occurs."""

from rich.console import Console

from plant.parameters import SHIPPED, load_parameters
from tests.closed_loop.random_programs import random_program

PROGRAMS = 1000
TAUT_N, SOLID_N = 1.0, 50.0


def random_programs(console: Console, programs: int = PROGRAMS) -> bool:
    """Execute the programs; return whether all tendons stayed taut and below their limits, without a trip."""
    kept = True
    for name in SHIPPED:
        played = [random_program(load_parameters(name), seed) for seed in range(programs)]
        least, most = min(one.least for one in played), max(one.most for one in played)
        trips = sum(one.tripped for one in played)
        console.print(f"{name}: {programs} programs, {least:.2f} to {most:.2f} N, {trips} trips")
        kept &= trips == 0 and least > TAUT_N and most < SOLID_N
    return kept
