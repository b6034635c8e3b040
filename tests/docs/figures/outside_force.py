"""The table of docs/explanation/fidelity.md on the external force without contact, after calibration over S."""

import asyncio
import tempfile
from collections.abc import Iterator
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np

from backend.control import disturbance_observer
from backend.sample import INDEX
from backend.storage.database import open_database
from plant.interface import T_s
from plant.parameters import PlantParameters, load_parameters
from plant.simulator import Simulator
from tests.api.stepped_service import Parts, stepped
from tests.api.test_contact import at_rest
from tests.api.test_contact_sweep import BEGIN, WHO, Truth, sweep_of, zeros_off
from tests.docs.figures.places import Computation, Found, Table

PAGE = "docs/explanation/fidelity.md"
SEEDS = range(6)
STIFFNESSES = np.linspace(8.1, 14.9, 20)

OUTSIDE = Table(
    PAGE,
    "external force",
    ("", "calibrated bias at S = 8 and 15", "bias error, rms and largest", "displayed force, rms and largest"),
)
UNLIKE = "`lab` with a cubic and a tabulated spring, zeros found from load cells ten times as noisy"


def computations() -> Iterator[Computation]:
    """Return the computations of the page, one per plant."""
    for plant, name in (("lab", "`lab`"), ("lab-stick", "`lab-stick`"), ("unlike springs", UNLIKE)):
        yield Computation(f"external force, {plant}", (OUTSIDE,), partial(row, name))


def row(name: str) -> Found:
    """Return the calibrated bias and its error, over all seeds."""
    parameters = zeros_off() if name == UNLIKE else load_parameters(name.strip("`"))
    learned, off, shown = zip(*(swept(parameters, seed) for seed in SEEDS), strict=True)
    return {OUTSIDE: [[name, _learned(np.array(learned)), _largest(np.array(off)), _largest(np.array(shown))]]}


def _learned(ends: np.ndarray) -> str:
    """Return the bias at both ends of S, (seeds, 2) [N]: the mean, or the range if seeds differ."""
    low, high = (f"{end.mean():.2f}" if np.ptp(end) < 0.1 else f"{end.min():.2f} to {end.max():.2f}" for end in ends.T)
    return f"{low} and {high} N"


def _largest(error: np.ndarray) -> str:
    return f"{np.sqrt(np.mean(error**2)):.3f}, {np.abs(error).max():.3f} N"


def swept(parameters: PlantParameters, seed: int) -> tuple[tuple[float, float], list[float], list[float]]:
    """Return the bias at the lowest and the highest S [N], then two errors [N] for each of STIFFNESSES.

    The errors are those of the bias relative to the springs, and of the external force at rest relative to zero.
    """
    plant = Simulator(parameters, seed)
    off: list[float] = []
    shown: list[float] = []

    async def learn(parts: Parts) -> tuple[float, float]:
        await at_rest(parts, 10.4)
        await parts.actuator.contact.apply(BEGIN, WHO)
        while sweep_of(parts).under_way:
            await asyncio.sleep(0)
        assert not sweep_of(parts).why, sweep_of(parts).why
        await parts.supervisor.advance(0.01)
        points = parts.state().touch.learned
        bias = np.array([(point.S, point.F) for point in points])
        truth = Truth(parameters, plant)
        for S in STIFFNESSES:
            await parts.actuator.set_references(0.2, float(S), WHO)
            await parts.supervisor.advance(4.0)
            ring = parts.supervisor.ring
            newest = ring.newest()
            assert newest is not None
            off.append(
                disturbance_observer.interpolate_bias(bias, float(newest[INDEX["S"]])) - await truth.at_rest(parts)
            )
            count = round(1.0 / T_s)
            _, rows, _ = ring.read(ring.count - count, count)
            shown.append(float(rows[:, INDEX["F_ext_hat"]].mean()))
        return points[0].F, points[-1].F

    with tempfile.TemporaryDirectory() as folder:
        database = open_database(Path(folder))
        try:
            ends = stepped(database, replace(parameters), learn, plant)
        finally:
            database.close()
    return ends, off, shown
