"""Tuning settings: λ, b, bank, scheduling and motion, their defaults, and the last active tuning."""

import hashlib
import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from math import ceil, floor
from typing import Any, Self

from backend.banks import messages
from backend.models import (
    ACTIVE_TUNING,
    LAMBDA,
    MOTIONS,
    PLANT_NUMBERS,
    TIME_OPTIMAL,
    StoredTuning,
    Value,
    boolean_setting,
    build_plan,
    choice_setting,
    complete_motion,
    describe_settings,
    integer_setting,
    number_setting,
)
from backend.storage import Database, Session, StoredSetting, settings
from backend.tuning import (
    LAM_MAX,
    LAM_MOTOR,
    LAM_MOTOR_MAX,
    LAM_MOTOR_MIN,
    LAM_Q,
    LAM_S,
    PointModel,
    TuningParameters,
    TuningPreviewer,
    common_lambda_range,
    motor_model,
    usual_budget,
)
from plant import SIDES, PlantParameters

# Tuning settings -----------------------------------------------------------------------------------
# The settings that determine the gains of the loops, defined once. Stored runs, experiments, active
# and saved tuning, and requests derive from ``TuningSettings``, so a new setting reaches all of them;
# ``tests/banks/test_tuning_settings.py`` checks this.


_LAM_LEAST = 0.01


@dataclass(frozen=True)
class TuningSettings:
    """A tuning as a person chooses it; ``bank`` 0 selects geometric gains.

    The bounds of λ are coarse; the safe range depends on the active models.
    """

    lam_q: float = number_setting(
        LAM_Q,
        minimum=_LAM_LEAST,
        maximum=LAM_MAX,
        unit="s",
        symbol="λ_q",
        meaning="tuning parameter of the position loop",
    )
    lam_S: float = number_setting(
        LAM_S,
        minimum=_LAM_LEAST,
        maximum=LAM_MAX,
        unit="s",
        symbol="λ_S",
        meaning="tuning parameter of the stiffness loop",
    )
    lam_motor: float = number_setting(
        LAM_MOTOR,
        minimum=LAM_MOTOR_MIN,
        maximum=LAM_MOTOR_MAX,
        unit="s",
        symbol="λ_motor",
        meaning="tuning parameter of the motor loops",
    )
    b: float = number_setting(
        0.0,
        minimum=0.0,
        maximum=1.0,
        unit="1",
        symbol="b",
        meaning="weight of the reference in the outer loops' proportional part",
    )
    bank: int = integer_setting(0, 0, 2**53, "bank", "number of the controller bank, 0 for geometric gains at 20 N")
    interpolate: bool = boolean_setting(
        False, "interpolate", "interpolation of the gains between the operating points of the bank instead of switching"
    )
    motion: str = choice_setting(
        LAMBDA,
        MOTIONS,
        "motion",
        "how references are followed: lambda, by the paper's law, so that λ sets the speed; time-optimal, by a "
        "trajectory with feed-forward within U_plan, so that λ sets robustness and the reaction to disturbances only",
    )
    u_plan: float = number_setting(
        8.5,
        minimum=0.02,
        maximum=9.0,
        unit="V",
        symbol="U_plan",
        meaning="voltage limit of time-optimal motion: 20 % to 90 % of the motors' limit",
    )
    k_ext: float = number_setting(
        0.0,
        minimum=0.0,
        maximum=1.0,
        unit="1",
        symbol="k_ext",
        meaning="gain of the disturbance rejection: share of the estimated external force that is "
        "compensated, 0 for none",
    )

    @classmethod
    def from_values(cls, values: Mapping[str, Any]) -> Self:
        """Return the tuning in a document or mapping, without its unknown keys.

        A missing setting has its default; ``complete_motion`` defines the motion if there is only a voltage limit.
        Raises SettingError, OutOfRangeError.
        """
        known = {setting.name for setting in describe_settings(cls)}
        given = {name: value for name, value in values.items() if name in known and value is not None}
        return build_plan(cls, complete_motion(given))

    def replace_values(self, parts: Mapping[str, Any]) -> "TuningSettings":
        """Return a copy with some settings replaced."""
        return TuningSettings(**{**self.to_document(), **complete_motion(parts)})

    @property
    def budget(self) -> float:
        """Voltage limit [V] of the trajectory feed-forward; 0 V for the motion ``lambda``."""
        return self.u_plan if self.motion == TIME_OPTIMAL else 0.0

    @property
    def lambdas(self) -> TuningParameters:
        """The tuning parameters and b."""
        return TuningParameters(self.lam_q, self.lam_S, self.lam_motor, self.b)

    def to_document(self) -> dict[str, Any]:
        """Return the tuning as a document."""
        return {name: value for name, value in asdict(self).items() if name in TUNING_NAMES}

    def format(self) -> str:
        """Return all settings except the bank as text: "λ_q 0.5 s, … b 0, switching between operating points"."""
        return ", ".join(text for name, text in self.format_parts().items() if name != "bank")

    def format_parts(self) -> dict[str, str]:
        """Return each setting as text by its name: "λ_q 0.5 s". A k_ext of 0 is left out."""
        words: dict[str, str] = {
            setting.name: messages.setting_value(
                symbol=setting.symbol, value=format_part(setting.name, getattr(self, setting.name)), unit=setting.unit
            )
            for setting in TUNING_SETTINGS
        }
        words["motion"] = messages.motion_of_references(motion=self.motion)
        if self.motion == LAMBDA:
            del words["u_plan"]  # has no effect
        if self.k_ext == 0.0:
            del words["k_ext"]  # no disturbance rejection, the usual case
        words["bank"] = messages.source_of_gains(bank=self.bank)
        words["interpolate"] = messages.gains_between_entries(interpolate=self.interpolate)
        return words

    def list_differences(self, before: "TuningSettings") -> list[str]:
        """Return the changes since ``before`` as texts: "λ_q 0.5 → 0.6 s"."""
        return [
            messages.setting_changed(
                symbol=setting.symbol,
                before=format_part(setting.name, old),
                after=format_part(setting.name, new),
                unit=setting.unit,
            )
            for setting in TUNING_SETTINGS
            if (old := getattr(before, setting.name)) != (new := getattr(self, setting.name))
        ]


TUNING_SETTINGS = describe_settings(TuningSettings)
TUNING_NAMES = tuple(setting.name for setting in TUNING_SETTINGS)


def parse_changes(text: str) -> dict[str, Value] | None:
    """Return the new values in a text of ``TuningSettings.list_differences``; None for any other text.

    The changes are separated by commas and may follow other words and a colon.
    """
    found: dict[str, Value] = {}
    for change in text.rpartition(": ")[2].split(", "):
        left, arrow, right = change.partition(" → ")
        setting = next((item for item in TUNING_SETTINGS if left.startswith(f"{item.symbol} ")), None)
        if not arrow or setting is None:
            return None
        word = right.removesuffix(f" {setting.unit}")
        try:
            found[setting.name] = _parse_part(setting.kind, word)
        except ValueError:
            return None
    return found


def _parse_part(kind: str, word: str) -> Value:
    match kind:
        case "boolean":
            return word == "yes"
        case "choice":
            return word
        case "integer":
            return 0 if word == "geometry" else int(word)
        case _:
            return float(word)


def format_part(name: str, value: Value) -> str:
    """Return the value of a setting as text, without its unit."""
    if name == "bank":
        return "geometry" if value == 0 else str(value)
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, str):
        return value
    return f"{value:.12g}"


# Default tuning ------------------------------------------------------------------------------------
# The defaults of the method, with each λ moved into the range that is safe for the plant. The motion
# is ``lambda``, the paper's law; the voltage limit of ``time-optimal`` is the usual share of the
# plant's limit.


_STEP, _STEP_OF_MOTOR = 1e-3, 1e-4
"""A moved λ is a multiple of this [s], so that the page shows all of its digits."""


@dataclass(frozen=True)
class DefaultTuning:
    """The default tuning for some models.

    ``moved``: a sentence on each λ that differs from the method's default, usually empty. ``previewer`` is for the same
    models and λ_motor.
    """

    tuning: TuningSettings
    moved: str
    previewer: TuningPreviewer


def compute_default_tuning(
    parameters: PlantParameters, points: Sequence[PointModel] = (), known: TuningPreviewer | None = None
) -> DefaultTuning:
    """Return the default tuning for the models ``points``, of geometry if empty; it names no bank.

    ``known`` is a previewer for the same models, reused if λ_motor and b are the same. Raises TuningError if no λ is
    safe.
    """
    method = TuningSettings()
    lam_motor = default_lam_motor(parameters)
    if known is None or not known.is_for(lam_motor, method.b):
        known = TuningPreviewer(parameters, points, lam_motor=lam_motor, b=method.b)
    lam_q_min, lam_S_min = known.safe_range()
    tuning = replace(
        method,
        lam_q=_move_into_range(method.lam_q, lam_q_min, LAM_MAX, _STEP),
        lam_S=_move_into_range(method.lam_S, lam_S_min, LAM_MAX, _STEP),
        lam_motor=lam_motor,
        u_plan=usual_budget(parameters),
    )
    moved = replace(tuning, u_plan=method.u_plan).list_differences(method)  # a limit has no effect in ``lambda``
    return DefaultTuning(tuning, messages.default_tuning_moved(changes=moved) if moved else "", known)


def default_lam_motor(parameters: PlantParameters) -> float:
    """Return the default λ_motor [s]. Raises TuningError if no value is safe."""
    offered = common_lambda_range([motor_model(parameters, side) for side in SIDES])
    return _move_into_range(TuningSettings().lam_motor, *offered, _STEP_OF_MOTOR)


def _move_into_range(lam: float, low: float, high: float, step: float) -> float:
    """Return ``lam`` [s], or the nearest multiple of the step in the range, or else a bound."""
    if low <= lam <= high:
        return lam
    steps = ceil(low / step) if lam < low else floor(high / step)
    return min(max(round(steps * step, 4), low), high)


# Last tuning ---------------------------------------------------------------------------------------
# The active tuning as the database stores it, for the next start of the service and for the command
# line.


def saved_tuning_key(bank: int | None) -> str:
    """Return the key of the saved tuning of a bank; None means geometric gains."""
    return f"tuning/{'geometry' if bank is None else bank}"


ACTIVE_TUNING_KEY = "tuning in force"


@dataclass(frozen=True)
class LastTuning:
    """The last active tuning, its author, and whether the plant parameters were the same."""

    tuning: TuningSettings
    who: str
    same_plant: bool


def store_tuning(database: Database, tuning: TuningSettings, parameters: PlantParameters, who: str) -> None:
    """Store a tuning that has become active."""
    with database.session() as session:
        document = ACTIVE_TUNING.write(
            StoredTuning(**tuning.to_document(), parameters=compute_parameters_digest(parameters))
        )
        settings.save(session, ACTIVE_TUNING_KEY, document, who)


def load_last_tuning(database: Database, parameters: PlantParameters) -> LastTuning | None:
    """Return the last active tuning, None for a new data folder.

    Raises SettingError, OutOfRangeError, UnreadableDocumentError.
    """
    with database.reading() as session:
        stored = settings.newest(session, ACTIVE_TUNING_KEY)
    if stored is None:
        return None
    tuning = _parse_stored(stored)
    return LastTuning(
        TuningSettings.from_values(vars(tuning)), stored.who, tuning.parameters == compute_parameters_digest(parameters)
    )


def load_earlier_tuning(session: Session, tuning: TuningSettings, parameters: PlantParameters) -> TuningSettings | None:
    """Return the newest stored tuning for this plant that differs from ``tuning``, or None.

    Raises SettingError, OutOfRangeError, UnreadableDocumentError.
    """
    digest = compute_parameters_digest(parameters)
    documents = (_parse_stored(item) for item in settings.history(session, ACTIVE_TUNING_KEY))
    stored = (TuningSettings.from_values(vars(item)) for item in documents if item.parameters == digest)
    return next((item for item in stored if item != tuning), None)


def load_tuning_of_plant(session: Session, parameters: PlantParameters) -> TuningSettings | None:
    """Return the last active tuning for these plant parameters, or None.

    Raises SettingError, OutOfRangeError, UnreadableDocumentError.
    """
    digest = compute_parameters_digest(parameters)
    documents = (_parse_stored(item) for item in settings.history(session, ACTIVE_TUNING_KEY))
    return next((TuningSettings.from_values(vars(item)) for item in documents if item.parameters == digest), None)


def _parse_stored(stored: StoredSetting) -> StoredTuning:
    return ACTIVE_TUNING.read(stored.value, messages.stored_tuning(who=stored.who))


def compute_parameters_digest(parameters: PlantParameters) -> str:
    """Return a digest of the values of the plant parameters, independent of their name and source."""
    values = {
        section: {name: number.value for name, number in entries.items()}
        for section, entries in PLANT_NUMBERS.read(parameters.to_document(), parameters.name).items()
    }
    return hashlib.sha256(json.dumps(values, sort_keys=True).encode()).hexdigest()
