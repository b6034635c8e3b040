"""Files of runs taken in, each checked as strictly as what comes by a request: characters, bounds, the plan itself."""

import json
from pathlib import Path

from backend.errors import OutOfRangeError
from backend.experiments import parser
from backend.experiments.library import stored_plan
from backend.experiments.parser import ExperimentError
from backend.experiments.plans import LoopSettings
from backend.exports import importer
from backend.exports.base import ImportRefusedError
from backend.exports.importer import TakenIn
from backend.models.document import UnreadableDocumentError
from backend.models.settings import SettingError
from backend.plain_text import as_line
from backend.storage.database import Database
from backend.storage.runs import Run

_LONGEST_EXPERIMENT = 4 * parser.MAX_CHARACTERS
"""Characters of an experiment as a run keeps it: its JSON has more of them than the YAML that was sent."""


def take_in(database: Database, file: Path, who: str, folder: Path, name: str = "") -> TakenIn:
    """Store the run of a file, a bundle (.zip) or an export, whole or not at all; ``name`` is what it is called.

    ``folder`` has room for a bundle unpacked. Raises ImportRefusedError, OSError.
    """
    called = as_line(name or file.name)
    if file.suffix.lower() == ".zip":
        return importer.import_bundle(database, file, who, folder, called, look_over)
    return importer.import_export(database, file, who, called, look_over)


def look_over(run: Run) -> None:
    """Raise ImportRefusedError for a run whose plan or tuning no request could have ordered."""
    try:
        kept = run.set_to
        if kept.experiment is not None:
            _require_experiment(kept.experiment)
        if kept.plan is not None:
            stored_plan(run.kind, kept.plan)
        LoopSettings.of(kept.loop.known())
    except (ExperimentError, SettingError, OutOfRangeError, UnreadableDocumentError, KeyError) as error:
        raise ImportRefusedError(
            f"its plan: {as_line(error)}; correct the experiment and run it again, or export the run with "
            f"Sinew {as_line(run.software)}, which recorded it, and read the samples from the file"
        ) from None


def _require_experiment(kept: str) -> None:
    """Raise ExperimentError for an experiment that would not be accepted if somebody sent it now."""
    if len(kept) > _LONGEST_EXPERIMENT:
        raise ExperimentError(f"the experiment has {len(kept)} characters, at most {_LONGEST_EXPERIMENT} are accepted")
    try:
        parser.of_document(json.loads(kept), {})
    except (ValueError, RecursionError) as error:
        if isinstance(error, ExperimentError):
            raise
        raise ExperimentError(f"the experiment is not JSON: {error}") from None
