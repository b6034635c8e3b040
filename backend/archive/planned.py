"""What a stored run was going to play, from begin to end."""

import asyncio
import math

from backend.documents.edge import UnreadableDocumentError
from backend.experiments.plans.profile import profile
from backend.experiments.plans.stored_plan import stored_plan
from backend.messages.history import Planned, PlannedPart
from backend.recording.reader import read_samples
from backend.storage import Database, Session, runs
from backend.storage.records import UnknownRecordError
from plant.interface import T_s

NOTHING = Planned(t=[], q_ref=[], S_ref=[], parts=[])


class PlannedRuns:
    """Reads plans of runs in threads."""

    def __init__(self, database: Database) -> None:
        self._database = database

    async def of(self, run_id: int) -> Planned:
        """Return the references that a run was to follow. Raises UnknownRecordError, SettingError, ExperimentError."""
        return await asyncio.to_thread(self._of, run_id)

    def _of(self, run_id: int) -> Planned:
        with self._database.reading() as session:
            run = runs.get(session, run_id)
            began = _references_at_first(session, run_id)
        try:
            kept = run.set_to.plan
        except UnreadableDocumentError:
            return NOTHING
        if kept is None:
            return NOTHING
        plan = stored_plan(run.kind, kept)
        program = plan.program()
        if not program.segments:
            return NOTHING
        first = program.segments[0]
        found = profile(program, *(began or (first.q_ref, first.S_ref)))
        return Planned(
            t=found.t.tolist(),
            q_ref=found.q_ref.tolist(),
            S_ref=found.S_ref.tolist(),
            parts=[PlannedPart(title=part.title, start_s=part.start_s, end_s=part.end_s) for part in plan.phases()],
        )


def _references_at_first(session: Session, run_id: int) -> tuple[float, float] | None:
    """Return the references that a run began with; None while nothing of it is recorded, or there were none."""
    try:
        samples = read_samples(session, run_id, ("q_ref", "S_ref"), 0.0, T_s)
    except UnknownRecordError:
        return None
    if not len(samples.t):
        return None
    q_ref, S_ref = float(samples.columns["q_ref"][0]), float(samples.columns["S_ref"][0])
    return (q_ref, S_ref) if math.isfinite(q_ref) and math.isfinite(S_ref) else None
