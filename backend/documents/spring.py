"""What a spring identification found of both springs, or of a table: polynomials F = k_0 + k_1 x + … of several orders.

Elongations in m, forces in N.
"""

from dataclasses import dataclass, field

from backend.documents.edge import ABSENT, Edge, UnreadableDocumentError

VERSION = 1


@dataclass(frozen=True)
class SpringFit:
    """A polynomial of one order and its errors; ``rising`` where it rises over all elongations that were measured."""

    order: int
    k: tuple[float, ...]
    std_errors: tuple[float | None, ...]
    rms_N: float | None
    max_N: float | None
    cross_validation_N: float | None
    rising: bool


@dataclass(frozen=True)
class SpringModel:
    """One spring; ``before`` are the coefficients that were in force, none for a table."""

    recommended: int
    reason: str
    fits: tuple[SpringFit, ...]
    before: tuple[float, ...] | None = field(default=None, metadata=ABSENT)


@dataclass(frozen=True)
class SpringQuality:
    """Measured pairs, thinned to be drawn, the errors of each order at them, and the curves by order, "x" the first."""

    pairs: int
    hysteresis_N: float | None
    x: tuple[float, ...]
    F: tuple[float, ...]
    rising: tuple[bool, ...]
    errors: dict[str, tuple[float, ...]]
    curve: dict[str, tuple[float, ...]]

    @property
    def curve_x(self) -> tuple[float, ...]:
        """Where the curves are drawn."""
        return self.curve["x"]


@dataclass(frozen=True)
class SpringModels:
    """Both springs of a sweep, or the one of a table."""

    A: SpringModel | None = field(default=None, metadata=ABSENT)
    B: SpringModel | None = field(default=None, metadata=ABSENT)
    table: SpringModel | None = field(default=None, metadata=ABSENT)
    version: int = VERSION


@dataclass(frozen=True)
class SpringQualities:
    """How good they are."""

    A: SpringQuality | None = field(default=None, metadata=ABSENT)
    B: SpringQuality | None = field(default=None, metadata=ABSENT)
    table: SpringQuality | None = field(default=None, metadata=ABSENT)
    version: int = VERSION


@dataclass(frozen=True)
class SpringFound:
    """One spring: its model, and how good that is."""

    model: SpringModel
    quality: SpringQuality


@dataclass(frozen=True)
class TableReading:
    """What was read of a table: the units of x and F, how the file is laid out, other columns with the reason."""

    x_unit: str
    F_unit: str
    layout: dict[str, str | int]
    not_read: dict[str, str]
    notes: tuple[str, ...] = ()


@dataclass(frozen=True)
class TableRecord:
    """The file that a table came from, and what was read of it; None for tables from before that was kept."""

    file: str
    sha256: str
    points: int | None = None
    read: TableReading | None = None


MODELS: Edge[SpringModels] = Edge(SpringModels, "its model", VERSION)
QUALITIES: Edge[SpringQualities] = Edge(SpringQualities, "the quality of its model", VERSION)
TABLE: Edge[TableRecord] = Edge(TableRecord, "what is told of its file", VERSION)


def springs_found(models: SpringModels, qualities: SpringQualities, of: str) -> dict[str, SpringFound]:
    """Return the springs of ``of`` by name: "A" and "B", or "table". Raises UnreadableDocumentError."""
    both = ((name, getattr(models, name), getattr(qualities, name)) for name in ("A", "B", "table"))
    there = [(name, model, quality) for name, model, quality in both if model or quality]
    missing = next((name for name, model, quality in there if not (model and quality)), "" if there else "A")
    if missing:
        raise UnreadableDocumentError(f"{of}: its model cannot be read, field {missing}: it is missing")
    return {name: SpringFound(model, quality) for name, model, quality in there}
