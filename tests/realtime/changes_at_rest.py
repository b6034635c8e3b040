"""Random changes of mode, law, bank and tuning at rest, and the motion that each causes.

Feedback linearization is not among the laws: with encoder counts its voltages never rest (9 V peak to
peak on `lab`), so a change to it cannot be judged.
"""

import math
from contextlib import closing
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from backend.realtime.commands import Command, Refused, RunProgram, SetMode, SetReferences
from backend.realtime.control_loop import Loop
from backend.realtime.gains import make_tuning_command
from backend.realtime.modes import Mode
from backend.realtime.program import ConfigureContactDetection, Law, Program, Segment, SetTuning
from backend.realtime.ring_buffer import Ring
from backend.sample import INDEX
from backend.tuning.gains import PointModel, TuningParameters, designed_point
from plant.parameters import PlantParameters
from plant.simulator import Simulator

SETTLED_TICKS, SEEN_TICKS = 12_000, 2500
REST_TICKS, REST_V = 2000, 0.08
"""A joint that for so long has moved by no more than a count, under voltages within so much [V], is at rest."""
COUNT = 2.0 * math.pi / 4000.0
_VOLTAGES = [INDEX["u_A"], INDEX["u_B"]]


class Moved(NamedTuple):
    """The effect of a change within the ticks after it: ``change`` by name, with the mode and voltage limit before.

    ``u`` [V]: largest distance of a voltage from its old value; ``jump`` [V]: largest from one tick to the next;
    ``counts``: largest distance of the joint from its old position, in counts of its encoder.
    """

    change: str
    mode: Mode
    u_plan: float
    u: float
    jump: float
    counts: float


class Session:
    """A loop on the simulator that is told what a seed draws."""

    def __init__(self, plant: PlantParameters, seed: int, budgets: tuple[float, ...]) -> None:
        self._plant, self._random, self._budgets = plant, np.random.default_rng(seed), budgets
        self._points = [replace(designed_point(plant), S_nominal=S) for S in (8.24, 10.55, 12.43, 14.06)]
        self._ring = Ring.create(1 << 14)
        self._bias: list[tuple[float, float]] = []
        self._lambdas, self._bank, self._interpolate = TuningParameters(), list[PointModel](), False
        self._tuning = make_tuning_command(plant, self._lambdas, u_plan=float(self._random.choice(budgets)))
        self._loop = Loop(Simulator(plant, seed=seed), plant, self._ring, self._tuning)

    def close(self) -> None:
        self._loop.close()
        self._ring.close()

    def pretension(self) -> None:
        """Wind up until both tendons hold the pretension."""
        self.order(SetMode(Mode.PRETENSION))
        while not self._loop.is_pretension_done:
            self.run(10)

    def changes(self, number: int, places: int) -> list[Moved]:
        """Make ``number`` changes at each of ``places`` references, the first of which is that of the pretension."""
        self.pretension()
        moved = []
        for place in range(places):
            if place > 0:
                self._go(self._random.uniform(-1.2, 1.2), self._random.uniform(8.5, 14.5))
            self.run(SETTLED_TICKS)
            self._learn()
            for _ in range(number):
                self._wait_for_rest()
                moved.append(self._change(at_pretension=place == 0))
        return moved

    def _learn(self) -> None:
        """Measure the bias of the external force, as the calibration on the page does."""
        rows = self._rows(1000)
        S, F = float(rows[:, INDEX["S"]].mean()), float(rows[:, INDEX["F_ext_hat"]].mean())
        F += float(np.interp(S, *np.array(self._bias).T)) if self._bias else 0.0
        self._bias = sorted([*(point for point in self._bias if abs(point[0] - S) > 0.1), (S, F)])
        self.order(ConfigureContactDetection(tuple(self._bias), 0.0))

    def _wait_for_rest(self) -> None:
        for _ in range(40):
            rows = self._rows(REST_TICKS)
            u, q = rows[:, _VOLTAGES], rows[:, INDEX["q"]]
            if np.ptp(u, axis=0).max() <= REST_V and np.ptp(q) <= 1.01 * COUNT:
                return
            self.run(1000)
        raise AssertionError(f"never at rest in {self._loop.mode}: {np.ptp(u, axis=0)} V, {np.ptp(q) / COUNT} counts")

    def _go(self, q_ref: float, S_ref: float) -> None:
        if self._loop.mode is not Mode.RUN:
            if self._loop.mode is Mode.EXPERIMENT:
                self.run(20_000)
            if self._loop.mode is Mode.PRETENSION:
                self.run(SETTLED_TICKS)
            self.order(SetMode(Mode.RUN))
        self.order(SetReferences(q_ref, S_ref))

    def _change(self, *, at_pretension: bool) -> Moved:
        """Make one change and return its effect."""
        mode, u_plan = self._loop.mode, self._tuning.u_plan
        names = ["lam_q", "lam_S", "lam_motor", "b", "bank", "motion", "k_ext", "all"]
        names += {
            Mode.RUN: ["compliance", "experiment", "run_again"],
            Mode.COMPLIANCE: ["run"] * 3,
            Mode.PRETENSION: ["run", "compliance", "experiment", "single_loop"],
        }[mode]
        if at_pretension and mode is not Mode.PRETENSION:
            names += ["pretension"] * 2
        name = str(self._random.choice(names))
        before = self._rows(1)
        for command in self._commands(name):
            self.order(command)
        self.run(SEEN_TICKS)
        after = self._rows(SEEN_TICKS)
        if self._loop.mode is Mode.EXPERIMENT:  # programs are longer than what is looked at
            back = Mode.PRETENSION if at_pretension else Mode.RUN
            self.order(SetMode(back))
            self.run(SETTLED_TICKS)
        u, was = after[:, _VOLTAGES], before[-1, _VOLTAGES]
        counts = np.abs(after[:, INDEX["q"]] - before[-1, INDEX["q"]]) / COUNT
        jumps = np.abs(np.diff(np.vstack([was, u]), axis=0))
        return Moved(name, mode, u_plan, float(np.max(np.abs(u - was))), float(jumps.max()), float(counts.max()))

    def _commands(self, name: str) -> tuple[Command, ...]:
        if name in ("run", "compliance", "pretension"):
            return (SetMode(Mode(name)),)
        if name == "run_again":
            return SetMode(Mode.COMPLIANCE), SetMode(Mode.RUN)
        if name in ("experiment", "single_loop"):
            law = Law.CASCADE if name == "experiment" else Law.SINGLE_LOOP
            row = self._rows(1)[0]
            q, S = float(row[INDEX["q"]]), float(np.clip(row[INDEX["S"]], 8.0, 15.0))
            return (RunProgram(Program(law, (Segment(4.0, q_ref=q, S_ref=S),))),)
        self._tuning = self._drawn(name)
        return (self._tuning,)

    def _drawn(self, name: str) -> SetTuning:
        """Return the tuning that a change of this name leads to."""
        random, now = self._random, self._tuning
        draws = {
            "lam_q": random.uniform(0.36, 1.0),
            "lam_S": random.uniform(0.35, 0.8),
            "lam_motor": random.uniform(0.07, 0.12),
            "b": random.choice([0.0, 0.5, 1.0]),
        }
        chosen = draws if name == "all" else {key: draws[key] for key in draws if key == name}
        self._lambdas = replace(self._lambdas, **{key: float(value) for key, value in chosen.items()})
        u_plan, k_ext = now.u_plan, now.k_ext
        if name in ("bank", "all"):
            self._bank = self._points if random.random() < 0.7 else []
            self._interpolate = bool(random.random() < 0.5)
        if name in ("motion", "all"):
            u_plan = float(random.choice(self._budgets))
        if name in ("k_ext", "all"):
            k_ext = float(random.choice([0.0, 0.5, 1.0]))
        return make_tuning_command(
            self._plant, self._lambdas, self._bank, interpolate=self._interpolate, u_plan=u_plan, k_ext=k_ext
        )

    def voltages(self, ticks: int) -> NDArray[np.float64]:
        """Return the voltages (ticks, 2) [V] of the last ticks."""
        return self._rows(ticks)[:, _VOLTAGES]

    def order(self, command: Command) -> None:
        """Execute a command that must be accepted."""
        self._loop.handle(0, command)
        refused = [event.reason for event in self._loop.drain_events() if isinstance(event, Refused)]
        assert not refused, (command, refused)

    def run(self, ticks: int) -> None:
        while ticks > 0:
            ticks -= self._loop.run(min(1000, ticks))
            self._loop.drain_events()

    def _rows(self, ticks: int) -> NDArray[np.float64]:
        _, rows, _ = self._ring.read(self._ring.count - ticks, ticks)
        return rows


def changes_at_rest(
    plant: PlantParameters, seed: int, *, number: int, places: int, budgets: tuple[float, ...]
) -> list[Moved]:
    """Return the effects of the changes of a session; the same seed gives the same session."""
    with closing(Session(plant, seed, budgets)) as session:
        return session.changes(number, places)
