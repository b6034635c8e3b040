"""The figure of a result that a list of runs shows beside the verdict. Pure."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from backend.documents.result import Criterion, Metrics


@dataclass(frozen=True)
class Headline:
    """A figure in SI. ``relation`` and ``bound`` are those of its criterion; "" and None for a figure without one."""

    name: str
    label: str
    value: float
    unit: str
    relation: str = ""
    bound: float | None = None


def headline_of(
    metrics: Metrics | None, criteria: Sequence[Criterion], fits: Mapping[str, float] | None = None
) -> Headline | None:
    """Return the first criterion that failed, else the first measured one, else the first measured figure.

    Of an identification ``fits`` are those of its channels [%]: the lower one comes before any figure of the motion.
    None where nothing was measured.
    """
    for item in sorted(criteria, key=lambda item: item.passed is not False):
        if item.figure is not None:
            return Headline(item.name, item.title, item.figure, item.unit, item.relation, item.bound)
    if fits:
        channel = min(fits, key=lambda name: fits[name])
        return Headline("fit_percent", f"Fit of {channel}", fits[channel], "%")
    for figure in metrics.figures if metrics is not None else ():
        if figure.value is not None:
            return Headline(figure.name, figure.label, figure.value, figure.unit)
    return None
