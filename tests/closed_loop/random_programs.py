"""Random programs with changes of references and tuning, and with pushes."""

import math
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from backend.control import cascade, decoupler
from backend.control.decoupler import compute_bounds
from backend.tuning import simulation
from backend.tuning.gains import PointModel, TuningParameters, designed_point, make_cascade_tuning
from backend.tuning.preview import plan_range
from plant.parameters import PlantParameters


class Played(NamedTuple):
    """Least and largest tension [N] of a program, and whether it tripped."""

    least: float
    most: float
    tripped: bool


def random_program(plant: PlantParameters, seed: int) -> Played:
    """Simulate ten legs from rest; a seed always gives the same program."""
    random = np.random.default_rng(seed)
    rig, bounds = simulation.make_simulated_rig(plant), compute_bounds(plant)
    points = [replace(designed_point(plant), S_nominal=S) for S in (8.24, 10.55, 12.43, 14.06)]

    def tuning() -> cascade.CascadeTuning:
        lambdas = TuningParameters(lam_q=random.uniform(0.36, 1.0), lam_S=random.uniform(0.35, 0.8))
        bank: list[PointModel] = points if random.random() < 0.5 else []
        budget = random.uniform(*plan_range(plant)) if random.random() < 0.8 else 0.0
        return make_cascade_tuning(plant, lambdas, bank, interpolate=bool(random.random() < 0.5), u_plan=budget)

    q_ref, S_ref, F_push, chosen = random.uniform(-1.3, 1.3), random.uniform(8.0, 15.0), 0.0, tuning()
    x, law = simulation.at_rest(rig, chosen, q_ref, S_ref)
    least, most = math.inf, 0.0
    for leg in range(10):
        ticks = int(random.uniform(100, 1500))
        q_ref = random.uniform(bounds.q_min, bounds.q_max) if random.random() < 0.7 else q_ref
        S_ref = random.uniform(bounds.S_min, bounds.S_max) if random.random() < 0.5 else S_ref
        chosen = tuning() if random.random() < 0.5 else chosen
        tension = decoupler.tension_under(chosen.decoupler, decoupler.stiffness(chosen.decoupler, x.theta_A, x.theta_B))
        margin = min(tension - 4.0, 46.0 - tension, 46.0 - decoupler.tension_under(chosen.decoupler, S_ref))
        F_push = random.uniform(-1.0, 1.0) * min(10.0, max(margin, 0.0)) if random.random() < 0.5 else 0.0
        line, out = simulation.empty_arrays(ticks)
        inputs = simulation.make_closed_loop_inputs(
            plant, np.full(ticks, q_ref), np.full(ticks, S_ref), np.full(ticks, F_push), 100 * seed + leg
        )
        x, law, tripped = simulation.simulate(rig, chosen, x, law, inputs, line, out)
        F = out[: tripped if tripped >= 0 else None, 5:7]
        least, most = min(least, float(F.min())), max(most, float(F.max()))
        if tripped >= 0:
            return Played(least, most, True)
    return Played(least, most, False)
