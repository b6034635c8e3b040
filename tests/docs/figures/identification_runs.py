"""The identification procedure of the paper on the simulated rig, for docs/explanation/fidelity.md."""

import math

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize_scalar
from scipy.signal import lfilter

from backend.experiments.plans import ActuatorIdentificationPlan
from backend.identification.motor import VoltageStepRecord
from backend.realtime.commands import Refused, RunProgram, SetMode
from backend.realtime.control_loop import Loop
from backend.realtime.gains import make_tuning_command
from backend.realtime.modes import Mode
from backend.sample import INDEX
from backend.tuning.gains import TuningParameters
from plant.dynamics import AT_REST
from plant.interface import MotorCommand, T_s
from plant.parameters import PlantParameters
from plant.simulator import Simulator

Array = NDArray[np.float64]

VOLTAGES = (2.0, 4.0, 6.0, 8.0)


class Bench:
    """A headless loop on the simulator with pretension established; every experiment starts from there."""

    def __init__(self, parameters: PlantParameters, seed: int = 0) -> None:
        self._rows: list[Array] = []
        self._loop = Loop(
            Simulator(parameters, seed), parameters, self, make_tuning_command(parameters, TuningParameters())
        )
        self._order(SetMode(Mode.PRETENSION))
        self._tick_until_pretension()

    def append(self, row: Array) -> None:
        """Store a sample."""
        self._rows.append(row.copy())

    def play(self, plan: ActuatorIdentificationPlan) -> dict[str, Array]:
        """Execute a force-hold program and return the columns of its excited part."""
        self._rows.clear()
        self._order(RunProgram(plan.program()))
        while self._loop.mode is Mode.IDENTIFY:
            self._loop.tick()
        ticks = round(plan.excitation().duration_s / T_s)
        excited = np.array(self._rows[-1 - ticks : -1])
        self._tick_until_pretension()
        names = ("theta_A_ref", "q", "S", "u_A", "theta_A", "F_A")
        return {name: excited[:, INDEX[name]] for name in names}

    def _order(self, command: SetMode | RunProgram) -> None:
        self._loop.handle(0, command)
        refused = [event for event in self._loop.drain_events() if isinstance(event, Refused)]
        if refused:
            raise RuntimeError(refused[0].reason)

    def _tick_until_pretension(self) -> None:
        for _ in range(120_000):
            if self._loop.is_pretension_done:
                return
            self._loop.tick()
        raise RuntimeError(f"pretension was not reached; the mode is {self._loop.mode}")


def unloaded_steps(parameters: PlantParameters) -> dict[str, list[VoltageStepRecord]]:
    """Return velocity steps of both motors without tendons, as the encoders measure them, by side."""
    count = 2.0 * math.pi / parameters.sensors.motor_counts
    off_the_reel = AT_REST._replace(theta_A=-200.0, theta_B=-200.0)
    runs: dict[str, list[VoltageStepRecord]] = {"A": [], "B": []}
    for voltage in VOLTAGES:
        simulator = Simulator(parameters, x=off_the_reel)
        u = np.where(np.arange(2200) < 200, 0.0, voltage)
        theta = []
        for volts in u:
            m = simulator.read()
            theta.append((m.theta_A, m.theta_B))
            simulator.write(MotorCommand(volts, volts))
        for side, column in zip("AB", np.array(theta).T, strict=True):
            runs[side].append(VoltageStepRecord(T_s, u, column, parameters.motor.u_max, count))
    return runs


def first_order_output_error(u: Array, y: Array) -> tuple[float, float, float]:
    """Return K, T [s] and fit [%] of K/(T s + 1) with offset and initial state, by least squares for each T."""
    u, y = u - u[0], y - y[0]
    t = np.arange(u.size) * T_s

    def solve(T: float) -> tuple[float, float]:
        decay = math.exp(-T_s / T)
        columns = np.column_stack((lfilter([0.0, 1.0 - decay], [1.0, -decay], u), np.ones(t.size), np.exp(-t / T)))
        solution = np.linalg.solve(columns.T @ columns, columns.T @ y)
        return float(y @ y - solution @ (columns.T @ y)), float(solution[0])

    grid = np.geomspace(0.1, 20.0, 25)
    best = min(max(int(np.argmin([solve(T)[0] for T in grid])), 1), grid.size - 2)
    bounds = math.log(grid[best - 1]), math.log(grid[best + 1])
    T = math.exp(minimize_scalar(lambda log_T: solve(math.exp(log_T))[0], bounds=bounds, method="bounded").x)
    error, K = solve(T)
    return K, T, 100.0 * (1.0 - math.sqrt(error / float(np.sum((y - y.mean()) ** 2))))


def newtons_per_count(parameters: PlantParameters, S: float) -> float:
    """Return the tension [N] that moves the joint by one encoder count at theta_B = 0: F' r_j = S/(2 r_j)."""
    return S / (2.0 * parameters.geometry.r_j) * 2.0 * math.pi / parameters.sensors.joint_counts
