"""Beside a run in time-optimal motion: what lambda motion, the paper's law, would have made of its references."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from backend.analysis.evaluation import law_of
from backend.banks.builder import BankError, points_of
from backend.banks.tuning_settings import TuningChoice
from backend.models.run import StepFigures
from backend.realtime.program import Law
from backend.reports.document import Column, Table, shown
from backend.reports.drawing import axis_label
from backend.reports.judgement import measured
from backend.reports.source import Source
from backend.tuning.gains import TuningError, cascade_tuning
from backend.tuning.simulation import run
from backend.units import Angles, read
from plant.interface import T_s
from plant.parameters import ParameterError, parameters_of

Array = NDArray[np.float64]
UNITS = {"q": "rad", "S": "N·m/rad"}

GOVERNOR = (
    "For comparison: the same references with the governor of the paper (lambda motion) in place of the trajectory, "
    "all else alike: simulated with the run's own parameters, gains, push and seed, from rest at its first references. "
    "It is no measurement. With the trajectory the lags of the loops do not delay a reference; λ sets how deviations "
    "of the actuator from its model are corrected (docs/decisions/0046)."
)


@dataclass(frozen=True)
class PapersLaw:
    """The paper's law on the references of a run: ``columns`` q and S, each (n,), over t; empty with a ``reason``."""

    columns: Mapping[str, Array] = field(default_factory=dict)
    reason: str = ""


def papers_law(source: Source) -> PapersLaw | None:
    """Simulate a run's references under the paper's law; None where that is what the run had, or another law."""
    settings = source.run.set_to
    if settings.loop.budget == 0.0 or law_of(source.run) != Law.CASCADE:
        return None
    columns = source.columns
    t, known = columns["t"], settings.loop.known()
    if np.any(np.abs(np.diff(t) - T_s) > 0.5 * T_s):
        return PapersLaw(reason="samples are missing")
    if any(np.ptp(columns[f"lam_{name}"]) > 1e-6 for name in ("q", "S")):
        return PapersLaw(reason="λ was changed during the run")
    try:
        parameters = parameters_of(source.run.parameters_name, source.run.parameters)
        choice = TuningChoice.of(known)
        tuning = cascade_tuning(parameters, choice.lambdas, points_of(source.bank), None, choice.interpolate)
    except (BankError, TuningError, ParameterError) as error:
        return PapersLaw(reason=str(error))
    push = columns["F_push"] if np.all(np.isfinite(columns["F_push"])) else None
    found = run(parameters, tuning, columns["q_ref"], columns["S_ref"], push, int(settings.loop.seed or 0))
    if found.tripped_at >= 0:
        return PapersLaw(reason=f"with it the safety module would have tripped after {found.tripped_at * T_s:g} s")
    return PapersLaw({"t": t, "q": found.q, "S": found.S})


def beside(steps: Sequence[StepFigures], law: PapersLaw, angles: Angles) -> tuple[Table, ...]:
    """Return a table of each step's time to 90 % as it was measured and as the paper's law would have taken it."""
    if not law.columns or not steps:
        return ()
    rows = []
    for step in steps:
        unit, theirs = UNITS[step.signal], _to_90_percent_s(step, law)
        gain = None if theirs is None or not step.reach_s else theirs / step.reach_s
        rows.append(
            (
                axis_label(step.signal, unit, angles),
                shown(read(step.before, unit, angles)),
                shown(read(step.after, unit, angles)),
                measured(step.reach_s),
                measured(theirs),
                measured(gain, 2),
            )
        )
    columns = (
        Column("Step", number=False),
        Column("from"),
        Column("to"),
        Column("To 90 %, measured", "s"),
        Column("To 90 %, the paper's law", "s"),
        Column("paper's law / measured"),
    )
    caption = "Time from a step to 90 % of its way, beside what it takes with the paper's governor (simulated)."
    return (Table(caption, columns, tuple(rows)),)


def _to_90_percent_s(step: StepFigures, law: PapersLaw) -> float | None:
    """Return from a step to 90 % of its way [s]; None where it does not get there before the next one."""
    t = law.columns["t"]
    inside = slice(*np.searchsorted(t, [step.start_s - 1e-9, step.end_s - 1e-9]))
    way = (law.columns[step.signal][inside] - step.before) / (step.after - step.before)
    there = np.flatnonzero(way >= 0.9)
    return float(t[inside][there[0]] - step.start_s) if there.size else None
