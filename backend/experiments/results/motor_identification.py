"""From the samples of voltage steps to K_m, T_m and dry friction of both motors, with their lineage."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass

import numpy as np
from numpy.typing import NDArray

from backend.experiments.plans.identification_plans import MotorIdentificationPlan
from backend.experiments.results.metrics import NoSamplesError, figure
from backend.identification.models import Grade
from backend.identification.motor import MotorIdentification, VoltageStep, identify_motor, steady_speed, turn_from_rest
from backend.identification.records import IdentificationError, RecordError
from backend.models.identification import (
    MOTOR_MODELS,
    MOTOR_QUALITIES,
    Fitted,
    MotorModel,
    MotorModels,
    MotorQualities,
    MotorQuality,
    Pair,
    RefusedStep,
    RuleStep,
    StepCurve,
)
from backend.storage.identifications import NewIdentification
from backend.storage.runs import Run
from plant.interface import T_s
from plant.parameters import SIDES, PlantParameters, Side

Array = NDArray[np.float64]
Columns = Mapping[str, Array]

COUNTS_WHERE_EXACT = 8000
"""Counts per turn of the paper's motor encoder, used where a parameter set has ideal sensors."""

_CURVE_POINTS = 120


@dataclass(frozen=True)
class SideSteps:
    """Steps of one motor that can be used, and why the others cannot: (voltage [V], reason)."""

    steps: tuple[VoltageStep, ...]
    refused: tuple[tuple[float, str], ...]


@dataclass(frozen=True)
class MotorFigures:
    """What came out for both motors, and what they went through."""

    K_m_A: float = figure("rad/(V·s)", "K_m of motor A", "least squares on position over all steps")
    K_m_B: float = figure("rad/(V·s)", "K_m of motor B", "least squares on position over all steps")
    T_m_A: float = figure("s", "T_m of motor A", "least squares on position over all steps")
    T_m_B: float = figure("s", "T_m of motor B", "least squares on position over all steps")
    u_c_A: float = figure("V", "Coulomb voltage of motor A", "part of the voltage that only overcomes dry friction")
    u_c_B: float = figure("V", "Coulomb voltage of motor B", "part of the voltage that only overcomes dry friction")
    turn_rad: float = figure("rad", "Largest turn", "largest |θ| of both motors, of ±15.7 rad")
    load_N: float = figure("N", "Largest load", "largest tendon force of both load cells during the steps")
    peak_voltage_V: float = figure("V", "Peak voltage", "largest step of both motors")


def stretches(columns: Columns) -> list[slice]:
    """Return where the motors were driven without position loop: zero volts, a step, braking."""
    open_loop = np.isnan(columns["theta_A_ref"])
    edges = np.flatnonzero(np.diff(np.concatenate(([False], open_loop, [False])).astype(int)))
    return [slice(int(first), int(end)) for first, end in zip(edges[::2], edges[1::2], strict=True)]


def side_steps(columns: Columns, side: Side, parameters: PlantParameters) -> SideSteps:
    """Cut the run into the steps of one motor; a step that cannot be used is kept with its reason.

    Raises NoSamplesError where the run holds no step.
    """
    steps: list[VoltageStep] = []
    refused: list[tuple[float, str]] = []
    for stretch in stretches(columns):
        u = columns[f"u_{side}"][stretch]
        driven = np.flatnonzero(u)
        if not driven.size:
            continue
        voltage, first = float(u[driven[0]]), int(driven[0])
        changed = np.flatnonzero(u[first:] != u[first])
        end = first + int(changed[0]) if changed.size else u.size
        try:
            steps.append(
                VoltageStep(
                    T_s,
                    u[:end],
                    columns[f"theta_{side}"][stretch][:end],
                    parameters.motor_of(side).u_max,
                    _count_rad(parameters),
                    columns[f"F_{side}"][stretch][:end],
                )
            )
        except RecordError as error:
            refused.append((voltage, str(error)))
    if not steps and not refused:
        raise NoSamplesError("the run holds no voltage step")
    return SideSteps(tuple(steps), tuple(refused))


def identify(columns: Columns, parameters: PlantParameters) -> dict[Side, tuple[SideSteps, MotorIdentification]]:
    """Identify both motors. Raises NoSamplesError, IdentificationError naming the motor."""
    found: dict[Side, tuple[SideSteps, MotorIdentification]] = {}
    for side in SIDES:
        cut = side_steps(columns, side, parameters)
        try:
            found[side] = cut, identify_motor(cut.steps)
        except IdentificationError as error:
            raise ValueError("; ".join([f"motor {side}: {error}", *(reason for _, reason in cut.refused)])) from None
    return found


def figures_of(columns: Columns, found: Mapping[Side, tuple[SideSteps, MotorIdentification]]) -> MotorFigures:
    """Return what came out and what the motors went through."""
    driven = stretches(columns)
    A, B = (found[side][1] for side in SIDES)
    return MotorFigures(
        K_m_A=A.K_m,
        K_m_B=B.K_m,
        T_m_A=A.T_m,
        T_m_B=B.T_m,
        u_c_A=A.u_c,
        u_c_B=B.u_c,
        turn_rad=max(float(np.abs(columns[f"theta_{side}"]).max()) for side in SIDES),
        load_N=max(float(columns[f"F_{side}"][stretch].max()) for side in SIDES for stretch in driven),
        peak_voltage_V=max(abs(step.voltage) for side in SIDES for step in found[side][0].steps),
    )


def to_store(
    run: Run,
    plan: MotorIdentificationPlan,
    found: Mapping[Side, tuple[SideSteps, MotorIdentification]],
    parameters: PlantParameters,
    software: str,
) -> NewIdentification:
    """Return both motors as they are stored: model, quality, and which samples they came from."""
    verdicts = {side: result.verdict for side, (_, result) in found.items()}
    return NewIdentification(
        kind="motor",
        run_id=run.id,
        data={"input": "u", "outputs": ["theta_A", "theta_B"], "period_s": T_s},
        method="least squares on position",
        options=asdict(plan),
        model=MOTOR_MODELS.write(
            MotorModels(A=_model(found["A"][1], parameters, "A"), B=_model(found["B"][1], parameters, "B"))
        ),
        quality=MOTOR_QUALITIES.write(MotorQualities(A=_quality(*found["A"]), B=_quality(*found["B"]))),
        usable=all(verdict.grade is not Grade.UNUSABLE for verdict in verdicts.values()),
        verdict=" ".join(f"Motor {side}: {verdict.sentence}" for side, verdict in verdicts.items()),
        who=run.who,
        software=software,
    )


def _model(result: MotorIdentification, parameters: PlantParameters, side: Side) -> MotorModel:
    known = parameters.identified_of(side)
    return MotorModel(
        parameters=Fitted(result.K_m, result.T_m, result.u_c),
        std_errors=Fitted(*result.std_errors),
        coulomb=result.coulomb,
        rule=tuple(RuleStep(**asdict(item)) for item in result.rule),
        rule_mean=Pair(*result.rule_mean),
        rule_spread=Pair(*result.rule_spread),
        before=Pair(known.K_m, known.T_m),
    )


def _quality(cut: SideSteps, result: MotorIdentification) -> MotorQuality:
    return MotorQuality(
        rms_counts=result.rms_counts,
        grade=result.verdict.grade,
        verdict=result.verdict.sentence,
        refused=tuple(RefusedStep(voltage, reason) for voltage, reason in cut.refused),
        steps=tuple(_curve(step, result) for step in cut.steps),
    )


def _curve(step: VoltageStep, result: MotorIdentification) -> StepCurve:
    """Return a few points of a step as measured and as the model says, to draw: t [s], turn [rad]."""
    t = np.arange(step.u.size - step.first) * step.period_s
    model = turn_from_rest(t, steady_speed(step.voltage, result.K_m, result.u_c), result.T_m)
    turned = step.theta[step.first :] - step.theta[step.first]
    shown = np.unique(np.linspace(0, t.size - 1, _CURVE_POINTS).astype(int))
    return StepCurve(
        voltage=step.voltage,
        t=_listed(t[shown]),
        measured=_listed(turned[shown]),
        model=_listed((model + np.mean(turned - model))[shown]),
    )


def _listed(values: Sequence[float] | Array) -> tuple[float, ...]:
    return tuple(round(float(value), 6) for value in values)


def _count_rad(parameters: PlantParameters) -> float:
    return 2.0 * math.pi / (round(parameters.sensors.motor_counts) or COUNTS_WHERE_EXACT)
