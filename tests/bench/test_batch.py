"""A batch returns the same results as its runs in sequence."""

from functools import partial
from threading import Barrier

import numpy as np
import pytest

from backend.tuning.gains import TuningParameters, make_cascade_tuning
from backend.tuning.simulation import simulate_cascade
from plant.parameters import load_parameters
from tests.bench.batch import run_batch


def test_results_do_not_depend_on_the_number_of_workers() -> None:
    parameters = load_parameters("lab")
    tuning = make_cascade_tuning(parameters, TuningParameters())
    q_ref, S_ref = np.repeat([0.0, 0.5], 200), np.full(400, 10.0)

    def mean_force(seed: int) -> float:
        return float(simulate_cascade(parameters, tuning, q_ref, S_ref, seed=seed).F_A.mean())

    alone = [mean_force(seed) for seed in range(12)]
    assert len(set(alone)) == 12
    assert run_batch([partial(mean_force, seed) for seed in range(12)], workers=1) == alone
    assert run_batch([partial(mean_force, seed) for seed in range(12)], workers=3) == alone


def test_runs_of_a_batch_are_executed_in_parallel() -> None:
    """Each run waits for the others, so that a sequence would never end."""
    both = Barrier(2, timeout=30.0)
    run_batch([both.wait, both.wait], workers=2)


def test_the_first_error_of_a_run_is_raised() -> None:
    def odd_fails(number: int) -> int:
        if number % 2:
            raise ValueError(f"run {number}")
        return number

    with pytest.raises(ValueError, match="run 1"):
        run_batch([partial(odd_fails, number) for number in range(6)], workers=2)
