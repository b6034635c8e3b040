"""What a stored run was set to, each setting with symbol, unit and meaning: for page and report. Pure."""

from collections.abc import Mapping
from typing import Any

from backend.documents.edge import Document
from backend.experiments.banks.tuning_choice import DECLARED


def used_settings(stored: Mapping[str, Any]) -> list[Document]:
    """Return the settings of a run in order, from what is stored of them.

    Programs store them declared. A session has a tuning only; older ones have it beside their mode.
    """
    declared: list[Document] | None = stored.get("declared")
    if declared is not None:
        return declared
    tuning = stored.get("loop", stored)
    return [
        {
            "name": setting.name,
            "symbol": setting.symbol,
            "unit": setting.unit,
            "meaning": setting.meaning,
            "value": tuning[setting.name],
        }
        for setting in DECLARED
        if tuning.get(setting.name) is not None
    ]
