"""An experiment made of what was recorded: the references of a run, as they were commanded."""

import json

from backend.documents.experiment import FORMAT
from backend.experiments.composing.recorded import followed
from backend.messages.own_experiment import RecordedExperiment
from backend.recording.reader import read_samples
from backend.storage import Database


def recorded_experiment(database: Database, run_id: int) -> RecordedExperiment:
    """Return the references of a run as an experiment of its own.

    Raises UnknownRecordError, ExperimentError where there are none to follow.
    """
    with database.reading() as session:
        columns = read_samples(session, run_id, ("q_ref", "S_ref")).columns
    found = followed(columns["q_ref"].astype(float), columns["S_ref"].astype(float))
    off = f"{found.off_q_rad:.2g} rad and {found.off_S:.2g} N·m/rad"
    document = {
        "format": FORMAT,
        "name": f"as_run_{run_id}",
        "title": f"As run {run_id}",
        "description": f"The references of run {run_id} as they were commanded, followed within {off} at every sample. "
        "The tuning is the one in force when this is played.",
        "phases": [{"name": "recorded", "title": "Recorded", "parts": found.parts}],
    }
    return RecordedExperiment(text=json.dumps(document, ensure_ascii=False, indent=1), document=document, left_out=[])
