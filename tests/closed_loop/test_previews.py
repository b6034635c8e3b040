"""A preview shows what happens: what it says of steps and pushes, against the whole loop on the simulator.

Each case is drawn at random from what an operator is offered: motion and voltage limit, λ_q, λ_S, b, gains from
geometry or a bank of four points, switched or interpolated, stiffness, a step of q and one of S, a push of either sign.
Every figure shown has to be right to 3 % or a count (`ideal`), to 6 % or two counts (`lab`). For a time until something
stays within a band the count is one of the band: the time shown has to lie between those for a count more and less.

On `lab` two figures of a step of S are held to what its friction leaves open, not to counts: S itself to the 0.01
N·m/rad that the loop leaves alone at rest, its peak voltage to that of Coulomb friction at rest on top of the 6 %.
"""

from itertools import pairwise

import pytest

from backend.realtime.commands import SetReferences
from backend.tuning.gains import TuningParameters
from tests.closed_loop.previewed import Bench, Case, cases, differences

CASES = 8
"""Per draw: two of each set in each motion."""


@pytest.mark.parametrize("seed", range(6))
def test_what_is_previewed_is_what_happens(seed: int) -> None:
    wrong = {}
    for number, case in enumerate(cases(seed, CASES)):
        off = {name: round(value, 2) for name, value in differences(case).items() if not value <= 1.0}
        if off:
            wrong[number] = case, off
    assert not wrong


@pytest.mark.parametrize("name", ["ideal", "lab"])
def test_a_step_takes_as_long_as_lambda_says(name: str) -> None:
    """In `lambda` motion, of small and of large steps: the time to 90 % goes with λ_q (README, five minutes)."""
    for size in (0.2, 1.0):
        reached = []
        for lam in (0.5, 0.7, 1.0):
            bench = Bench(Case(name, 0.0, TuningParameters(lam_q=lam), (), False, (0.0, size), (10.0, 10.0), 0.0))
            bench.send(SetReferences(0.0, 10.0))
            bench.advance(6.0)
            bench.send(SetReferences(size, 10.0))
            q = bench.advance(10.0 * lam)["q"]
            bench.close()
            reached.append((lam, float((q >= 0.9 * size).argmax()) * 1e-3))
        for (before, t_before), (after, t_after) in pairwise(reached):
            assert t_after / t_before == pytest.approx(after / before, rel=0.1)
        assert reached[-1][1] / reached[0][1] == pytest.approx(2.0, rel=0.1)
