"""Banks: built from identification runs, compared, taken out and brought in."""

from datetime import datetime
from typing import Annotated

from pydantic import Field

from backend.identification.models import Grade
from backend.messages.base import Finite, RowNumber, Schema, quantity
from backend.plain_text import ONE_LINE

Text = Annotated[str, Field(max_length=100), ONE_LINE]
BankName = Annotated[str, Field(min_length=1, max_length=60, description="name of the bank"), ONE_LINE]


class BankRequest(Schema):
    """A new bank, or a new version of the bank of that name, from chosen identification runs."""

    name: BankName
    identifications: list[RowNumber] = Field(min_length=1, max_length=20)


class BankEntryView(Schema):
    """One point of a bank and the identification it came from."""

    identification: int | None = Field(description="identification run it came from; null for an imported entry")
    tension_N: float | None = quantity("N", "tendon tension of the point")
    S_nominal: float = quantity("N·m/rad", "stiffness of the point")
    q_nominal: float | None = quantity("rad", "joint position it was identified at; null where that is not known")
    K_q: float
    T_q: float = quantity("s", "time constant of G_q")
    K_S: float
    T_S: float = quantity("s", "time constant of G_S")


class BankView(Schema):
    """One version of a bank."""

    id: int
    name: str
    version: int
    created: datetime
    who: str
    note: str
    active: bool
    entries: list[BankEntryView]


class BankList(Schema):
    """All versions of all banks, newest first."""

    banks: list[BankView]


class LoopFigures(Schema):
    """One outer loop of an entry at the λ in force."""

    K: float = Field(description="gain of the model")
    T: float = quantity("s", "time constant of the model")
    k_p: float = Field(description="proportional gain, through the decoupler")
    k_i: float = quantity("1/s", "integral gain, through the decoupler")
    M_s: float | None = Field(description="sensitivity peak on the high-order model; null when unstable")


class EntryFigures(Schema):
    """Models, gains and robustness of one entry."""

    S_nominal: float = quantity("N·m/rad", "stiffness of the point")
    tension_N: float | None = quantity("N", "tendon tension of the point")
    estimate: int | None = Field(description="number of the stored estimate; null for an imported entry")
    position: LoopFigures
    stiffness: LoopFigures


class ChannelFit(Schema):
    """How good a model is; a figure that could not be had is null."""

    grade: Grade | None = Field(description="null where an older identification did not keep it")
    fit_percent: float | None = Field(description="simulated fit on data not used for fitting")
    K_error_percent: float | None = Field(description="standard error of the gain")
    T_error_percent: float | None = Field(description="standard error of the time constant")


class EntryLineage(Schema):
    """Where the models of an entry came from, and how good they are."""

    identification: int | None = Field(description="identification run; null for data from elsewhere")
    estimate: int = Field(description="number of the stored estimate, of which a run may have several")
    method: str
    verdict: str
    position: ChannelFit
    stiffness: ChannelFit
    run: int | None
    created: datetime
    who: str
    plant: str | None
    parameters: str | None = Field(description="name of the parameter set of that run; its numbers are with the run")


class BankEntryDetail(Schema):
    """An entry in full."""

    figures: EntryFigures
    lineage: EntryLineage | None = Field(description="null for an imported entry")


class BankDetail(Schema):
    """A bank in full, at the λ in force."""

    lam_q: float = quantity("s", "λ_q that the gains are for")
    lam_S: float = quantity("s", "λ_S that the gains are for")
    entries: list[BankEntryDetail]


class EntryDifference(Schema):
    """A point before and after a change; null where it is new or gone."""

    before: EntryFigures | None
    after: EntryFigures | None


class BankDifference(Schema):
    """What using other entries would change, at the λ in force."""

    lam_q: float = quantity("s", "λ_q that the gains are for")
    lam_S: float = quantity("s", "λ_S that the gains are for")
    entries: list[EntryDifference]


class BankFileEntry(Schema):
    """One point in a bank's file."""

    S_nominal: Finite = quantity("N·m/rad", "stiffness of the point")
    K_q: Finite = Field(description="K of G_q")
    T_q: Finite = quantity("s", "T of G_q")
    K_S: Finite = Field(description="K of G_S")
    T_S: Finite = quantity("s", "T of G_S")
    tension_N: Finite | None = quantity("N", "tendon tension of the point", default=None)


class BankOrigin(Schema):
    """Where a bank's file came from."""

    bank: RowNumber
    version: RowNumber
    who: Text
    made: Text


class BankFile(Schema):
    """A bank as a file."""

    format: Text = "sinew-bank"
    version: RowNumber = 1
    name: BankName
    exported_from: BankOrigin | None = None
    units: dict[Text, Text] = Field(default_factory=dict, max_length=20)
    entries: list[BankFileEntry] = Field(min_length=1, max_length=20)
