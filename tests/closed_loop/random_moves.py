"""Random moves without external force: references change at any time."""

import numpy as np

from backend.control.decoupler import compute_bounds
from backend.tuning.gains import TuningParameters, make_cascade_tuning
from backend.tuning.preview import plan_range
from backend.tuning.simulation import Trajectory, simulate_cascade
from plant.parameters import PlantParameters


def random_moves(parameters: PlantParameters, seed: int, moves: int) -> Trajectory:
    """Simulate random moves from rest; a seed always gives the same moves."""
    random = np.random.default_rng(seed)
    bounds = compute_bounds(parameters)
    lambdas = TuningParameters(lam_q=random.uniform(0.36, 1.0), lam_S=random.uniform(0.35, 0.8))
    budget = random.uniform(*plan_range(parameters)) if random.random() < 0.8 else 0.0
    q, S = random.uniform(-1.3, 1.3), random.uniform(8.0, 15.0)
    legs = [(q, S, 1000)]
    for _ in range(moves):
        q = random.uniform(bounds.q_min, bounds.q_max) if random.random() < 0.7 else q
        S = random.uniform(bounds.S_min, bounds.S_max) if random.random() < 0.5 else S
        legs.append((q, S, int(random.uniform(100, 1500))))
    q_ref, S_ref = (np.concatenate([np.full(leg[2], leg[at]) for leg in legs]) for at in (0, 1))
    return simulate_cascade(
        parameters, make_cascade_tuning(parameters, lambdas, u_plan=budget), q_ref, S_ref, seed=seed
    )
