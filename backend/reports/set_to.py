"""All that a run was set to and computed on, each by what it is called: for what differs between runs. Pure."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

from backend.analysis.evaluation import used_settings
from backend.models.document import digest_of
from backend.models.run import PLANT_NUMBERS
from backend.reports.evidence import carried
from backend.reports.timing import granted_rows
from backend.storage.banks import Bank
from backend.storage.runs import Run

_DIGITS = 12
"""Of a digest, that tell it from others beside it."""


@dataclass(frozen=True)
class SetTo:
    """One of it: in SI, ``unit`` "" for what has none."""

    name: str
    value: Any
    unit: str = ""


def set_to(run: Run, bank: Bank | None) -> Iterator[SetTo]:
    """Yield what a run was set to: plant, software, experiment, ``bank``, machine, settings and parameters."""
    yield SetTo("plant", run.plant)
    yield SetTo("name of the parameters", run.parameters_name)
    yield SetTo("Sinew", run.software)
    yield from (SetTo(name, version) for name, version in (run.set_to.versions or {}).items())
    if text := run.set_to.experiment:
        yield SetTo("text of the experiment, sha256", digest_of(text)[:_DIGITS])
    known = carried(bank)
    yield SetTo("bank", "none" if known is None else f"“{known.name}” version {known.version}")
    if known is not None:
        yield SetTo("bank, sha256", known.digest[:_DIGITS])
    granted: dict[str, list[str]] = {}
    for name, value, unit, meaning in granted_rows(run.set_to.granted):
        granted.setdefault(name, []).append(f"{value} {unit}".strip() or meaning)
    yield from (SetTo(name, "; ".join(told)) for name, told in granted.items())
    for item in used_settings(run):
        yield SetTo(f"{item.meaning} {item.symbol}", item.value, item.unit)
    for section, entries in PLANT_NUMBERS.read(run.parameters, f"run {run.id}").items():
        for entry, number in entries.items():
            yield SetTo(f"{section}.{entry}", number.value, number.unit)
