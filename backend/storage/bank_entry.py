"""What a bank's entry is called wherever people read of it, and how good the identification behind it was."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import isfinite
from typing import Any

from backend.identification.result import Grade
from backend.storage import identifications
from backend.storage.banks import Bank, BankEntry
from backend.storage.database import Session
from backend.storage.identifications import Identification

CHANNELS = ("G_q", "G_S")


def entry_name(S_nominal: float, tension_N: float | None) -> str:
    """Return the tension of an entry, "10 N"; where that is not known its stiffness, "8.24 N·m/rad"."""
    return f"{S_nominal:.2f} N·m/rad" if tension_N is None else f"{tension_N:g} N"


def name_of_entry(entry: BankEntry) -> str:
    """Return what a stored entry is called."""
    return entry_name(entry.S_nominal, entry.model.get("tension_N"))


def entry_in_use(entries: Sequence[BankEntry], active: float) -> str:
    """Return what is in use at the loop's ``active`` entry: "10 N", or between which two it interpolates."""
    if not entries:
        return ""
    last = len(entries) - 1
    below = min(max(int(active), 0), last)
    share = active - below
    if below == last or share < 0.005:
        return name_of_entry(entries[below])
    return f"{name_of_entry(entries[below])} to {name_of_entry(entries[below + 1])}, {100.0 * share:.0f} % of the way"


@dataclass(frozen=True)
class ChannelFit:
    """How good the model of G_q or G_S is: fit on data not used [%], standard errors of its K and T [%].

    A figure that could not be had, or that an older identification did not keep, is None.
    """

    grade: Grade | None
    fit_percent: float | None
    K_error_percent: float | None
    T_error_percent: float | None

    def in_words(self) -> str:
        """Return all of it in one line: "usable, fit 98.2 %, standard errors: K 1.2 %, T 3.1 %".

        Standard errors alone: what the verdict calls known may be less, as it counts what the model leaves out.
        """
        parts = (
            "grade not recorded" if self.grade is None else str(self.grade),
            f"fit {_percent(self.fit_percent)}",
            f"standard errors: K {_percent(self.K_error_percent)}",
            f"T {_percent(self.T_error_percent)}",
        )
        return ", ".join(parts)


def fits_of(found: Identification) -> dict[str, ChannelFit]:
    """Return the fit of both channels of an actuator's identification, by "G_q" and "G_S"."""
    return {name: _fit(found.model.get(name, {}), found.quality.get(name, {})) for name in CHANNELS}


def fits_in(session: Session, bank: Bank) -> dict[int, dict[str, ChannelFit]]:
    """Return the fits behind a bank's entries, by the number of their estimate. Raises UnknownRecordError."""
    named = [entry.identification_id for entry in bank.entries]
    return {number: fits_of(identifications.get(session, number)) for number in named if number is not None}


def _fit(model: Mapping[str, Any], quality: Mapping[str, Any]) -> ChannelFit:
    first_order = model.get("first_order", {})
    grade = quality.get("grade")
    return ChannelFit(
        grade=None if grade is None else Grade(grade),
        fit_percent=_finite(quality.get("fit_percent")),
        K_error_percent=_relative(first_order, "K"),
        T_error_percent=_relative(first_order, "T"),
    )


def _relative(first_order: Mapping[str, Any], name: str) -> float | None:
    value, error = _finite(first_order.get(name)), _finite(first_order.get(f"{name}_std"))
    return None if not value or error is None else 100.0 * error / abs(value)


def _finite(value: Any) -> float | None:
    return float(value) if isinstance(value, int | float) and isfinite(value) else None


def _percent(value: float | None) -> str:
    return "not measured" if value is None else f"{value:.3g} %"
