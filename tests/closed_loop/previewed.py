"""Deviations between a preview and the whole loop on the simulator.

The measured values come from the samples of ``SimulatedLoop``: pretension, modes, encoders, references and pushes as
an operator commands them. They do not use the simulation of the preview.
"""

import math
from collections.abc import Coroutine, Iterator
from dataclasses import dataclass
from typing import Any, TypeVar, cast

import numpy as np

from backend.realtime.commands import Accepted, ApplyPush, Command, SetMode, SetReferences
from backend.realtime.gains import make_tuning_command
from backend.realtime.headless import SimulatedLoop
from backend.realtime.modes import Mode
from backend.realtime.ring_buffer import Ring
from backend.sample import INDEX
from backend.tuning.gains import PointModel, TuningParameters, designed_point, make_motor_loops
from backend.tuning.preview import Steps, TuningPreviewer
from backend.tuning.simulation import BAND, NEAR_RAD, PUSH_N, Array
from plant.interface import T_s
from plant.parameters import PlantParameters, load_parameters
from plant.simulator import Simulator

NOMINAL = (8.24, 10.55, 12.43, 14.06)
"""Stiffness at 10, 20, 30, 40 N (method section 1)."""

JOINT_COUNT, MOTOR_COUNT = 2.0 * math.pi / 4000.0, 2.0 * math.pi / 8000.0
"""Counts of the paper's encoders [rad]; they are also the tolerance for ``ideal``, which has exact sensors."""

S_COUNT = 0.721 * MOTOR_COUNT
"""Change of S by one motor count [N·m/rad] (method section 4: 0.721 N·m/rad per rad)."""

LEFT_ALONE_S = 0.01
"""Error of S that the loop of ``lab`` does not correct at rest [N·m/rad], in either direction."""

RELATIVE, COUNTS = {"ideal": 0.03, "lab": 0.06}, {"ideal": 1, "lab": 2}
"""Permitted deviation of a preview: a share of the measured value, or a number of counts."""

_PUSHED_S = 5.0
"""Interval after which a push is repeated [s]; one push lasts at most 10 s."""

_T = TypeVar("_T")


@dataclass(frozen=True)
class Case:
    """A tuning, steps and a push; ``points`` is empty for geometric gains."""

    name: str
    u_plan: float
    lambdas: TuningParameters
    points: tuple[PointModel, ...]
    interpolate: bool
    q: tuple[float, float]
    S: tuple[float, float]
    F_push: float


def cases(seed: int, count: int) -> Iterator[Case]:
    """Yield random cases that alternate parameter sets and motions."""
    random = np.random.default_rng(seed)
    ranges: dict[tuple[str, bool, float], tuple[float, float]] = {}
    for number in range(count):
        name, planned = ("ideal", "lab")[number % 2], number % 4 >= 2
        parameters = load_parameters(name)
        points = bank(parameters) if random.random() < 0.5 else ()
        b = float(random.choice([0.0, 0.0, 0.5, 1.0]))
        if (name, bool(points), b) not in ranges:
            ranges[name, bool(points), b] = TuningPreviewer(parameters, points, b=b).safe_range()
        lam_q, lam_S = (
            float(np.exp(random.uniform(np.log(low), np.log(3.0)))) for low in ranges[name, bool(points), b]
        )
        q = [float(x) for x in random.uniform(-1.3, 1.3, 2)]
        while abs(q[1] - q[0]) < 0.1:
            q[1] = float(random.uniform(-1.3, 1.3))
        S = [float(x) for x in random.uniform(8.0, 15.0, 2)]
        while abs(S[1] - S[0]) < 0.5:
            S[1] = float(random.uniform(8.0, 15.0))
        yield Case(
            name,
            float(random.uniform(4.0, 9.0)) if planned else 0.0,
            TuningParameters(lam_q, lam_S, b=b),
            points,
            bool(random.random() < 0.5),
            (q[0], q[1]),
            (S[0], S[1]),
            float(random.choice([-PUSH_N, PUSH_N])),
        )


def bank(parameters: PlantParameters) -> tuple[PointModel, ...]:
    """Return models at four tensions; friction makes them slower at high tension."""
    at = designed_point(parameters)
    return tuple(
        PointModel(S, at.K_q, at.T_q * (1.0 + 0.03 * index), at.K_S, at.T_S * (1.0 + 0.02 * index))
        for index, S in enumerate(NOMINAL)
    )


class Bench:
    """The control loop on the simulator, with its samples stored."""

    def __init__(self, case: Case) -> None:
        self._rows: list[Array] = []
        self._read = 0
        parameters = load_parameters(case.name)
        tuning = make_tuning_command(parameters, case.lambdas, case.points, None, case.interpolate, case.u_plan)
        self._loop = SimulatedLoop(Simulator(parameters, seed=1), parameters, tuning, self._store)
        self.send(SetMode(Mode.PRETENSION))
        for _ in range(300):
            self.advance(0.1)
            if self._loop._loop.is_pretension_done:
                break
        self.send(SetMode(Mode.RUN, 1))

    def _store(self, ring: Ring) -> None:
        first, rows, missed = ring.read(self._read, 1 << 30)
        assert missed == 0
        self._read = first + len(rows)
        self._rows.append(rows)

    def send(self, command: Command) -> None:
        answer = _run_to_end(self._loop.send(command))
        assert isinstance(answer, Accepted), answer

    def advance(self, seconds: float) -> dict[str, Array]:
        """Advance by ``seconds`` [s] and return the samples by name."""
        self._rows = []
        _run_to_end(self._loop.advance(seconds))
        rows = np.concatenate(self._rows)
        return {name: rows[:, INDEX[name]] for name in ("q", "S", "u_A", "u_B", "F_A", "F_B")}

    def apply_push(self, F_push: float, seconds: float) -> Array:
        """Apply a push [N] for ``seconds`` and return the joint position [rad]."""
        q = []
        while seconds > 0.0:
            self.send(ApplyPush(F_push, min(2.0 * _PUSHED_S, seconds)))
            q.append(self.advance(min(_PUSHED_S, seconds))["q"])
            seconds -= _PUSHED_S
        return np.concatenate(q)

    def close(self) -> None:
        self._loop.close()


def _run_to_end(work: Coroutine[Any, Any, _T]) -> _T:
    """Run a coroutine without an event loop."""
    while True:
        try:
            work.send(None)
        except StopIteration as end:
            return cast(_T, end.value)


def differences(case: Case) -> dict[str, float]:
    """Return the deviation of each predicted metric; 1 is the permitted deviation."""
    parameters, lambdas = load_parameters(case.name), case.lambdas
    previewer = TuningPreviewer(parameters, case.points, b=lambdas.b)
    previewer.require_safe(lambdas, case.u_plan)
    q0, S0 = case.q[0], case.S[0]
    preview = previewer.preview(
        lambdas,
        S0,
        interpolate=case.interpolate,
        u_plan=case.u_plan,
        steps=Steps(case.q, case.S),
        F_push=case.F_push,
    )
    relative, counts = RELATIVE[case.name], COUNTS[case.name]
    loop = make_motor_loops(parameters, lambdas.lam_motor).A
    volts = counts * (loop.k_p + loop.k_d / loop.t_f) * MOTOR_COUNT
    newtons = counts * _steepest(parameters) * parameters.geometry.r_j * JOINT_COUNT
    friction_V = _friction_voltage(parameters, max(case.S))
    bench = Bench(case)
    rest = 4.0 + 16.0 * max(lambdas.lam_q, lambdas.lam_S)  # the slowest pole of a loop is −1/(2 λ)
    bench.send(SetReferences(q0, S0))
    bench.advance(rest)
    found: dict[str, float] = {}
    for signal, predicted, count, size in (
        ("q", preview.step_q, JOINT_COUNT, case.q[1] - q0),
        ("S", preview.step_S, S_COUNT if case.name == "ideal" else LEFT_ALONE_S, case.S[1] - S0),
    ):
        bench.send(SetReferences(*((case.q[1], S0) if signal == "q" else (q0, case.S[1]))))
        lam = lambdas.lam_q if signal == "q" else lambdas.lam_S
        run = bench.advance(2.0 + (3.0 if case.u_plan else 9.0) * lam)
        y = (run[signal] - predicted.start) / size
        step_counts = counts * count / abs(size)
        overshoot = 100.0 * max(y.max() - 1.0, 0.0)
        voltage = max(float(np.abs(run[u]).max()) for u in ("u_A", "u_B"))
        tension = min(float(run[F].min()) for F in ("F_A", "F_B"))
        t90_s = float(np.argmax(y >= 0.9)) * T_s if (y >= 0.9).any() else math.nan
        found |= {
            f"t90 {signal}": _deviation(predicted.t90_s, t90_s, relative * t90_s),
            f"settling {signal}": _time_deviation(predicted.settling_s, np.abs(y - 1.0), BAND, step_counts, relative),
            f"overshoot {signal}": _deviation(
                predicted.overshoot_percent, overshoot, max(relative * overshoot, 100.0 * step_counts)
            ),
            f"voltage {signal}": _deviation(
                predicted.peak_voltage, voltage, max(relative * voltage, volts) + (friction_V if signal == "S" else 0.0)
            ),
            f"tension {signal}": _deviation(predicted.least_tension, tension, max(relative * tension, newtons)),
        }
        bench.send(SetReferences(q0, S0))
        bench.advance(rest)
    bench.send(SetReferences(0.0, S0))
    bench.advance(rest)
    off = np.abs(bench.apply_push(case.F_push, 2.0 + 9.0 * lambdas.lam_q))
    bench.close()
    predicted_push, deflection = preview.pushes[0], float(off.max())
    found["give"] = _deviation(predicted_push.deflection, deflection, max(relative * deflection, counts * JOINT_COUNT))
    found["back"] = _time_deviation(predicted_push.recovery_s, off, NEAR_RAD, counts * JOINT_COUNT, relative)
    return found


def _deviation(predicted: float, measured: float, allowed: float) -> float:
    if math.isnan(predicted) or math.isnan(measured):
        return 0.0 if math.isnan(predicted) and math.isnan(measured) else math.inf
    return abs(predicted - measured) / allowed


def _time_deviation(predicted: float, away: Array, band: float, count: float, relative: float) -> float:
    """Return the deviation of the time from which ``away`` stays within ``band``."""
    soonest, latest = _time_within(away, band + count), _time_within(away, band - count)
    if math.isnan(predicted):
        return 0.0 if math.isnan(latest) else math.inf
    if math.isnan(soonest):
        return math.inf
    middle = min(max(predicted, soonest), predicted if math.isnan(latest) else latest)
    return abs(predicted - middle) / (relative * middle) if middle > 0.0 else predicted / T_s


def _time_within(away: Array, band: float) -> float:
    """Return the time [s] from which ``away`` stays within ``band``, or nan."""
    outside = np.flatnonzero(~(away <= band + 1e-9))
    last = int(outside[-1]) + 1 if outside.size else 0
    return last * T_s if last < away.size else math.nan


def _steepest(parameters: PlantParameters) -> float:
    """Return the slope of the spring at 10 N [N/m], which is near the least tensions."""
    _, k1, k2 = parameters.identified.k[:3]
    return math.sqrt(k1**2 + 4.0 * k2 * (10.0 - parameters.identified.k[0]))


def _friction_voltage(parameters: PlantParameters, S: float) -> float:
    """Return the voltage [V] of the Coulomb friction of a motor at rest at S.

    A slow step of S needs little more than the voltage at rest, which depends on the previous motion of the motors.
    """
    geometry, motor, (k0, k1, k2) = parameters.geometry, parameters.motor, parameters.identified.k[:3]
    x = (S / (2.0 * geometry.r_j**2) - k1) / (2.0 * k2)
    return (motor.c0 + motor.c1 * geometry.r_m * (k0 + k1 * x + k2 * x**2)) / motor.K_t
