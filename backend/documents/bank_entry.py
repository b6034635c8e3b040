"""The models of one entry of a bank: first order, from θ_ref to q and to S, and the tension [N] they were found at."""

from dataclasses import dataclass, field

from backend.documents.edge import ABSENT, Edge

VERSION = 1


@dataclass(frozen=True, kw_only=True)
class EntryModel:
    """K_q [rad/rad], T_q [s], K_S [N·m/rad per rad], T_S [s]; None where an imported entry does not say."""

    K_q: float | None = field(default=None, metadata=ABSENT)
    T_q: float | None = field(default=None, metadata=ABSENT)
    K_S: float | None = field(default=None, metadata=ABSENT)
    T_S: float | None = field(default=None, metadata=ABSENT)
    tension_N: float | None = field(default=None, metadata=ABSENT)
    version: int = VERSION


ENTRY: Edge[EntryModel] = Edge(EntryModel, "its models", VERSION)
