"""A named stretch of an experiment."""

from dataclasses import dataclass


@dataclass(frozen=True)
class Phase:
    """A named stretch of a program [s from its start]; the report draws one set of panels for each."""

    name: str
    title: str
    start_s: float
    end_s: float
