"""What controlled at a sample of a run, as far as a prediction has to know it: gains, law, references. Pure."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from backend.analysis.step_metrics import timed
from backend.banks import TUNING_NAMES, BankError, HasEntries, TuningSettings, list_point_models
from backend.control import cascade
from backend.experiments import ExperimentPlan
from backend.models import StoredLoopSettings, UnreadableDocumentError
from backend.realtime import Law, final_references
from backend.tuning import PointModel, TuningError, make_cascade_tuning
from plant import PlantParameters, SinewError


class NotPredictedError(SinewError, ValueError):
    """There is nothing to compare a measurement with; says why."""


def load_initial_tuning(loop: StoredLoopSettings) -> TuningSettings:
    """Return the tuning that a run began with, whatever bounds it had then; what was not kept was the default."""
    known: dict[str, Any] = {name: value for name, value in loop.get_known_values().items() if name in TUNING_NAMES}
    return TuningSettings(**known)


def load_bank_points(bank: HasEntries | None) -> tuple[PointModel, ...]:
    """Return the models of a bank; of one that cannot be read none, so that all but the prediction is told."""
    try:
        return list_point_models(bank)
    except (BankError, UnreadableDocumentError):
        return ()


@dataclass(frozen=True)
class EvaluationContext:
    """``tuning`` is the one that the run began with, ``points`` the models of its bank, none for geometry."""

    parameters: PlantParameters
    plan: ExperimentPlan
    tuning: TuningSettings
    points: Sequence[PointModel] = ()

    @property
    def position_loop(self) -> bool:
        """Whether the joint loop is closed."""
        return self.plan.law is not Law.COMPLIANCE

    def choice_at(self, sample: int) -> TuningSettings:
        """Return the tuning in use at a sample of the program."""
        number = 0
        for start, _, segment in timed(self.plan.program()):
            if start > sample:
                break
            number = segment.tuning or number
        return self.tuning.replace_values(self.plan.compiled.changes[number - 1]) if number else self.tuning

    def references_before(self, sample: int) -> tuple[float, float]:
        """Return q_ref [rad] and S_ref [N·m/rad] as they were left by what ended at a sample."""
        q, S = 0.0, 10.0
        for _, end, segment in timed(self.plan.program()):
            if end > sample:
                break
            q, S = final_references(segment, q, S)
        return q, S

    def gains_at(self, sample: int) -> cascade.CascadeTuning:
        """Return the gains of the cascade at a sample. Raises NotPredictedError."""
        if self.plan.law not in (Law.CASCADE, Law.COMPLIANCE):
            raise NotPredictedError(f"of the law {self.plan.law} no prediction is made")
        choice = self.choice_at(sample)
        if choice.bank != self.tuning.bank:
            raise NotPredictedError("a bank was in use that the run did not begin with")
        if choice.bank and not self.points:
            raise NotPredictedError("the bank that was in use is not stored with the run, or cannot be read")
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
            raise NotPredictedError(str(error)) from None
