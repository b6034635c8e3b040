"""Which plant is to be driven, as one says it at the start and as every run remembers it."""

from dataclasses import dataclass
from enum import StrEnum

DEFAULT_WIRING = "pcie-6323"

NAME_MAX = 100
"""Longest name of a plant [characters]: every run remembers it whole."""

FILE_NAME_MAX = 200
"""Longest name of a file with parameters or a wiring [characters], without its ending: runs remember it whole."""


class PlantKind(StrEnum):
    """What is behind the Plant interface."""

    SIMULATOR = "simulator"
    RIG = "rig"
    VIRTUAL_CARD = "virtual_card"
    REPLAY = "replay"
    PACKAGE = "package"


@dataclass(frozen=True)
class PlantChoice:
    """One plant: ``wiring`` and ``address`` (of a device server) count for a card, the others for their kind.

    ``recording`` is a file, ``package`` the name of an entry point of the group ``sinew.plants``.
    """

    kind: PlantKind = PlantKind.SIMULATOR
    wiring: str = DEFAULT_WIRING
    address: str = ""
    recording: str = ""
    package: str = ""

    @property
    def name(self) -> str:
        """What a run remembers, and what stands on badge, report and export."""
        return self.package if self.kind is PlantKind.PACKAGE else str(self.kind).replace("_", " ")

    @property
    def simulated(self) -> bool:
        """Whether what moves is computed: it can be pushed, and broken to order."""
        return self.kind in (PlantKind.SIMULATOR, PlantKind.VIRTUAL_CARD)


SIMULATOR = PlantChoice()

SIMULATED = frozenset(choice.name for kind in PlantKind if (choice := PlantChoice(kind)).simulated)
"""Names of the plants of which every run has a seed."""
