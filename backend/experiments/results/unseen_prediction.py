"""Identified models beside a record that they have not seen: what was measured, and what they say of it.

An actuator is judged on the last third of a record, a motor on each of its voltage steps. On the record that an
identification itself came from, its structure is fitted anew without what is predicted: to the first two thirds, or to
all other steps.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from backend.experiments.plans.plan import ActuatorIdentificationPlan
from backend.experiments.plans.stored_plan import stored_plan
from backend.experiments.results.actuator_identification import excitation_start
from backend.experiments.results.metrics import NoSamplesError
from backend.experiments.results.motor_identification import side_steps
from backend.identification.estimation import Beside, fit_percent, held_out, last_part, predict, seen_samples
from backend.identification.fitting import Method, fit
from backend.identification.models import Model, structure
from backend.identification.motor import VoltageStep, identify_motor, step_beside
from backend.identification.records import IdentificationError, Record
from backend.models.document import Document
from backend.models.identification import CHANNELS, ChannelModel
from backend.recording.reader import Columns, recorded_columns
from backend.storage import identifications, runs
from backend.storage.database import Database
from backend.storage.identifications import Identification
from backend.storage.runs import Run
from plant.interface import T_s
from plant.parameters import SIDES, PlantParameters, Side, parameters_of

POINTS = 400
"""At most so many samples of a stretch are drawn, evenly spaced; fit and residual are those of all."""

OUTPUTS = {"G_q": ("q", "rad"), "G_S": ("S", "N·m/rad")}


class NotComparableError(ValueError):
    """An identification and a record of which the one says nothing about the other."""


@dataclass(frozen=True)
class _Stretch:
    label: str
    t: NDArray[np.float64]
    beside: Beside


def unseen_of(database: Database, run_id: int, of: int) -> Document:
    """Set the newest estimate of a run beside the record of the run ``of``.

    Raises UnknownRecordError, NotComparableError.
    """
    with database.reading() as session:
        estimate, source = identifications.of_run(session, run_id), runs.get(session, of)
    kind = source.kind.removesuffix("_identification")
    if estimate.kind != kind or kind not in ("actuator", "motor"):
        raise NotComparableError(
            f"identification {run_id} is of kind {estimate.kind}, run {of} of kind {source.kind}: a model is compared "
            "with the record of an actuator or motor identification of its own kind"
        )
    columns, _ = recorded_columns(database, of)
    parameters = parameters_of(source.parameters_name, source.parameters)
    own = run_id == of
    outputs = _channels(estimate, source, columns, own=own) if kind == "actuator" else None
    listed = list(outputs or _motors(estimate, columns, parameters, own=own))
    return {"run": run_id, "of": of, "own": own, "kind": kind, "outputs": listed}


def _channels(estimate: Identification, source: Run, columns: Columns, *, own: bool) -> Iterator[Document]:
    plan = stored_plan(source.kind, source.set_to.plan or {})
    if not isinstance(plan, ActuatorIdentificationPlan):
        raise NotComparableError(f"run {source.id} has no excitation")
    for name in CHANNELS:
        signal, unit = OUTPUTS[name]
        try:
            start = excitation_start(columns, plan.excitation())
            record = Record(T_s, columns["theta_A_ref"][start:], columns[signal][start:])
            method = Method(estimate.actuator_options.estimator or Method.DEFAULT)
            shown = _of_channel(estimate.actuator.channel(name).model, record, method, own=own)
            first = start + seen_samples(record) + shown.first
            yield _output(name, signal, unit, [_Stretch("", columns["t"][first : first + shown.measured.size], shown)])
        except (IdentificationError, NoSamplesError, np.linalg.LinAlgError) as error:
            yield _nothing(name, signal, unit, str(error))


def _of_channel(model: ChannelModel, record: Record, method: Method, *, own: bool) -> Beside:
    if own:
        return held_out(fit(record, structure(model.structure), method))
    return predict(Model(model.structure, model.parameters), last_part(record))


def _motors(
    estimate: Identification, columns: Columns, parameters: PlantParameters, *, own: bool
) -> Iterator[Document]:
    for side in SIDES:
        try:
            steps = side_steps(columns, side, parameters).steps
            shown = [_of_step(estimate, side, steps, number, own=own) for number in range(len(steps))]
            yield _output(side, f"theta_{side}", "rad", shown)
        except (IdentificationError, NoSamplesError) as error:
            yield _nothing(side, f"theta_{side}", "rad", str(error))


def _of_step(
    estimate: Identification, side: Side, steps: tuple[VoltageStep, ...], number: int, *, own: bool
) -> _Stretch:
    step = steps[number]
    if own:
        found = identify_motor([other for other in steps if other is not step])
        known = found.K_m, found.T_m, found.u_c
    else:
        kept = estimate.motors.side(side).model.parameters
        if kept.K_m is None or kept.T_m is None or kept.u_c is None:
            raise IdentificationError(f"K_m, T_m or u_c of motor {side} was not found: evaluate that run again")
        known = kept.K_m, kept.T_m, kept.u_c
    shown = step_beside(step, *known)
    return _Stretch(f"{step.voltage:.3g} V", np.asarray(np.arange(shown.measured.size) * T_s), shown)


def _output(name: str, signal: str, unit: str, stretches: list[_Stretch]) -> Document:
    if not stretches:
        return _nothing(name, signal, unit, "the record holds nothing to compare with")
    each = [stretch.beside for stretch in stretches]
    error = np.concatenate([item.measured - item.predicted for item in each])
    motion = np.concatenate([item.measured - np.mean(item.measured) for item in each])
    return {
        "name": name,
        "signal": signal,
        "unit": unit,
        "fit_percent": fit_percent(error, motion),
        "rms": float(np.sqrt(np.mean(error**2))),
        "samples": int(error.size),
        "problem": "",
        "stretches": [_drawn(stretch) for stretch in stretches],
    }


def _drawn(stretch: _Stretch) -> Document:
    every = slice(None, None, max(1, -(-stretch.t.size // POINTS)))
    columns = {"t": stretch.t, "measured": stretch.beside.measured, "predicted": stretch.beside.predicted}
    return {"label": stretch.label, **{name: column[every].tolist() for name, column in columns.items()}}


def _nothing(name: str, signal: str, unit: str, problem: str) -> Document:
    figures: Document = {"fit_percent": None, "rms": None, "samples": 0, "stretches": []}
    return {"name": name, "signal": signal, "unit": unit, "problem": problem, **figures}
