"""What a stored run was going to play, from begin to end."""

import math

import numpy as np
from numpy.typing import NDArray

from backend.experiments.forecast import timetable
from backend.experiments.library import stored_plan
from backend.experiments.plans import IdentificationPlan, profile
from backend.models.document import UnreadableDocumentError
from backend.recording.reader import read_samples
from backend.sample import FIELDS
from backend.schemas.run import Planned, PlannedLine, PlannedPart
from backend.storage import runs
from backend.storage.database import Database, Session
from backend.storage.orm import UnknownRecordError
from plant.interface import T_s
from plant.parameters import ParameterError, parameters_of

NOTHING = Planned(t=[], lines=[], parts=[])
_UNITS = {field.name: field.unit for field in FIELDS}


def planned(database: Database, run_id: int) -> Planned:
    """Return what a run was to play; its plan may be an imported text, so that it is read beside the service.

    Raises UnknownRecordError, SettingError, OutOfRangeError, ExperimentError.
    """
    with database.reading() as session:
        run = runs.get(session, run_id)
        try:
            kept = run.set_to.plan
        except UnreadableDocumentError:
            return NOTHING
        if kept is None:
            return NOTHING
        plan = stored_plan(run.kind, kept)
        followed = ("theta_A_ref", "theta_B_ref") if isinstance(plan, IdentificationPlan) else ("q_ref", "S_ref")
        began = _at_first(session, run_id, *followed)
    if isinstance(plan, IdentificationPlan):
        try:
            told = timetable(plan, parameters_of(run.parameters_name, run.parameters), began)
        except ParameterError:
            return NOTHING
        parts = [
            PlannedPart(title=f"{told.title(one)}, {one.stage}", start_s=one.begin * T_s, end_s=one.end * T_s)
            for one in told.stretches
        ]
        return Planned(t=told.t.tolist(), lines=_lines(told.signals), parts=parts)
    program = plan.program()
    if not program.segments:
        return NOTHING
    first = program.segments[0]
    found = profile(program, *(began or (first.q_ref, first.S_ref)))
    pushed = {"F_push": found.F_push} if found.F_push.any() else {}
    return Planned(
        t=found.t.tolist(),
        lines=_lines({"q_ref": found.q_ref, "S_ref": found.S_ref, **pushed}),
        parts=[PlannedPart(title=part.title, start_s=part.start_s, end_s=part.end_s) for part in plan.phases()],
    )


def _lines(signals: dict[str, NDArray[np.float64]]) -> list[PlannedLine]:
    return [
        PlannedLine(
            name=name,
            unit=_UNITS[name],
            values=[value if math.isfinite(value) else None for value in values.tolist()],
        )
        for name, values in signals.items()
    ]


def _at_first(session: Session, run_id: int, one: str, other: str) -> tuple[float, float] | None:
    """Return the references that a run began with; None while nothing of it is recorded, or there were none."""
    try:
        samples = read_samples(session, run_id, (one, other), 0.0, T_s)
    except UnknownRecordError:
        return None
    if not len(samples.t):
        return None
    values = float(samples.columns[one][0]), float(samples.columns[other][0])
    return values if math.isfinite(sum(values)) else None
