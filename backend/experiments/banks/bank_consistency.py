"""What the entries of a bank must have in common before any loop runs on them. Pure."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from math import isfinite
from typing import Any

from backend.control.decoupler import decoupler_for, stiffness_slope
from backend.documents.plant_numbers import PLANT_NUMBERS, PlantNumber
from backend.experiments.banks.default_choice import default_lam_motor
from backend.identification.validation import MAX_GAIN_ERROR_PERCENT
from backend.storage.bank_entry import entry_name
from backend.storage.banks import BankEntry
from backend.tuning.gains import PointModel, TuningError
from backend.tuning.preview import Previewer
from plant.parameters import PlantParameters

LEAST_DISTANCE = 0.3
"""Two entries closer than this in stiffness [N·m/rad] describe the same point: one of them is superfluous."""

MODEL_NAMES = ("K_q", "T_q", "K_S", "T_S")


class BankError(ValueError):
    """The chosen entries make no bank; the message says which and why."""


@dataclass(frozen=True)
class NamedEntry:
    """An entry with the words that name it in a refusal."""

    name: str
    entry: BankEntry

    @property
    def point(self) -> PointModel:
        """The models of the entry."""
        return point_of(self.entry)


def point_of(entry: BankEntry) -> PointModel:
    """Return the models of an entry."""
    known = {name: getattr(entry.known, name) for name in MODEL_NAMES}
    if missing := [name for name, value in known.items() if value is None]:
        raise BankError(f"the entry {entry_name(entry.S_nominal, entry.known.tension_N)} has no {', '.join(missing)}")
    return PointModel(entry.S_nominal, **known)


def require_consistent(parameters: PlantParameters, chosen: Sequence[NamedEntry]) -> tuple[BankEntry, ...]:
    """Return the entries in order of stiffness. Raises BankError naming what does not fit and why."""
    if not chosen:
        raise BankError("a bank needs at least one identification")
    for item in chosen:
        _require_positive(item)
    ordered = sorted(chosen, key=lambda item: item.entry.S_nominal)
    for below, above in pairwise(ordered):
        _require_apart(below, above)
        _require_tension_rises(below, above)
    for item in ordered:
        _require_gain_of_geometry(parameters, item)
        _require_stable(parameters, item)
    return tuple(item.entry for item in ordered)


def require_same_parameters(parameters: PlantParameters, name: str, recorded: Mapping[str, Any]) -> None:
    """Raise BankError where a run was made with other numbers than those in use: its model is of another plant."""
    then = PLANT_NUMBERS.read(recorded, name)
    for section, entries in PLANT_NUMBERS.read(parameters.document(), parameters.name).items():
        for entry, now in entries.items():
            was = then.get(section, {}).get(entry, PlantNumber(None)).value
            if was != now.value:
                raise BankError(
                    f"{name} was made with other parameters: {section}.{entry} was {was}, it is {now.value} now; "
                    "identify again, or use the parameters of that run"
                )


def _require_positive(item: NamedEntry) -> None:
    values = {"S_nominal": item.entry.S_nominal} | {name: getattr(item.entry.known, name) for name in MODEL_NAMES}
    for name, value in values.items():
        if not isinstance(value, int | float) or isinstance(value, bool) or not isfinite(value) or not value > 0.0:
            raise BankError(f"{item.name} has {name} = {value}: it must be a number above 0")


def _require_apart(below: NamedEntry, above: NamedEntry) -> None:
    distance = above.entry.S_nominal - below.entry.S_nominal
    if distance < LEAST_DISTANCE:
        raise BankError(
            f"{below.name} and {above.name} are {distance:.2f} N·m/rad apart, less than {LEAST_DISTANCE:g}: "
            "they describe the same point, choose one of them"
        )


def _require_tension_rises(below: NamedEntry, above: NamedEntry) -> None:
    low, high = below.entry.known.tension_N, above.entry.known.tension_N
    if low is not None and high is not None and not low < high:
        raise BankError(
            f"{above.name} is stiffer than {below.name} ({above.entry.S_nominal:.2f} and {below.entry.S_nominal:.2f} "
            f"N·m/rad) at a tension that is not higher ({high:g} and {low:g} N): one of them cannot be right, "
            "identify both again"
        )


def _require_gain_of_geometry(parameters: PlantParameters, item: NamedEntry) -> None:
    g, point = parameters.geometry, item.point
    expected = {
        "K_q": (point.K_q, g.r_m / (2.0 * g.r_j)),
        "K_S": (point.K_S, stiffness_slope(decoupler_for(parameters), point.S_nominal)),
    }
    for name, (value, geometric) in expected.items():
        error = 100.0 * (value / geometric - 1.0)
        if abs(error) > MAX_GAIN_ERROR_PERCENT:
            raise BankError(
                f"{item.name} has {name} = {value:.4g}, {error:+.0f} % from the {geometric:.4g} of geometry, more than "
                f"{MAX_GAIN_ERROR_PERCENT:g} %: identify again with more motion"
            )


def _require_stable(parameters: PlantParameters, item: NamedEntry) -> None:
    try:
        Previewer(parameters, (item.point,), lam_motor=default_lam_motor(parameters))
    except TuningError as error:
        raise BankError(f"{item.name} gives loops that are not robust at any λ: {error}") from None
