"""What the controller is told of motors and springs in place of what the parameter file says. Pure."""

from dataclasses import dataclass

from backend.documents.edge import Edge
from backend.documents.plant_numbers import PlantNumbers

VERSION = 1


@dataclass(frozen=True, kw_only=True)
class AppliedParameters:
    """Sections ``identified``, ``identified_A`` and ``identified_B`` as they came into force; empty: those of the file.

    ``base`` tells the numbers of the file that they are put over. ``estimate`` is the stored identification they came
    from and ``run`` its run, 0 for none; with ``undone`` the former ones were put back.
    """

    base: str
    identified: PlantNumbers
    estimate: int = 0
    run: int = 0
    undone: bool = False
    version: int = VERSION


APPLIED: Edge[AppliedParameters] = Edge(AppliedParameters, "what was applied to the parameters", VERSION)
