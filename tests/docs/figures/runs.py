"""Experiments played for the documents: a headless loop, the product's program and tuning, seed 0 unless said."""

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
    """Gains come from geometry: no computation of the documents uses a bank."""
    raise AssertionError(f"bank {number}")


@dataclass(frozen=True)
class Experiment:
    """A run that was played to its end, and what was in use."""

    parameters: PlantParameters
    plan: ExperimentPlan
    settings: LoopSettings
    played: SimulatedRun

    @property
    def in_force(self) -> EvaluationContext:
        """What predictions of the run need."""
        return EvaluationContext(self.parameters, self.plan, self.settings.tuning)

    def value(self, name: str) -> float:
        """Return a figure of the result. Raises AssertionError, with the reason, where it was not measured."""
        figure = next(figure for figure in self.played.metrics.figures if figure.name == name)
        assert figure.value is not None, f"{name}: {figure.reason}"
        return figure.value


def experiment(
    parameters: PlantParameters, name: str, settings: LoopSettings | None = None, **values: Any
) -> Experiment:
    """Play a ready-made experiment to its end; ``settings`` are the defaults unless given."""
    plan, used = build_ready_plan(name, **values), settings or LoopSettings()
    played = simulate_in_memory(parameters, plan, used, no_bank)
    assert played.end_state == "completed", played.end_detail
    return Experiment(parameters, plan, used, played)


def in_motion(plant: str, name: str, motion: str) -> Experiment:
    """Play a ready-made experiment on a parameter set in one of the two motions."""
    return experiment(load_parameters(plant), name, LoopSettings(motion=motion, u_plan=U_PLAN_V))


class Bench:
    """A headless loop on the simulator at which a computation holds, pushes and measures as an operator does."""

    def __init__(self, parameters: PlantParameters, settings: LoopSettings) -> None:
        self.parameters, self.settings = parameters, settings
        self._rows: list[Array] = []
        self._position = 0
        self._loop: SimulatedLoop = make_headless_loop(parameters, replace(settings, k_ext=0.0), None, self._drain)

    def close(self) -> None:
        """Let go of the plant."""
        self._loop.close()

    def send(self, command: Command) -> None:
        """Give a command to the loop. Raises AssertionError, with its reason, where the loop refuses it."""
        answer = asyncio.run(self._loop.send(command))
        assert isinstance(answer, Accepted), answer

    def advance(self, seconds: float) -> None:
        """Let the loop go on for so long."""
        asyncio.run(self._loop.advance(seconds))

    def hold(self, q_ref: float, S_ref: float, seconds: float) -> None:
        """Hold references in run, from pretension if the loop is off."""
        if not self._rows:
            self.send(SetMode(Mode.PRETENSION))
            self.advance(20.0)
            self.send(SetMode(Mode.RUN, 1))
        self.send(SetReferences(q_ref, S_ref))
        self.advance(seconds)

    def learn(self, S: float) -> None:
        """Learn what the outside force reads with nothing outside, then use the rejection of the settings."""
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
        """Return a signal over the last seconds."""
        return self.column(name, round(seconds / T_s))

    def _drain(self, ring: Ring) -> None:
        first, rows, _ = ring.read(self._position, 10_000)
        self._position = first + len(rows)
        self._rows.append(np.array(rows, dtype=np.float64))
