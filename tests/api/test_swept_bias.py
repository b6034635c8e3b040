"""The bias after a sweep, between its points, compared with springs and true angles."""

import asyncio
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from backend.control import disturbance_observer
from backend.realtime.modes import Mode
from backend.sample import INDEX
from backend.schemas.state import SweepView
from backend.services.contact import SWEEP_POINTS
from backend.storage.database import Database, open_database
from plant.dynamics import spring_elongation, spring_slope, tendon_tension
from plant.parameters import PlantParameters, load_parameters
from plant.simulator import Simulator
from tests.api.stepped_service import Parts, stepped
from tests.api.test_touch import at_rest
from tests.api.test_touch_sweep import BEGIN, WHO, reference, sweep_of
from tests.closed_loop.test_unlike_sides import unlike_sides


@pytest.fixture
def database(tmp_path: Path) -> Iterator[Database]:
    opened = open_database(tmp_path)
    yield opened
    opened.close()


def zeros_off() -> PlantParameters:
    """Unlike springs, and load cells so noisy that the motors' zeros are found elsewhere."""
    unlike = unlike_sides()
    return replace(unlike, sensors=replace(unlike.sensors, force_noise=10.0 * unlike.sensors.force_noise))


def bias_of_springs(parameters: PlantParameters, S: np.ndarray) -> np.ndarray:
    """What the identified springs say where the true ones balance each other, by identified stiffness [N], no zeros."""
    true_A, true_B = parameters.make_dynamics().spring_A, parameters.make_dynamics().spring_B
    told_A, told_B = parameters.make_identified_spring("A"), parameters.make_identified_spring("B")
    held = np.linspace(5.0, 47.0, 800)
    x_A, x_B = (np.array([spring_elongation(spring, F) for F in held]) for spring in (true_A, true_B))
    stiff = parameters.geometry.r_j**2 * np.array(
        [spring_slope(told_A, a) + spring_slope(told_B, b) for a, b in zip(x_A, x_B, strict=True)]
    )
    said = np.array([tendon_tension(told_B, b) - tendon_tension(told_A, a) for a, b in zip(x_A, x_B, strict=True)])
    between: np.ndarray = np.interp(S, stiff, said)
    return between


class Truth:
    """The bias at true angles, without the encoders' steps [N]; the zeros of the motors are those of the loop."""

    def __init__(self, parameters: PlantParameters, plant: Simulator) -> None:
        self._springs = parameters.make_identified_spring("A"), parameters.make_identified_spring("B")
        self._geometry, self._plant = parameters.geometry, plant

    async def at_rest(self, parts: Parts) -> float:
        said = []
        for _ in range(50):
            await parts.supervisor.advance(0.02)
            row, x = parts.supervisor.ring.newest(), self._plant.x
            assert row is not None
            # measured less true: the zero, and an encoder's step that the mean over a move has not
            said.append((row[INDEX["theta_A"]] - x.theta_A, row[INDEX["theta_B"]] - x.theta_B))
        off_A, off_B = np.mean(said, axis=0)
        spring_A, spring_B = self._springs
        r_m, r_j, x = self._geometry.r_m, self._geometry.r_j, self._plant.x
        F_A = tendon_tension(spring_A, r_m * (x.theta_A + off_A) - r_j * x.q)
        F_B = tendon_tension(spring_B, r_m * (x.theta_B + off_B) + r_j * x.q)
        return float(F_B - F_A)


@pytest.mark.parametrize("name", ["lab", "unlike"])
def test_bias_is_linear_between_the_points(name: str) -> None:
    parameters = load_parameters("lab") if name == "lab" else unlike_sides()
    S = np.linspace(8.0, 15.0, 300)
    points = np.linspace(8.0, 15.0, SWEEP_POINTS)
    true = bias_of_springs(parameters, S)
    assert np.ptp(true) > 0.3  # there is something to learn
    by_lines = np.interp(S, points, bias_of_springs(parameters, points))
    assert np.max(np.abs(by_lines - true)) < 0.01  # asked: 0.05


@pytest.mark.parametrize("name", ["lab", "unlike"])
def test_sweep_calibrates_between_the_points_and_restores_S(database: Database, name: str) -> None:
    parameters = load_parameters("lab") if name == "lab" else zeros_off()
    plant = Simulator(parameters, 3)
    off: list[float] = []

    async def learn(parts: Parts) -> None:
        await at_rest(parts, 10.4)
        begun = (await parts.actuator.contact.apply(BEGIN, WHO)).sweep
        assert begun == SweepView(under_way=True, point=1, points=SWEEP_POINTS, S_ref=8.0, why="")
        seen: list[SweepView] = []
        while sweep_of(parts).under_way:
            seen.append(sweep_of(parts))
            await asyncio.sleep(0)
        ended = sweep_of(parts)
        assert [sweep.point for n, sweep in enumerate(seen) if seen[n - 1] != sweep] == [1, 2, 3, 4, 5]
        assert (ended.under_way, ended.why) == (False, "")
        await parts.supervisor.advance(0.01)
        assert reference(parts) == pytest.approx((0.2, 10.4))
        assert parts.live_state.mode is Mode.RUN
        points = parts.state().touch.learned
        assert [point.S for point in points] == pytest.approx(np.linspace(8.0, 15.0, SWEEP_POINTS), abs=0.1)
        assert all(0.0 < point.std_N < 0.2 for point in points)
        bias = np.array([(point.S, point.F) for point in points])
        truth = Truth(parameters, plant)
        for S in np.linspace(8.1, 14.9, 20):
            await parts.actuator.set_references(0.2, float(S), WHO)
            await parts.supervisor.advance(4.0)
            row = parts.supervisor.ring.newest()
            assert row is not None
            off.append(disturbance_observer.interpolate_bias(bias, float(row[INDEX["S"]])) - await truth.at_rest(parts))

    stepped(database, parameters, learn, plant)
    error = np.array(off)
    # half a count of the joint's encoder is 0.16 N at the stiffest, and each point was learned within one
    assert np.max(np.abs(error)) < 0.2
    assert np.sqrt(np.mean(error**2)) < 0.12
