"""What was run, by name and in words, from what a stored run was set to."""

import json

from backend.documents.edge import UnreadableDocumentError
from backend.plain_text import as_line
from backend.storage.runs import Run, RunKind


def title_of(run: Run) -> str:
    """Return what was run, in words on one line; of an experiment that is data its own title."""
    if run.kind != RunKind.EXPERIMENT:
        return run.kind.replace("_", " ").capitalize()
    return as_line(_written(run, "title")) or "Experiment that cannot be read"


def experiment_of(run: Run) -> str:
    """Return what was run as it is called when it is ordered, "" where that cannot be read."""
    return _written(run, "name") if run.kind == RunKind.EXPERIMENT else run.kind


def _written(run: Run, part: str) -> str:
    """Return a part of the experiment that a run has kept, "" where it cannot be read."""
    try:
        return str(json.loads(run.set_to.experiment or "")[part])
    except (UnreadableDocumentError, ValueError, KeyError, TypeError):
        return ""
