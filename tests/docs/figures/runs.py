"""Experiments for the documents: a headless loop with program and tuning of the product, seed 0 by default."""

import asyncio
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from backend.analysis.context import EvaluationContext
from backend.banks.builder import build_tuning_command
from backend.execution.simulation import SimulatedRun, make_headless_loop, simulate_in_memory
from backend.experiments.library import build_ready_plan
from backend.experiments.plans import ExperimentPlan, LoopSettings
from backend.realtime.commands import Accepted, Command, SetMode, SetReferences
from backend.realtime.headless import SimulatedLoop
from backend.realtime.modes import Mode
from backend.realtime.program import ConfigureContactDetection
from backend.realtime.ring_buffer import Ring
from backend.sample import INDEX
from backend.storage.banks import Bank
from plant.interface import T_s
from plant.parameters import PlantParameters, load_parameters

Array = NDArray[np.float64]

LAMBDA, TIME_OPTIMAL = "lambda", "time-optimal"
U_PLAN_V = 8.5
MOTION_NAMES = {LAMBDA: LAMBDA, TIME_OPTIMAL: f"time-optimal, {U_PLAN_V:g} V"}
"""A motion as the tables name it."""


def no_bank(number: int) -> Bank:
    """Return no bank: the computations use geometric gains."""
    raise AssertionError(f"bank {number}")


@dataclass(frozen=True)
class Experiment:
    """A completed run and its active settings."""

    parameters: PlantParameters
    plan: ExperimentPlan
    settings: LoopSettings
    played: SimulatedRun

    @property
    def in_force(self) -> EvaluationContext:
        """Return the inputs of the predictions for the run."""
        return EvaluationContext(self.parameters, self.plan, self.settings.tuning)

    def value(self, name: str) -> float:
        """Return a metric of the result. Raises AssertionError with the reason if it was not measured."""
        figure = next(figure for figure in self.played.metrics.figures if figure.name == name)
        assert figure.value is not None, f"{name}: {figure.reason}"
        return figure.value


def experiment(
    parameters: PlantParameters, name: str, settings: LoopSettings | None = None, **values: Any
) -> Experiment:
    """Execute a ready-made experiment; ``settings`` override the defaults."""
    plan, used = build_ready_plan(name, **values), settings or LoopSettings()
    played = simulate_in_memory(parameters, plan, used, no_bank)
    assert played.end_state == "completed", played.end_detail
    return Experiment(parameters, plan, used, played)


def in_motion(plant: str, name: str, motion: str) -> Experiment:
    """Execute a ready-made experiment on a parameter set with one of the two motions."""
    return experiment(load_parameters(plant), name, LoopSettings(motion=motion, u_plan=U_PLAN_V))


class Bench:
    """A headless loop on the simulator for holds, pushes and measurements."""

    def __init__(self, parameters: PlantParameters, settings: LoopSettings) -> None:
        self.parameters, self.settings = parameters, settings
        self._rows: list[Array] = []
        self._position = 0
        self._loop: SimulatedLoop = make_headless_loop(parameters, replace(settings, k_ext=0.0), None, self._drain)

    def close(self) -> None:
        """Close the plant."""
        self._loop.close()

    def send(self, command: Command) -> None:
        """Send a command to the loop. Raises AssertionError with the reason if the loop refuses it."""
        answer = asyncio.run(self._loop.send(command))
        assert isinstance(answer, Accepted), answer

    def advance(self, seconds: float) -> None:
        """Let the loop run for a duration."""
        asyncio.run(self._loop.advance(seconds))

    def hold(self, q_ref: float, S_ref: float, seconds: float) -> None:
        """Hold references in mode Run, after the pretension if the loop is off."""
        if not self._rows:
            self.send(SetMode(Mode.PRETENSION))
            self.advance(20.0)
            self.send(SetMode(Mode.RUN, 1))
        self.send(SetReferences(q_ref, S_ref))
        self.advance(seconds)

    def learn(self, S: float) -> None:
        """Calibrate the external force without contact, then enable disturbance rejection."""
        self.send(ConfigureContactDetection(((S, float(np.mean(self.column("F_ext_hat", 500)))),)))
        self.send(build_tuning_command(self.parameters, self.settings, None))

    def column(self, name: str, last: int) -> Array:
        """Return the last samples of a signal."""
        count, rows = 0, []
        for block in reversed(self._rows):
            rows.append(block[:, INDEX[name]])
            count += len(block)
            if count >= last:
                break
        return np.concatenate(rows[::-1])[-last:]

    def seconds(self, name: str, seconds: float) -> Array:
        """Return a signal over the last ``length_s`` seconds."""
        return self.column(name, round(seconds / T_s))

    def _drain(self, ring: Ring) -> None:
        first, rows, _ = ring.read(self._position, 10_000)
        self._position = first + len(rows)
        self._rows.append(np.array(rows, dtype=np.float64))
