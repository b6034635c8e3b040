"""An entry of the glossary: what a word of the page means."""

from dataclasses import dataclass
from enum import StrEnum


class Kind(StrEnum):
    """What an entry is of; the first half of its key."""

    SIGNAL = "signal"
    QUANTITY = "quantity"
    PARAMETER = "parameter"
    SETTING = "setting"
    FIGURE = "figure"
    OUTCOME = "outcome"
    CRITERION = "criterion"
    GRADE = "grade"
    END = "end"
    MODE = "mode"
    CAUSE = "cause"
    FAULT = "fault"
    LIMIT = "limit"
    CHAIN = "chain"
    STEP = "step"
    SETUP = "setup"
    TIMING = "timing"


@dataclass(frozen=True)
class Entry:
    """One word.

    ``name`` is its spelling in the code, unique within its kind; ``term`` what a person reads: a symbol, or words.
    ``unit`` is SI, "" where it has none or needs none. ``equation`` is plain text in the spelling of docs/notation.md,
    ``source`` where it stands; "" where there is none. ``more`` tells further: heading and text.
    """

    kind: Kind
    name: str
    term: str
    meaning: str
    unit: str = ""
    equation: str = ""
    source: str = ""
    more: tuple[tuple[str, str], ...] = ()

    @property
    def key(self) -> str:
        """What the page asks by."""
        return f"{self.kind}:{self.name}"
