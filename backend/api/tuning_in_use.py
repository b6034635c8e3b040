"""The tuning in force: λ, the bank whose models it is applied to, and what follows from both."""

from dataclasses import asdict, dataclass, replace
from math import degrees, isfinite

from backend.api.schemas.tuning import (
    BankReference,
    LoopPreview,
    MotorPreview,
    PrintedFormula,
    RobustLambda,
    RobustTuning,
    TuningPreview,
    TuningRequest,
    TuningView,
)
from backend.experiments.bank_building import points_of
from backend.experiments.loop_settings import LoopSettings
from backend.loop.commands import SetTuning
from backend.loop.tuned import tuning_for
from backend.storage.banks import Bank
from backend.tuning import preview
from backend.tuning.formulas import TuningError
from backend.tuning.models import LAM_MAX, Lambdas
from backend.tuning.preview import Previewer
from plant.parameters import PlantParameters

LAMBDAS = Lambdas()


@dataclass(frozen=True)
class TuningInUse:
    """λ and models that the loop's gains come from; without a bank the models follow from geometry."""

    parameters: PlantParameters
    lambdas: Lambdas
    bank: Bank | None
    interpolate: bool
    previewer: Previewer

    def command(self) -> SetTuning:
        """Return what tells the loop."""
        return tuning_for(self.parameters, self.lambdas, self.previewer.points, interpolate=self.interpolate)

    def document(self) -> dict[str, object]:
        """Return what a run and the settings remember of it."""
        return {
            "lam_q": self.lambdas.lam_q,
            "lam_S": self.lambdas.lam_S,
            "lam_motor": self.lambdas.lam_motor,
            "interpolate": self.interpolate,
            "bank": None if self.bank is None else self.bank.id,
        }

    def changed(self, request: TuningRequest) -> "TuningInUse":
        """Return the tuning after ``request``. Raises OutOfRangeError; takes a while when λ_motor changes."""
        wanted = {
            name: value for name, value in request.model_dump(exclude_none=True).items() if name in asdict(self.lambdas)
        }
        lambdas = replace(self.lambdas, **wanted)
        interpolate = self.interpolate if request.interpolate is None else request.interpolate
        return _checked(self.parameters, lambdas, self.bank, interpolate, self)

    def with_settings(self, settings: LoopSettings, bank: Bank | None) -> "TuningInUse":
        """Return the tuning that an experiment asks for. Raises OutOfRangeError where a λ is not safe on its models."""
        return _checked(self.parameters, settings.lambdas, bank, settings.interpolate, self)

    def with_bank(self, bank: Bank | None) -> "TuningInUse":
        """Return the tuning with another bank. Raises OutOfRangeError where a λ is not safe on its models."""
        return _checked(self.parameters, self.lambdas, bank, self.interpolate, self)

    def loop_settings(self, seed: int) -> LoopSettings:
        """Return λ, bank and the simulator's seed as an experiment's order has them."""
        lam = self.lambdas
        return LoopSettings(
            lam.lam_q, lam.lam_S, lam.lam_motor, self.bank.id if self.bank else 0, self.interpolate, seed, lam.b
        )

    def difference(self, before: "TuningInUse") -> str:
        """Return in words what differs from ``before``."""
        symbols = {"lam_q": "λ_q", "lam_S": "λ_S", "lam_motor": "λ_motor"}
        old, new = asdict(before.lambdas), asdict(self.lambdas)
        parts = [f"{symbols[n]} {old[n]:.3f} → {new[n]:.3f} s" for n in symbols if old[n] != new[n]]
        if before.interpolate != self.interpolate:
            parts.append("interpolating between entries" if self.interpolate else "switching between entries")
        return ", ".join(parts) or "the same tuning again"

    def view(self, entry: float) -> TuningView:
        """Return what the page shows; ``entry`` is the active entry of the bank."""
        lam_q_min, lam_S_min = self.previewer.safe_range()
        lam_motor_min, lam_motor_max = self.previewer.motor_range()
        bank = self.bank
        return TuningView(
            lam_q=self.lambdas.lam_q,
            lam_S=self.lambdas.lam_S,
            lam_motor=self.lambdas.lam_motor,
            lam_q_min=lam_q_min,
            lam_q_max=LAM_MAX,
            lam_S_min=lam_S_min,
            lam_S_max=LAM_MAX,
            lam_motor_min=lam_motor_min,
            lam_motor_max=lam_motor_max,
            bank=None if bank is None else BankReference(id=bank.id, name=bank.name, version=bank.version),
            entry=entry,
            interpolate=self.interpolate,
        )

    def preview(self, lam_q: float, lam_S: float, entry: int) -> TuningPreview:
        """Predict what both outer loops would do at these λ."""
        predicted = self.previewer.preview(replace(self.lambdas, lam_q=lam_q, lam_S=lam_S), entry)
        motor = predicted.motor
        return TuningPreview(
            motor=MotorPreview(
                M_s=motor.M_s,
                gain_margin=_finite(motor.gain_margin),
                gain_reduction_margin=motor.gain_reduction or None,
                phase_margin_deg=_finite(degrees(motor.phase_margin)),
            ),
            position=_loop(lam_q, predicted.position),
            stiffness=_loop(lam_S, predicted.stiffness),
            u_peak_V=predicted.peak_voltage,
            F_min_N=predicted.least_tension,
        )

    def robust(self, M_s: float) -> RobustTuning:
        """Return λ of the three loops for a wanted M_s."""
        found = {
            name: RobustLambda(lam=None, reason=str(lam))
            if isinstance(lam, TuningError)
            else RobustLambda(lam=lam, reason="")
            for name, lam in self.previewer.lambdas_for(M_s).items()
        }
        return RobustTuning(M_s=M_s, **found)


def initial(
    parameters: PlantParameters, lambdas: Lambdas = LAMBDAS, bank: Bank | None = None, interpolate: bool = False
) -> TuningInUse:
    """Return a tuning to start from. Raises OutOfRangeError."""
    return _checked(parameters, lambdas, bank, interpolate, None)


def _checked(
    parameters: PlantParameters, lambdas: Lambdas, bank: Bank | None, interpolate: bool, before: TuningInUse | None
) -> TuningInUse:
    if before is not None and before.lambdas.lam_motor == lambdas.lam_motor and before.bank == bank:
        previewer = before.previewer
    else:
        previewer = Previewer(parameters, points_of(bank), lam_motor=lambdas.lam_motor)
    previewer.require_safe(lambdas)
    return TuningInUse(parameters, lambdas, bank, interpolate, previewer)


def _loop(lam: float, predicted: preview.LoopPreview) -> LoopPreview:
    robustness = predicted.robustness
    stable = robustness.stable
    return LoopPreview(
        lam=lam,
        lam_min=predicted.lam_min,
        lam_max=predicted.lam_max,
        stable=stable,
        M_s=robustness.M_s if stable else None,
        gain_margin=_finite(robustness.gain_margin) if stable else None,
        phase_margin_deg=_finite(degrees(robustness.phase_margin)) if stable else None,
        t=predicted.t.tolist(),
        y=predicted.y.tolist(),
        printed=PrintedFormula(
            stable=predicted.printed.stable,
            M_s=predicted.printed.M_s if predicted.printed.stable else None,
            y=predicted.printed_y.tolist(),
        ),
    )


def _finite(value: float) -> float | None:
    """Return None for an unlimited margin: JSON has no infinity."""
    return value if isfinite(value) else None
