"""What a stored run was set to, each setting with symbol, unit and meaning: for page and report. Pure."""

from collections.abc import Sequence

from backend.documents.run_settings import DeclaredValue, RunSettings
from backend.experiments.banks.tuning_choice import DECLARED


def used_settings(stored: RunSettings) -> Sequence[DeclaredValue]:
    """Return the settings of a run in order. Programs store them declared; a session has a tuning only."""
    if stored.declared is not None:
        return stored.declared
    tuning = stored.loop.known()
    return [
        DeclaredValue(setting.name, setting.symbol, setting.unit, setting.meaning, tuning[setting.name])
        for setting in DECLARED
        if setting.name in tuning
    ]
