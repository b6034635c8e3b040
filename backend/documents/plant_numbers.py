"""The numbers of a plant as a run keeps them (``PlantParameters.document``), by section and entry. Pure."""

from dataclasses import dataclass
from typing import Any

from backend.documents.edge import Edge


@dataclass(frozen=True)
class PlantNumber:
    """A number, or a list of points, in its unit, and where it comes from."""

    value: Any
    unit: str = ""
    source: str = ""


PlantNumbers = dict[str, dict[str, PlantNumber]]

PLANT_NUMBERS: Edge[PlantNumbers] = Edge(PlantNumbers, "numbers of its plant", 0)
