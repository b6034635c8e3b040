"""The tuning in force: λ, the bank whose models it is applied to, and what follows from both."""

from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from math import degrees, isfinite
from typing import Any

from backend.banks.builder import points_of, tuning_command
from backend.banks.tuning_settings import DefaultChoice, TuningChoice, default_choice
from backend.errors import require_within
from backend.realtime.program import SetTuning
from backend.schemas.tuning import (
    BankReference,
    ChosenTuning,
    LoopPreview,
    Motion,
    MotorPreview,
    PrintedFormula,
    PushedPreview,
    PushPreview,
    RobustLambda,
    RobustTuning,
    StepPreview,
    TuningParts,
    TuningPreview,
    TuningRequest,
    TuningView,
)
from backend.storage.banks import Bank, entry_in_use
from backend.tuning import preview
from backend.tuning.gains import LAM_MAX, Lambdas, TuningError, require_share
from backend.tuning.preview import Previewer, Steps, require_budget
from backend.tuning.robustness import Robustness
from backend.tuning.simulation import NEAR_RAD, PUSH_N, PushForecast, StepForecast
from plant.parameters import PlantParameters


@dataclass(frozen=True)
class Chosen:
    """A choice with the bank that it names, None for gains from geometry."""

    choice: TuningChoice
    bank: Bank | None


@dataclass(frozen=True)
class TuningInUse(Chosen):
    """A choice with the models that its bank stands for; without a bank the models follow from geometry."""

    parameters: PlantParameters
    previewer: Previewer

    @property
    def lambdas(self) -> Lambdas:
        """The tuning parameters and b alone."""
        return self.choice.lambdas

    def command(self) -> SetTuning:
        """Return what tells the loop."""
        return tuning_command(self.parameters, self.choice, self.bank)

    def changed(self, request: TuningRequest) -> "TuningInUse":
        """Return the tuning after ``request``. Raises OutOfRangeError; takes a while where models change."""
        wanted = request.model_dump(exclude_none=True, include=set(TuningParts.model_fields))
        return self.with_choice(self.choice.with_parts(wanted), self.bank)

    def with_choice(self, choice: TuningChoice, bank: Bank | None) -> "TuningInUse":
        """Return another tuning of the same plant, ``bank`` being what the choice names.

        Raises OutOfRangeError where a λ is not safe on its models.
        """
        return _checked(self.parameters, choice, bank, self)

    def with_bank(self, bank: Bank | None) -> "TuningInUse":
        """Return the tuning with another bank. Raises OutOfRangeError where a λ is not safe on its models."""
        return self.with_choice(self.choice, bank)

    def without_rejection(self) -> "TuningInUse":
        """Return the tuning with pushes left to the position loop."""
        return replace(self, choice=replace(self.choice, k_ext=0.0))

    def difference(self, before: "TuningInUse") -> str:
        """Return in words what differs from ``before``."""
        return ", ".join(self.choice.differences(before.choice)) or "the same tuning again"

    def default(self) -> DefaultChoice:
        """Return what would be in force on these models where nobody had chosen; takes a while at another λ_motor."""
        return default_choice(self.parameters, points_of(self.bank), self.previewer)

    def view(self, entry: float) -> TuningView:
        """Return what the page shows; ``entry`` is the active entry of the bank."""
        lam_q_min, lam_S_min = self.previewer.safe_range()
        lam_motor_min, lam_motor_max = self.previewer.motor_range()
        u_plan_min, u_plan_max = self.previewer.plan_range()
        return TuningView(
            **parts_of(self.choice),
            lam_q_min=lam_q_min,
            lam_q_max=LAM_MAX,
            lam_S_min=lam_S_min,
            lam_S_max=LAM_MAX,
            lam_motor_min=lam_motor_min,
            lam_motor_max=lam_motor_max,
            u_plan_min=u_plan_min,
            u_plan_max=u_plan_max,
            bank=_reference(self.bank),
            entry=entry,
            entry_name="" if self.bank is None else entry_in_use(self.bank.entries, entry),
        )

    def preview(
        self,
        lam_q: float,
        lam_S: float,
        S: float,
        entry: float = -1.0,
        *,
        motion: Motion | None = None,
        u_plan: float | None = None,
        k_ext: float | None = None,
        steps: Steps | None = None,
        printed: bool = False,
    ) -> TuningPreview:
        """Predict what these λ would do at S [N·m/rad]: robustness, a step of each reference, a held push.

        ``entry``: bank entry in use at present, −1 for the one nearest to S. ``motion``, ``u_plan`` [V], ``k_ext``
        [1]: None as now. ``steps``: other steps than the usual ones. ``printed``: with the printed formula beside it.
        Raises OutOfRangeError for a voltage limit or a share of the push that is not offered.
        """
        lambdas = replace(self.lambdas, lam_q=lam_q, lam_S=lam_S)
        wanted = {name: value for name, value in (("motion", motion), ("u_plan", u_plan)) if value is not None}
        budget = self.choice.with_parts(wanted).budget
        share = self.choice.k_ext if k_ext is None else k_ext
        require_budget(self.parameters, budget)
        require_share(share)
        with ThreadPoolExecutor() as beside:
            predicted = self.previewer.preview(
                lambdas,
                S,
                entry,
                interpolate=self.choice.interpolate,
                u_plan=budget,
                shares=(0.0, share) if share else (0.0,),
                steps=steps,
                printed=printed,
                each=beside.map,
            )
        without, *rejected = map(_push, predicted.pushes)
        return TuningPreview(
            motion="time-optimal" if budget else "lambda",
            S=S,
            motor=_motor(predicted.motor),
            position=_loop(lam_q, predicted.position),
            stiffness=_loop(lam_S, predicted.stiffness),
            step_q=_step(predicted.step_q),
            step_S=_step(predicted.step_S),
            pushed=PushedPreview(
                F=PUSH_N, near=NEAR_RAD, k_ext=share, without=without, rejected=rejected[0] if rejected else None
            ),
        )

    def motor(self, lam_motor: float) -> MotorPreview:
        """Return how robust the motor loops are at this λ. Raises OutOfRangeError for one that is not offered."""
        return _motor(self.previewer.motor_at(lam_motor))

    def robust(self, M_s: float) -> RobustTuning:
        """Return λ of the three loops for a wanted M_s."""
        found = {
            name: RobustLambda(lam=None, reason=str(lam))
            if isinstance(lam, TuningError)
            else RobustLambda(lam=lam, reason="")
            for name, lam in self.previewer.lambdas_for(M_s).items()
        }
        return RobustTuning(M_s=M_s, **found)


def _motor(robustness: Robustness) -> MotorPreview:
    return MotorPreview(
        M_s=robustness.M_s,
        gain_margin=_finite(robustness.gain_margin),
        gain_reduction_margin=robustness.gain_reduction or None,
        phase_margin_deg=_finite(degrees(robustness.phase_margin)),
    )


def initial(parameters: PlantParameters, choice: TuningChoice, bank: Bank | None = None) -> TuningInUse:
    """Return a tuning to start from, ``bank`` being what the choice names. Raises OutOfRangeError."""
    return _checked(parameters, choice, bank, None)


def by_default(parameters: PlantParameters) -> tuple[TuningInUse, str]:
    """Return the tuning where nobody has chosen one, and what to say of it: empty where it is the method's."""
    default = default_choice(parameters)
    return TuningInUse(default.choice, None, parameters, default.previewer), default.moved


def parts_of(choice: TuningChoice) -> dict[str, Any]:
    """Return the parts of a tuning that ``schemas.tuning.TuningParts`` shows; the bank is shown beside them."""
    return {name: value for name, value in choice.document().items() if name != "bank"}


def chosen_view(tuning: Chosen) -> ChosenTuning:
    """Return a tuning with its bank, as the page shows one that is not in force."""
    return ChosenTuning(**parts_of(tuning.choice), bank=_reference(tuning.bank))


def shown_with(view: TuningView, chosen: Chosen, entry: float) -> TuningView:
    """Return what the page shows of a tuning with parts and bank of another one; ``entry`` is the active one."""
    bank = chosen.bank
    name = "" if bank is None else entry_in_use(bank.entries, entry)
    parts = {**parts_of(chosen.choice), "bank": _reference(bank), "entry": entry, "entry_name": name}
    return view.model_copy(update=parts)


def _reference(bank: Bank | None) -> BankReference | None:
    return None if bank is None else BankReference(id=bank.id, name=bank.name, version=bank.version)


def _checked(
    parameters: PlantParameters, choice: TuningChoice, bank: Bank | None, before: TuningInUse | None
) -> TuningInUse:
    choice = replace(choice, bank=0 if bank is None else bank.id)
    require_within("b", choice.b, 0.0, 1.0, "1", words="weight b of the reference")
    if before is not None and all(
        getattr(before.choice, name) == getattr(choice, name) for name in ("lam_motor", "b", "bank")
    ):
        previewer = before.previewer
    else:
        previewer = Previewer(parameters, points_of(bank), lam_motor=choice.lam_motor, b=choice.b)
    previewer.require_safe(choice.lambdas, choice.budget)
    require_share(choice.k_ext)
    return TuningInUse(choice, bank, parameters, previewer)


def _loop(lam: float, predicted: preview.LoopPreview) -> LoopPreview:
    robustness, printed = predicted.robustness, predicted.printed
    stable = robustness.stable
    return LoopPreview(
        lam=lam,
        lam_min=predicted.lam_min,
        lam_max=predicted.lam_max,
        stable=stable,
        M_s=robustness.M_s if stable else None,
        gain_margin=_finite(robustness.gain_margin) if stable else None,
        phase_margin_deg=_finite(degrees(robustness.phase_margin)) if stable else None,
        printed=None if printed is None else _printed(printed),
    )


def _printed(printed: preview.Printed) -> PrintedFormula:
    stable, step = printed.robustness.stable, printed.step
    return PrintedFormula(
        stable=stable,
        M_s=printed.robustness.M_s if stable else None,
        t=[] if step is None else step.t.tolist(),
        y=[] if step is None else step.y.tolist(),
    )


def _step(step: StepForecast) -> StepPreview:
    return StepPreview(
        start=step.start,
        end=step.end,
        rise_s=_finite(step.t90_s),
        settling_s=_finite(step.settling_s),
        overshoot_percent=step.overshoot_percent,
        u_peak_V=step.peak_voltage,
        F_min_N=step.least_tension,
        t=step.t.tolist(),
        y=step.y.tolist(),
    )


def _push(push: PushForecast) -> PushPreview:
    return PushPreview(
        give=push.give,
        t=push.t.tolist(),
        off=push.off.tolist(),
        back_s=_finite(push.back_s),
        felt_slow=push.felt_slow,
        felt_fast=push.felt_fast,
    )


def _finite(value: float) -> float | None:
    """Return None for an unlimited margin: JSON has no infinity."""
    return value if isfinite(value) else None
