"""The state of the controller at each sample of a run: tuning, gains and references, for predictions."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from backend.analysis import messages
from backend.analysis.step_metrics import iterate_segments
from backend.banks import TUNING_NAMES, BankError, HasEntries, TuningSettings, list_point_models
from backend.control import cascade
from backend.experiments import ExperimentPlan
from backend.models import StoredLoopSettings, UnreadableDocumentError
from backend.realtime import Law, final_references
from backend.tuning import PointModel, TuningError, make_cascade_tuning
from plant import PlantParameters, SinewError


class PredictionUnavailableError(SinewError, ValueError):
    """No prediction is possible; the message contains the reason."""


def load_initial_tuning(loop: StoredLoopSettings) -> TuningSettings:
    """Return the tuning at the start of a run without checks of bounds; settings not stored have defaults."""
    known: dict[str, Any] = {name: value for name, value in loop.get_known_values().items() if name in TUNING_NAMES}
    return TuningSettings(**known)


def load_bank_points(bank: HasEntries | None) -> tuple[PointModel, ...]:
    """Return the models of a bank; empty for an unreadable bank, so that only predictions are missing."""
    try:
        return list_point_models(bank)
    except (BankError, UnreadableDocumentError):
        return ()


@dataclass(frozen=True)
class EvaluationContext:
    """Settings of an executed run; ``tuning`` and ``points``, the models of its bank, are those at its start."""

    parameters: PlantParameters
    plan: ExperimentPlan
    tuning: TuningSettings
    points: Sequence[PointModel] = ()

    @property
    def has_position_loop(self) -> bool:
        """Whether the position loop is closed."""
        return self.plan.law is not Law.COMPLIANCE

    def get_tuning_at(self, sample: int) -> TuningSettings:
        """Return the active tuning at a sample of the program."""
        number = 0
        for start, _, segment in iterate_segments(self.plan.program()):
            if start > sample:
                break
            number = segment.tuning or number
        return self.tuning.replace_values(self.plan.compiled.changes[number - 1]) if number else self.tuning

    def compute_references_before(self, sample: int) -> tuple[float, float]:
        """Return q_ref [rad] and S_ref [N·m/rad] after the segments that end at a sample."""
        q, S = 0.0, 10.0
        for _, end, segment in iterate_segments(self.plan.program()):
            if end > sample:
                break
            q, S = final_references(segment, q, S)
        return q, S

    def compute_gains_at(self, sample: int) -> cascade.CascadeTuning:
        """Return the gains of the cascade at a sample. Raises PredictionUnavailableError."""
        if self.plan.law not in (Law.CASCADE, Law.COMPLIANCE):
            raise PredictionUnavailableError(messages.law_without_prediction(law=self.plan.law))
        choice = self.get_tuning_at(sample)
        if choice.bank != self.tuning.bank:
            raise PredictionUnavailableError(messages.bank_changed_during_run())
        if choice.bank and not self.points:
            raise PredictionUnavailableError(messages.bank_not_readable())
        try:
            return make_cascade_tuning(
                parameters=self.parameters,
                lambdas=choice.lambdas,
                points=self.points,
                motor=None,
                interpolate=choice.interpolate,
                u_plan=choice.budget,
                k_ext=choice.k_ext,
            )
        except TuningError as error:
            raise PredictionUnavailableError(error.message) from None
