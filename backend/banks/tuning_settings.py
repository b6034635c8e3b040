"""Tuning settings: λ, b, bank and scheduling; defaults and what is kept of them."""

import hashlib
import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from math import ceil, floor
from typing import Any, Self

from backend.models import (
    KEPT_TUNING,
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

# Tuning choice -------------------------------------------------------------------------------------
#
# What decides the gains of the loop, said once: λ, b, bank and how to go between its entries.
#
# Whoever keeps, sends, shows or compares a tuning derives it from ``TuningSettings``: the settings of
# an experiment, what a run has stored, the tuning in force and its trial, what is saved for a bank,
# the bodies of the interface. A part that is added here is added to all of them, and
# ``tests/experiments/test_tuning_choice.py`` finds the one that forgot it.


_LAM_LEAST = 0.01


@dataclass(frozen=True)
class TuningSettings:
    """A tuning as a person chooses it. The bounds of λ here are coarse; the safe range follows from the models in use.

    ``bank`` 0 stands for gains from geometry.
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
    bank: int = integer_setting(0, 0, 2**53, "bank", "number of the controller bank, 0 for gains from geometry at 20 N")
    interpolate: bool = boolean_setting(
        False, "interpolate", "gain scheduling between bank entries instead of switching"
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
        meaning="share of the estimated outside force that is fed forward against it, 0 for none",
    )

    @classmethod
    def of(cls, values: Mapping[str, Any]) -> Self:
        """Return the choice that a stored document or another choice's values hold; what else it holds is left out.

        What it lacks is at its default. A voltage limit without a motion means what ``complete_motion`` says.
        Raises SettingError, OutOfRangeError.
        """
        known = {setting.name for setting in describe_settings(cls)}
        given = {name: value for name, value in values.items() if name in known and value is not None}
        return build_plan(cls, complete_motion(given))

    def with_parts(self, parts: Mapping[str, Any]) -> "TuningSettings":
        """Return the tuning with other values of some of its parts."""
        return TuningSettings(**{**self.document(), **complete_motion(parts)})

    @property
    def budget(self) -> float:
        """Voltage limit [V] of the trajectory in use; 0 V in ``lambda``, which has none."""
        return self.u_plan if self.motion == TIME_OPTIMAL else 0.0

    @property
    def lambdas(self) -> TuningParameters:
        """The tuning parameters and b alone."""
        return TuningParameters(self.lam_q, self.lam_S, self.lam_motor, self.b)

    def document(self) -> dict[str, Any]:
        """Return the tuning as it is stored."""
        return {name: value for name, value in asdict(self).items() if name in NAMES}

    def in_words(self) -> str:
        """Return all but the bank in one line: "λ_q 0.5 s, … b 0, switching between entries"."""
        return ", ".join(text for name, text in self.parts_in_words().items() if name != "bank")

    def parts_in_words(self) -> dict[str, str]:
        """Return each part by name as a person reads it: "λ_q 0.5 s", "gains from geometry"; no k_ext of 0."""
        words = {
            setting.name: f"{setting.symbol} {part_in_words(setting.name, getattr(self, setting.name))}"
            + ("" if setting.unit == "1" else f" {setting.unit}")
            for setting in DECLARED
        }
        words["motion"] = f"{self.motion} motion"
        if self.motion == LAMBDA:
            del words["u_plan"]  # without an effect
        if self.k_ext == 0.0:
            del words["k_ext"]  # pushes are left to the position loop, as nothing else is said
        words["bank"] = "gains from geometry" if self.bank == 0 else f"bank {self.bank}"
        words["interpolate"] = f"{'interpolating' if self.interpolate else 'switching'} between entries"
        return words

    def differences(self, before: "TuningSettings") -> list[str]:
        """Say part by part what differs from ``before``: "λ_q 0.5 → 0.6 s"."""
        return [
            f"{setting.symbol} {part_in_words(setting.name, old)} → {part_in_words(setting.name, new)}"
            + ("" if setting.unit == "1" else f" {setting.unit}")
            for setting in DECLARED
            if (old := getattr(before, setting.name)) != (new := getattr(self, setting.name))
        ]


DECLARED = describe_settings(TuningSettings)
NAMES = tuple(setting.name for setting in DECLARED)


def parse_changes(text: str) -> dict[str, Value] | None:
    """Return the new values in a text of ``TuningSettings.differences``; None for any other text.

    The values are joined by commas, with words before a colon.
    """
    found: dict[str, Value] = {}
    for told in text.rpartition(": ")[2].split(", "):
        left, arrow, right = told.partition(" → ")
        setting = next((one for one in DECLARED if left.startswith(f"{one.symbol} ")), None)
        if not arrow or setting is None:
            return None
        word = right.removesuffix(f" {setting.unit}")
        try:
            found[setting.name] = _part_told(setting.kind, word)
        except ValueError:
            return None
    return found


def _part_told(kind: str, word: str) -> Value:
    match kind:
        case "boolean":
            return word == "yes"
        case "choice":
            return word
        case "integer":
            return 0 if word == "geometry" else int(word)
        case _:
            return float(word)


def part_in_words(name: str, value: Value) -> str:
    """Return one part of a tuning as a person reads it, without its unit."""
    if name == "bank":
        return "geometry" if value == 0 else str(value)
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, str):
        return value
    return f"{value:.12g}"


# Default choice ------------------------------------------------------------------------------------
#
# The tuning where nobody has chosen one: the method's defaults, each λ moved into what the plant's
# numbers leave.
#
# The motion is ``lambda``, the paper's law; the voltage limit of ``time-optimal`` is the usual
# share of the plant's.


_STEP, _STEP_OF_MOTOR = 1e-3, 1e-4
"""A λ that is moved ends on a multiple of this [s]: all of it is shown where the tuning is."""


@dataclass(frozen=True)
class DefaultTuning:
    """What is in force by default, and ``moved``: a sentence on each λ that the method has otherwise, empty mostly.

    ``previewer`` is for these models and this λ_motor.
    """

    choice: TuningSettings
    moved: str
    previewer: TuningPreviewer


def default_tuning_choice(
    parameters: PlantParameters, points: Sequence[PointModel] = (), known: TuningPreviewer | None = None
) -> DefaultTuning:
    """Return the defaults on the models ``points``, of geometry where there are none.

    ``known`` is for the same models and saves work where λ_motor and b are the same too. The choice names no bank,
    whoever has models of one does. Raises TuningError where no λ would do.
    """
    method = TuningSettings()
    lam_motor = default_lam_motor(parameters)
    if known is None or not known.is_for(lam_motor, method.b):
        known = TuningPreviewer(parameters, points, lam_motor=lam_motor, b=method.b)
    lam_q_min, lam_S_min = known.safe_range()
    choice = replace(
        method,
        lam_q=_into(method.lam_q, lam_q_min, LAM_MAX, _STEP),
        lam_S=_into(method.lam_S, lam_S_min, LAM_MAX, _STEP),
        lam_motor=lam_motor,
        u_plan=usual_budget(parameters),
    )
    moved = replace(choice, u_plan=method.u_plan).differences(method)  # a limit has no effect in ``lambda``
    said = f"the method's default is not offered for these models, the nearest that is: {', '.join(moved)}"
    return DefaultTuning(choice, said if moved else "", known)


def default_lam_motor(parameters: PlantParameters) -> float:
    """Return λ_motor [s] where nobody has chosen one. Raises TuningError where none would do."""
    offered = common_lambda_range([motor_model(parameters, side) for side in SIDES])
    return _into(TuningSettings().lam_motor, *offered, _STEP_OF_MOTOR)


def _into(lam: float, low: float, high: float, step: float) -> float:
    """Return ``lam`` [s], or the nearest multiple of the step within low to high; a bound where there is none."""
    if low <= lam <= high:
        return lam
    steps = ceil(low / step) if lam < low else floor(high / step)
    return min(max(round(steps * step, 4), low), high)


# Kept choice ---------------------------------------------------------------------------------------
#
# The tuning in force as the data folder keeps it: for the next start of the service, and for the
# command line.


def saved_tuning_key(bank: int | None) -> str:
    """Return the name of the setting that a bank's saved tuning is kept under; None is gains from geometry."""
    return f"tuning/{'geometry' if bank is None else bank}"


TUNING_NAME = "tuning in force"


@dataclass(frozen=True)
class LastTuning:
    """What was in force, who left it so, and whether that was with the same numbers of the plant."""

    choice: TuningSettings
    who: str
    same_plant: bool


def store_tuning(database: Database, choice: TuningSettings, parameters: PlantParameters, who: str) -> None:
    """Keep a choice that has come into force."""
    with database.session() as session:
        document = KEPT_TUNING.write(StoredTuning(**choice.document(), parameters=tuning_digest(parameters)))
        settings.save(session, TUNING_NAME, document, who)


def newest_tuning(database: Database, parameters: PlantParameters) -> LastTuning | None:
    """Return what was in force last, None on a new data folder.

    Raises SettingError, OutOfRangeError, UnreadableDocumentError.
    """
    with database.reading() as session:
        kept = settings.newest(session, TUNING_NAME)
    if kept is None:
        return None
    tuning = _read(kept)
    return LastTuning(TuningSettings.of(vars(tuning)), kept.who, tuning.parameters == tuning_digest(parameters))


def earlier_tuning(session: Session, choice: TuningSettings, parameters: PlantParameters) -> TuningSettings | None:
    """Return the newest kept choice for this plant other than ``choice``; None where there is none.

    Raises SettingError, OutOfRangeError, UnreadableDocumentError.
    """
    mine = tuning_digest(parameters)
    read = (_read(one) for one in settings.history(session, TUNING_NAME))
    kept = (TuningSettings.of(vars(one)) for one in read if one.parameters == mine)
    return next((one for one in kept if one != choice), None)


def left_with(session: Session, parameters: PlantParameters) -> TuningSettings | None:
    """Return what was in force last with these numbers of the plant; None where nothing was.

    Raises SettingError, OutOfRangeError, UnreadableDocumentError.
    """
    mine = tuning_digest(parameters)
    read = (_read(one) for one in settings.history(session, TUNING_NAME))
    return next((TuningSettings.of(vars(one)) for one in read if one.parameters == mine), None)


def _read(kept: StoredSetting) -> StoredTuning:
    return KEPT_TUNING.read(kept.value, f"the data folder, left by {kept.who}")


def tuning_digest(parameters: PlantParameters) -> str:
    """Tell one set of numbers from another, whatever it is called and wherever the numbers come from."""
    values = {
        section: {name: number.value for name, number in entries.items()}
        for section, entries in PLANT_NUMBERS.read(parameters.to_document(), parameters.name).items()
    }
    return hashlib.sha256(json.dumps(values, sort_keys=True).encode()).hexdigest()
