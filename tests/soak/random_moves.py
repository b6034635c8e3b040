"""Ten thousand random moves on each parameter set without contact: none may be detected as a contact."""

import numpy as np
from rich.console import Console

from plant.parameters import SHIPPED, load_parameters
from tests.closed_loop.outside_force import WARM, estimate_external_force, measure_bias
from tests.closed_loop.random_moves import random_moves

MOVES, AT_A_TIME = 10_000, 100
CONTACT_N = 1.5


def moves_without_contact(console: Console, moves: int = MOVES) -> bool:
    """Execute the moves; return whether the estimated external force stayed below the threshold."""
    kept = True
    for name in SHIPPED:
        parameters = load_parameters(name)
        bias, largest = measure_bias(parameters), 0.0
        for seed in range(moves // AT_A_TIME):
            force = estimate_external_force(parameters, random_moves(parameters, seed, AT_A_TIME), bias)
            largest = max(largest, float(np.max(np.abs(force[WARM:]))))
        console.print(f"{name}: {moves} moves, at most {largest:.2f} N, a contact is {CONTACT_N} N")
        kept &= largest < CONTACT_N
    return kept
