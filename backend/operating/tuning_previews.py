"""What a tuning would do, computed beside the service: a preview holds the interpreter for up to half a second.

A process keeps the models of the tunings that it was asked for last, which take longer than all else of a preview.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from threading import Lock

from backend.banks.builder import points_of
from backend.banks.tuning_settings import TuningChoice
from backend.operating.tuning_in_use import TuningInUse
from backend.schemas.tuning import Motion, MotorPreview, RobustTuning, TuningPreview
from backend.storage.banks import Bank
from backend.tuning.preview import Previewer
from plant.parameters import PlantParameters

_KEPT = 6
_kept: list[TuningInUse] = []
_keeping = Lock()


@dataclass(frozen=True)
class AskedTuning:
    """A tuning as it goes from one process to another: ``ranges`` are the smallest λ_q and λ_S [s] of each entry."""

    parameters: PlantParameters
    choice: TuningChoice
    bank: Bank | None
    ranges: Sequence[tuple[float, ...]]

    @classmethod
    def of(cls, tuning: TuningInUse) -> "AskedTuning":
        """Return what is asked of a tuning in use."""
        return cls(tuning.parameters, tuning.choice, tuning.bank, tuning.previewer.ranges)

    def made(self) -> TuningInUse:
        """Return the tuning with its models, which are kept where they were made before."""
        with _keeping:
            same = next((one for one in _kept if self._has_models_of(one)), None)
            if same is None:
                points = points_of(self.bank)
                lam_motor, b = self.choice.lam_motor, self.choice.b
                previewer = Previewer(self.parameters, points, lam_motor=lam_motor, b=b, ranges=self.ranges)
                same = TuningInUse(self.choice, self.bank, self.parameters, previewer)
                _kept.insert(0, same)
                del _kept[_KEPT:]
        return TuningInUse(self.choice, self.bank, self.parameters, same.previewer)

    def _has_models_of(self, other: TuningInUse) -> bool:
        mine, its = self.choice, other.choice
        return (
            (mine.lam_motor, mine.b) == (its.lam_motor, its.b)
            and self.bank == other.bank
            and self.parameters == other.parameters
        )


def preview(
    asked: AskedTuning,
    lam_q: float,
    lam_S: float,
    S: float,
    entry: float,
    motion: Motion | None,
    u_plan: float | None,
    k_ext: float | None,
    printed: bool,
) -> TuningPreview:
    """Return what ``TuningInUse.preview`` does. Raises OutOfRangeError."""
    made = asked.made()
    return made.preview(lam_q, lam_S, S, entry, motion=motion, u_plan=u_plan, k_ext=k_ext, printed=printed)


def motor(asked: AskedTuning, lam_motor: float) -> MotorPreview:
    """Return what ``TuningInUse.motor`` does. Raises OutOfRangeError."""
    return asked.made().motor(lam_motor)


def robust(asked: AskedTuning, M_s: float) -> RobustTuning:
    """Return what ``TuningInUse.robust`` does."""
    return asked.made().robust(M_s)
