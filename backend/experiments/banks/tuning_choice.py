"""What decides the gains of the loop, said once: λ, b, bank and how to go between its entries.

Whoever keeps, sends, shows or compares a tuning derives it from ``TuningChoice``: the settings of an experiment, what a
run has stored, the tuning in force and its trial, what is saved for a bank, the bodies of the interface. A part that is
added here is added to all of them, and ``tests/experiments/test_tuning_choice.py`` finds the one that forgot it.
"""

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any, Self

from backend.documents.run_settings import LAMBDA, MOTIONS, TIME_OPTIMAL, Value, with_motion
from backend.experiments.settings import boolean, choice, describe, from_values, integer, number
from backend.tuning.gains import LAM_MAX, LAM_MOTOR, LAM_Q, LAM_S, Lambdas
from backend.tuning.robustness import LAM_MOTOR_MAX, LAM_MOTOR_MIN

_LAM_LEAST = 0.01


@dataclass(frozen=True)
class TuningChoice:
    """A tuning as a person chooses it. The bounds of λ here are coarse; the safe range follows from the models in use.

    ``bank`` 0 stands for gains from geometry.
    """

    lam_q: float = number(LAM_Q, _LAM_LEAST, LAM_MAX, "s", "λ_q", "tuning parameter of the position loop")
    lam_S: float = number(LAM_S, _LAM_LEAST, LAM_MAX, "s", "λ_S", "tuning parameter of the stiffness loop")
    lam_motor: float = number(
        LAM_MOTOR, LAM_MOTOR_MIN, LAM_MOTOR_MAX, "s", "λ_motor", "tuning parameter of the motor loops"
    )
    b: float = number(0.0, 0.0, 1.0, "1", "b", "weight of the reference in the outer loops' proportional part")
    bank: int = integer(0, 0, 2**53, "bank", "number of the controller bank, 0 for gains from geometry at 20 N")
    interpolate: bool = boolean(False, "interpolate", "gain scheduling between bank entries instead of switching")
    motion: str = choice(
        LAMBDA,
        MOTIONS,
        "motion",
        "how references are followed: lambda, by the paper's law, so that λ sets the speed; time-optimal, by a "
        "trajectory with feed-forward within U_plan, so that λ sets robustness and the reaction to disturbances only",
    )
    u_plan: float = number(
        8.5, 0.02, 9.0, "V", "U_plan", "voltage limit of time-optimal motion: 20 % to 90 % of the motors' limit"
    )
    k_ext: float = number(
        0.0, 0.0, 1.0, "1", "k_ext", "share of the estimated outside force that is fed forward against it, 0 for none"
    )

    @classmethod
    def of(cls, values: Mapping[str, Any]) -> Self:
        """Return the choice that a stored document or another choice's values hold; what else it holds is left out.

        What it lacks is at its default, as it was when nothing said otherwise: documents from before b was kept, and
        an empty ``bank``. A voltage limit without a motion means what ``with_motion`` says.
        Raises SettingError, OutOfRangeError.
        """
        known = {setting.name for setting in describe(cls)}
        given = {name: value for name, value in values.items() if name in known and value is not None}
        return from_values(cls, with_motion(given))

    def with_parts(self, parts: Mapping[str, Any]) -> "TuningChoice":
        """Return the tuning with other values of some of its parts."""
        return TuningChoice(**{**self.document(), **with_motion(parts)})

    @property
    def budget(self) -> float:
        """Voltage limit [V] of the trajectory in use; 0 V in ``lambda``, which has none."""
        return self.u_plan if self.motion == TIME_OPTIMAL else 0.0

    @property
    def lambdas(self) -> Lambdas:
        """The tuning parameters and b alone."""
        return Lambdas(self.lam_q, self.lam_S, self.lam_motor, self.b)

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

    def differences(self, before: "TuningChoice") -> list[str]:
        """Say part by part what differs from ``before``: "λ_q 0.5 → 0.6 s"."""
        return [
            f"{setting.symbol} {part_in_words(setting.name, old)} → {part_in_words(setting.name, new)}"
            + ("" if setting.unit == "1" else f" {setting.unit}")
            for setting in DECLARED
            if (old := getattr(before, setting.name)) != (new := getattr(self, setting.name))
        ]


DECLARED = describe(TuningChoice)
NAMES = tuple(setting.name for setting in DECLARED)


def changes_told(text: str) -> dict[str, Value] | None:
    """Return the new values in a text of ``TuningChoice.differences``, joined by commas and with words before a colon.

    None for any other text.
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
