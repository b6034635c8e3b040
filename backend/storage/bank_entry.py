"""What a bank's entry is called wherever people read of it, and how good the identification behind it was."""

from collections.abc import Sequence
from dataclasses import dataclass

from backend.documents.actuator import PartialChannelModel, PartialChannelQuality, PartialReduced
from backend.identification.models import Grade, joint_method
from backend.storage import identifications
from backend.storage.banks import Bank, BankEntry
from backend.storage.database import Session
from backend.storage.identifications import Identification
from backend.units import percent


def entry_name(S_nominal: float, tension_N: float | None) -> str:
    """Return the tension of an entry, "10 N"; where that is not known its stiffness, "8.24 N·m/rad"."""
    return f"{S_nominal:.2f} N·m/rad" if tension_N is None else f"{tension_N:g} N"


def name_of_entry(entry: BankEntry) -> str:
    """Return what a stored entry is called."""
    return entry_name(entry.S_nominal, entry.known.tension_N)


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
            f"fit {'not measured' if self.fit_percent is None else f'{percent(self.fit_percent)} %'}",
            f"standard errors: K {_percent(self.K_error_percent)}",
            f"T {_percent(self.T_error_percent)}",
        )
        return ", ".join(parts)


def fits_of(found: Identification) -> dict[str, ChannelFit]:
    """Return the fit of both channels of an actuator's identification, by "G_q" and "G_S"."""
    model, quality = found.early_model, found.early_quality
    return {"G_q": _fit(model.G_q, quality.G_q), "G_S": _fit(model.G_S, quality.G_S)}


def method_of(found: Identification) -> str:
    """Name the estimators of an actuator's identification, as an early one too should have been named.

    Its own method is that of G_q alone where it was stored before both were named.
    """
    channels = {"G_q": found.early_model.G_q, "G_S": found.early_model.G_S}
    named = {name: channel.method if channel else None for name, channel in channels.items()}
    return joint_method({name: found.method if method is None else method for name, method in named.items()})


def fits_in(session: Session, bank: Bank) -> dict[int, dict[str, ChannelFit]]:
    """Return the fits behind a bank's entries, by the number of their estimate. Raises UnknownRecordError."""
    named = [entry.identification_id for entry in bank.entries]
    return {number: fits_of(identifications.get(session, number)) for number in named if number is not None}


def _fit(model: PartialChannelModel | None, quality: PartialChannelQuality | None) -> ChannelFit:
    first_order = (model.first_order if model else None) or PartialReduced()
    return ChannelFit(
        grade=quality.grade if quality else None,
        fit_percent=quality.fit_percent if quality else None,
        K_error_percent=_relative(first_order.K, first_order.K_std),
        T_error_percent=_relative(first_order.T, first_order.T_std),
    )


def _relative(value: float | None, error: float | None) -> float | None:
    return None if not value or error is None else 100.0 * error / abs(value)


def _percent(value: float | None) -> str:
    return "not measured" if value is None else f"{value:.3g} %"
