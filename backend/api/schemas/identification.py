"""Identification runs: what to do, what to expect of it, what came out; banks built from them."""

from datetime import datetime
from typing import Any, Literal

from pydantic import Field

from backend.api.schemas.base import Schema, quantity
from backend.api.schemas.experiment import SettingValue
from backend.experiments.plans import ActuatorIdentificationPlan
from backend.experiments.settings import describe


def _declared(name: str) -> Any:
    """Return the field of a setting that the plan declares, with its bounds."""
    setting = next(setting for setting in describe(ActuatorIdentificationPlan) if setting.name == name)
    bounds = {"ge": setting.minimum, "le": setting.maximum}
    return quantity(setting.unit, setting.meaning, default=setting.default, **bounds)


class IdentificationRequest(Schema):
    """The closed-loop experiment of method section 4 at one tension."""

    kind: Literal["actuator"] = "actuator"
    tension_N: float = _declared("tension_N")
    amplitude_rad: float = _declared("amplitude_rad")
    chip_s: float = _declared("chip_s")
    bits: int = _declared("bits")
    periods: int = _declared("periods")


class Prediction(Schema):
    """What a run is expected to do before it starts."""

    duration_s: float = quantity("s", "length of the run, settling included")
    q_counts: float = Field(description="joint motion, peak to peak, in encoder counts")
    u_peak_V: float = quantity("V", "largest motor voltage expected")
    F_min_N: float = quantity("N", "least tendon tension expected")
    enough_motion: bool
    message: str


class Started(Schema):
    """The task was started; its run carries the result."""

    id: int


class ModelView(Schema):
    """A fitted model of one channel, G_q or G_S."""

    structure: str
    method: str
    parameters: dict[str, float]
    std_errors: dict[str, float | None]
    fit_percent: float | None = Field(description="simulated fit on data not used for fitting")
    gain_geometry: float = Field(description="static gain known from geometry")
    K: float = Field(description="static gain of the first-order reduction")
    T: float = quantity("s", "time constant of the first-order reduction: sum of lags")
    usable: bool
    verdict: str


class IdentificationView(Schema):
    """One identification run and, once it has ended, its models."""

    id: int
    run: int
    kind: str
    status: str
    created: datetime
    progress: float = Field(ge=0.0, le=1.0)
    tension_N: float
    S_nominal: float | None = quantity("N·m/rad", "stiffness at which the run was held")
    settings: dict[str, SettingValue]
    G_q: ModelView | None
    G_S: ModelView | None
    message: str


class IdentificationList(Schema):
    """Identification runs, newest first."""

    identifications: list[IdentificationView]


class BankRequest(Schema):
    """A new bank, or a new version of the bank of that name, from chosen identification runs."""

    name: str = Field(min_length=1, max_length=60)
    identifications: list[int] = Field(min_length=1, max_length=20)


class BankEntryView(Schema):
    """One point of a bank and the identification it came from."""

    identification: int | None = Field(description="identification run it came from; null for an imported entry")
    tension_N: float | None = quantity("N", "tendon tension of the point")
    S_nominal: float = quantity("N·m/rad", "stiffness of the point")
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
    active: bool
    entries: list[BankEntryView]


class BankList(Schema):
    """All versions of all banks, newest first."""

    banks: list[BankView]
