"""The active tuning, its predictions, its storage, and trials of another tuning."""

import asyncio
import hashlib
import json
import logging
import sys
from collections.abc import Awaitable, Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from importlib.metadata import version
from math import degrees, isfinite
from pathlib import Path
from typing import Any

from backend.banks import (
    DefaultTuning,
    LastTuning,
    TuningSettings,
    build_tuning_command,
    compute_default_tuning,
    list_point_models,
    tuning_settings,
)
from backend.data_folder import write_private
from backend.errors import OutOfRangeError, check_range
from backend.models import SettingError, UnreadableDocumentError
from backend.realtime import SetTuning
from backend.schemas import (
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
    TrialView,
    TuningParts,
    TuningPreview,
    TuningRequest,
    TuningView,
)
from backend.services import messages
from backend.storage import Bank, Database, Session, StorageError, UnknownRecordError, active_entry_name, banks
from backend.supervision import Part, SupervisedTask, Supervision
from backend.tuning import (
    FIGURES,
    LAM_MAX,
    NEAR_RAD,
    PUSH_N,
    PushForecast,
    Robustness,
    StepForecast,
    Steps,
    TuningError,
    TuningParameters,
    TuningPreviewer,
    preview,
    require_budget,
    require_share,
)
from plant import CACHE, PlantParameters

# Robustness cache ----------------------------------------------------------------------------------
# Stores computed robustness in a file, so that a start neither loads python-control nor computes it
# again.
#
# The file lies next to the compiled functions. Its name contains a digest of the sources and
# libraries that compute the values, so that a change of them leads to a new file. A damaged file is
# ignored.


_SOURCES = ("plant/*.py", "backend/control/*.py", "backend/tuning/*.py")
_LIBRARIES = ("numpy", "scipy", "control", "numba")
_ROOT = Path(__file__).resolve().parents[2]
_log = logging.getLogger(__name__)


class RobustnessCache:
    """File with the values of ``backend.tuning.FIGURES``, the cache in memory."""

    def __init__(self, folder: Path | None = None) -> None:
        """Use ``folder``, by default the folder of the compiled functions.

        Without either, nothing is stored.
        """
        folder = folder or (None if CACHE is None else CACHE.parent)
        self.file = None if folder is None else folder / f"figures-{_compute_code_digest()[:16]}.json"
        self._stored: dict[str, tuple[float, ...]] = {}

    def load(self) -> None:
        """Add the values of the file to the cache in memory.

        A missing or damaged file is ignored.
        """
        if self.file is None:
            return
        try:
            self._stored = _parse(self.file.read_text(encoding="ascii"))
        except FileNotFoundError:
            return
        except (OSError, ValueError, TypeError, KeyError, AttributeError) as error:
            _log.warning("The service cannot use the cache %s and recomputes its values: %s", self.file, error)
            return
        FIGURES.update(self._stored)

    def save(self) -> None:
        """Write the cache in memory to the file if it has changed.

        A write error is only logged.
        """
        current = dict(FIGURES)
        if self.file is None or current == self._stored:
            return
        content = {key: list(values) for key, values in current.items()}
        try:
            self.file.parent.mkdir(parents=True, exist_ok=True)
            write_private(self.file, json.dumps({"figures": content, "digest": _compute_digest(content)}))
        except OSError as error:
            _log.info("The service cannot write %s, so its next start takes longer: %s", self.file, error)
        else:
            self._stored = current


def _parse(text: str) -> dict[str, tuple[float, ...]]:
    """Return the values of a file.

    Raises ValueError, TypeError, KeyError or AttributeError for a damaged one.
    """
    document = json.loads(text)
    content = document["figures"]
    if document["digest"] != _compute_digest(content):
        raise ValueError("its digest does not match")
    return {str(key): tuple(map(float, values)) for key, values in content.items()}


def _compute_digest(content: object) -> str:
    return hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()


def _compute_code_digest() -> str:
    """Return a digest of Python, libraries and sources that compute the values."""
    digest = hashlib.sha256(sys.version.encode())
    for library in _LIBRARIES:
        digest.update(f"{library} {version(library)} ".encode())
    for pattern in _SOURCES:
        for source in sorted(_ROOT.glob(pattern)):
            digest.update(source.read_bytes())
    return digest.hexdigest()


# Active tuning -------------------------------------------------------------------------------------
# Tuning parameters, the bank whose models they apply to, and the predictions from both.


@dataclass(frozen=True)
class ResolvedTuning:
    """Tuning settings with the bank that they name; None for geometric gains."""

    settings: TuningSettings
    bank: Bank | None


@dataclass(frozen=True)
class ActiveTuning(ResolvedTuning):
    """Tuning settings with the models of their bank, or of the geometry."""

    parameters: PlantParameters
    previewer: TuningPreviewer

    @property
    def lambdas(self) -> TuningParameters:
        """The tuning parameters λ and the reference weight b."""
        return self.settings.lambdas

    def build_command(self) -> SetTuning:
        """Return the command that activates the tuning in the control loop."""
        return build_tuning_command(self.parameters, self.settings, self.bank)

    def with_request(self, request: TuningRequest) -> "ActiveTuning":
        """Return the tuning with the changes of ``request``; slow if models change.

        Raises OutOfRangeError.
        """
        changes = request.model_dump(exclude_none=True, include=set(TuningParts.model_fields))
        return self.with_settings(self.settings.replace_values(changes), self.bank)

    def with_settings(self, settings: TuningSettings, bank: Bank | None) -> "ActiveTuning":
        """Return another tuning of the same plant.

        ``bank`` is the bank that ``settings`` names. Raises OutOfRangeError if a λ is unsafe with its models.
        """
        return _resolve(self.parameters, settings, bank, self)

    def with_bank(self, bank: Bank | None) -> "ActiveTuning":
        """Return the tuning with another bank.

        Raises OutOfRangeError if a λ is unsafe with its models.
        """
        return self.with_settings(self.settings, bank)

    def without_rejection(self) -> "ActiveTuning":
        """Return the tuning without disturbance rejection."""
        return replace(self, settings=replace(self.settings, k_ext=0.0))

    def describe_difference(self, before: "ActiveTuning") -> str:
        """Return a description of the differences from ``before``."""
        return ", ".join(self.settings.list_differences(before.settings)) or messages.no_change_of_tuning()

    def compute_default(self) -> DefaultTuning:
        """Return the default tuning on these models.

        Slow if its λ_motor differs from the active one.
        """
        return compute_default_tuning(self.parameters, list_point_models(self.bank), self.previewer)

    def view(self, entry: float) -> TuningView:
        """Return the tuning as the page shows it.

        ``entry`` is the index of the active operating point.
        """
        lam_q_min, lam_S_min = self.previewer.safe_range()
        lam_motor_min, lam_motor_max = self.previewer.motor_range()
        u_plan_min, u_plan_max = self.previewer.plan_range()
        return TuningView(
            **list_tuning_parts(self.settings),
            lam_q_min=lam_q_min,
            lam_q_max=LAM_MAX,
            lam_S_min=lam_S_min,
            lam_S_max=LAM_MAX,
            lam_motor_min=lam_motor_min,
            lam_motor_max=lam_motor_max,
            u_plan_min=u_plan_min,
            u_plan_max=u_plan_max,
            bank=_build_bank_reference(self.bank),
            entry=entry,
            entry_name="" if self.bank is None else active_entry_name(self.bank.entries, entry),
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
        """Predict robustness, reference steps, and the response to a constant push.

        Args:
            lam_q: Tuning parameter of the position loop [s].
            lam_S: Tuning parameter of the stiffness loop [s].
            S: Stiffness [N·m/rad].
            entry: Index of the active operating point; −1 for the one nearest to ``S``.
            motion: Motion; None for the active one.
            u_plan: Feed-forward voltage limit [V]; None for the active one.
            k_ext: Gain of the disturbance rejection; None for the active one.
            steps: Reference steps; None for the default ones.
            printed: Whether to add the prediction of the formula printed in the paper.

        Raises OutOfRangeError for a voltage limit or a gain out of range.

        """
        lambdas = replace(self.lambdas, lam_q=lam_q, lam_S=lam_S)
        changes = {name: value for name, value in (("motion", motion), ("u_plan", u_plan)) if value is not None}
        voltage_limit = self.settings.replace_values(changes).budget
        gain = self.settings.k_ext if k_ext is None else k_ext
        require_budget(self.parameters, voltage_limit)
        require_share(gain)
        with ThreadPoolExecutor() as executor:
            predicted = self.previewer.preview(
                lambdas,
                S,
                entry,
                interpolate=self.settings.interpolate,
                u_plan=voltage_limit,
                shares=(0.0, gain) if gain else (0.0,),
                steps=steps,
                printed=printed,
                each=executor.map,
            )
        without, *rejected = map(_build_push_preview, predicted.pushes)
        return TuningPreview(
            motion="time-optimal" if voltage_limit else "lambda",
            S=S,
            motor=_build_motor_preview(predicted.motor),
            position=_build_loop_preview(lam_q, predicted.position),
            stiffness=_build_loop_preview(lam_S, predicted.stiffness),
            step_q=_build_step_preview(predicted.step_q),
            step_S=_build_step_preview(predicted.step_S),
            pushed=PushedPreview(
                F=PUSH_N, near=NEAR_RAD, k_ext=gain, without=without, rejected=rejected[0] if rejected else None
            ),
        )

    def preview_motor(self, lam_motor: float) -> MotorPreview:
        """Return the robustness of the motor loops at ``lam_motor`` [s].

        Raises OutOfRangeError.
        """
        return _build_motor_preview(self.previewer.motor_at(lam_motor))

    def compute_robust_tuning(self, M_s: float) -> RobustTuning:
        """Return the λ of the three loops that give the sensitivity peak ``M_s``.

        Without such a λ, the view has the reason.
        """
        lambdas = {
            name: RobustLambda(lam=None, reason=str(lam))
            if isinstance(lam, TuningError)
            else RobustLambda(lam=lam, reason="")
            for name, lam in self.previewer.lambdas_for(M_s).items()
        }
        return RobustTuning(M_s=M_s, **lambdas)


def make_active_tuning(parameters: PlantParameters, settings: TuningSettings, bank: Bank | None = None) -> ActiveTuning:
    """Return a checked tuning with its models.

    ``bank`` is the bank that ``settings`` names. Raises OutOfRangeError.
    """
    return _resolve(parameters, settings, bank, None)


def default_tuning(parameters: PlantParameters) -> tuple[ActiveTuning, str]:
    """Return the default tuning, and a text if it differs from the method's."""
    default = compute_default_tuning(parameters)
    return ActiveTuning(default.tuning, None, parameters, default.previewer), default.moved


def list_tuning_parts(settings: TuningSettings) -> dict[str, Any]:
    """Return the fields of ``schemas.TuningParts``: all settings except the bank."""
    return {name: value for name, value in settings.to_document().items() if name != "bank"}


def build_chosen_tuning(tuning: ResolvedTuning) -> ChosenTuning:
    """Return a tuning that is not active, as the page shows it."""
    return ChosenTuning(**list_tuning_parts(tuning.settings), bank=_build_bank_reference(tuning.bank))


def overlay_tuning(view: TuningView, tuning: ResolvedTuning, entry: float) -> TuningView:
    """Return ``view`` with settings and bank of ``tuning``.

    ``entry`` is the index of the active operating point.
    """
    bank = tuning.bank
    name = "" if bank is None else active_entry_name(bank.entries, entry)
    reference = _build_bank_reference(bank)
    parts = {**list_tuning_parts(tuning.settings), "bank": reference, "entry": entry, "entry_name": name}
    return view.model_copy(update=parts)


def _build_bank_reference(bank: Bank | None) -> BankReference | None:
    return None if bank is None else BankReference(id=bank.id, name=bank.name, version=bank.version)


def _resolve(
    parameters: PlantParameters, settings: TuningSettings, bank: Bank | None, before: ActiveTuning | None
) -> ActiveTuning:
    """Return a checked tuning; reuses the models of ``before`` if they are the same.

    Raises OutOfRangeError.
    """
    settings = replace(settings, bank=0 if bank is None else bank.id)
    check_range("b", settings.b, 0.0, 1.0, "1", label="reference weight b")
    if before is not None and all(
        getattr(before.settings, name) == getattr(settings, name) for name in ("lam_motor", "b", "bank")
    ):
        previewer = before.previewer
    else:
        previewer = TuningPreviewer(parameters, list_point_models(bank), lam_motor=settings.lam_motor, b=settings.b)
    previewer.require_safe(settings.lambdas, settings.budget)
    require_share(settings.k_ext)
    return ActiveTuning(settings, bank, parameters, previewer)


def _build_motor_preview(robustness: Robustness) -> MotorPreview:
    return MotorPreview(
        M_s=robustness.M_s,
        gain_margin=_finite_or_none(robustness.gain_margin),
        gain_reduction_margin=robustness.gain_reduction or None,
        phase_margin_deg=_finite_or_none(degrees(robustness.phase_margin)),
    )


def _build_loop_preview(lam: float, predicted: preview.OuterLoopPreview) -> LoopPreview:
    robustness, printed = predicted.robustness, predicted.printed
    stable = robustness.stable
    return LoopPreview(
        lam=lam,
        lam_min=predicted.lam_min,
        lam_max=predicted.lam_max,
        stable=stable,
        M_s=robustness.M_s if stable else None,
        gain_margin=_finite_or_none(robustness.gain_margin) if stable else None,
        phase_margin_deg=_finite_or_none(degrees(robustness.phase_margin)) if stable else None,
        printed=None if printed is None else _build_printed_formula(printed),
    )


def _build_printed_formula(printed: preview.Printed) -> PrintedFormula:
    stable, step = printed.robustness.stable, printed.step
    return PrintedFormula(
        stable=stable,
        M_s=printed.robustness.M_s if stable else None,
        t=[] if step is None else step.t.tolist(),
        y=[] if step is None else step.y.tolist(),
    )


def _build_step_preview(step: StepForecast) -> StepPreview:
    return StepPreview(
        start=step.start,
        end=step.end,
        rise_s=_finite_or_none(step.t90_s),
        settling_s=_finite_or_none(step.settling_s),
        overshoot_percent=step.overshoot_percent,
        u_peak_V=step.peak_voltage,
        F_min_N=step.least_tension,
        t=step.t.tolist(),
        y=step.y.tolist(),
    )


def _build_push_preview(push: PushForecast) -> PushPreview:
    return PushPreview(
        give=push.deflection,
        t=push.t.tolist(),
        off=push.off.tolist(),
        back_s=_finite_or_none(push.recovery_s),
        felt_slow=push.apparent_stiffness_slow,
        felt_fast=push.apparent_stiffness_fast,
    )


def _finite_or_none(value: float) -> float | None:
    """Return None for an infinite margin, because JSON has no infinity."""
    return value if isfinite(value) else None


# Tuning store --------------------------------------------------------------------------------------
# Stores the operator's tuning at each change and restores it at the next start of the service.


class TuningStore:
    """Stores the operator's tuning as a setting in the database."""

    def __init__(self, database: Database) -> None:
        self._database = database

    def save(self, tuning: ActiveTuning, who: str) -> None:
        """Store a tuning that is now active.

        A write error is only logged, because the tuning is in use already.
        """
        try:
            tuning_settings.store_tuning(self._database, tuning.settings, tuning.parameters, who)
        except StorageError:
            _log.exception("The service could not store the active tuning for its next start.")

    def load_previous(self, tuning: ActiveTuning) -> ResolvedTuning | None:
        """Return the tuning that was active on this plant before ``tuning``.

        None if there was no other.
        """
        try:
            with self._database.reading() as session:
                settings = tuning_settings.load_earlier_tuning(session, tuning.settings, tuning.parameters)
                return None if settings is None else _resolve_bank(session, settings)
        except (SettingError, OutOfRangeError, UnknownRecordError, UnreadableDocumentError):
            _log.exception("The service cannot read the tuning before the active one.")
            return None

    def choose_for_parameters(self, now: ActiveTuning, parameters: PlantParameters) -> ActiveTuning:
        """Return the tuning for other ``parameters``.

        That is the last tuning used with them, else the active λ, else the default. A bank is used only with the
        parameters that its models were identified with. Raises TuningError if no tuning is safe.
        """
        last = self._load_last_for(parameters)
        for candidate in [*([last] if last else []), ResolvedTuning(replace(now.settings, bank=0), None)]:
            try:
                return make_active_tuning(parameters, replace(candidate.settings, k_ext=0.0), candidate.bank)
            except (OutOfRangeError, TuningError) as error:
                _log.warning("The active tuning does not fit the new parameters: %s", error)
        return default_tuning(parameters)[0]

    def _load_last_for(self, parameters: PlantParameters) -> ResolvedTuning | None:
        try:
            with self._database.reading() as session:
                settings = tuning_settings.load_tuning_of_plant(session, parameters)
                return None if settings is None else _resolve_bank(session, settings)
        except (SettingError, OutOfRangeError, UnknownRecordError, UnreadableDocumentError):
            _log.exception("The service cannot read the last tuning for these parameters.")
            return None

    def restore(self, parameters: PlantParameters) -> tuple[ActiveTuning, str]:
        """Return the tuning to start with, and a text for the event log, or empty.

        Returns the default if the stored tuning belongs to other parameters or cannot be used.
        """
        try:
            stored = tuning_settings.load_last_tuning(self._database, parameters)
            if stored is None:
                return default_tuning(parameters)
            if not stored.same_plant:
                return _fall_back(parameters, messages.tuning_of_other_parameters())
            with self._database.reading() as session:
                bank = None if stored.tuning.bank == 0 else banks.own(session, stored.tuning.bank)
            # Without disturbance rejection, because the bias is not calibrated yet.
            tuning = make_active_tuning(parameters, replace(stored.tuning, k_ext=0.0), bank)
        except (SettingError, OutOfRangeError, TuningError, UnknownRecordError, UnreadableDocumentError) as error:
            return _fall_back(parameters, messages.last_tuning_rejected(reason=str(error)))
        return tuning, _describe_restored(tuning, stored)


def _resolve_bank(session: Session, settings: TuningSettings) -> ResolvedTuning:
    return ResolvedTuning(settings, None if settings.bank == 0 else banks.own(session, settings.bank))


def _fall_back(parameters: PlantParameters, why: str) -> tuple[ActiveTuning, str]:
    """Return the default tuning, and a text with the reason ``why``."""
    tuning, moved = default_tuning(parameters)
    return tuning, messages.defaults_active(reason=why, moved=moved)


def _describe_restored(tuning: ActiveTuning, stored: LastTuning) -> str:
    bank = tuning.bank
    models = messages.models_in_use(bank=None if bank is None else (bank.name, bank.version))
    return messages.tuning_restored(who=stored.who, models=models, settings=tuning.settings.format())


# Tuning trial --------------------------------------------------------------------------------------
# A temporary tuning that reverts after a set time, independently of the page. It reverts earlier if
# the mode or the holder of control changes, because then no operator observes the trial.


_PART = Part("The timer of a tuning trial", "The earlier tuning is restored on time regardless.")


class TuningTrial:
    """Timer of a trial; at most one trial at a time."""

    def __init__(self, restore: Callable[[ActiveTuning, str], Awaitable[None]], supervision: Supervision) -> None:
        """Call ``restore`` at the end of each trial.

        It gets the tuning before the trial, and the cause, which is empty after the set time.
        """
        self._restore = restore
        self._supervision = supervision
        self._before: ActiveTuning | None = None
        self._ends = 0.0
        self._duration_s = 0.0
        self._timer: SupervisedTask | None = None
        self._cause: asyncio.Future[str] | None = None

    @property
    def before(self) -> ActiveTuning | None:
        """The tuning that is restored at the end; None without a trial."""
        return self._before

    def begin(self, before: ActiveTuning, duration_s: float) -> None:
        """Start a trial that restores ``before`` after ``duration_s`` [s]."""
        self.clear()
        self._before, self._duration_s = before, duration_s
        self._ends = asyncio.get_running_loop().time() + duration_s
        self._cause = asyncio.get_running_loop().create_future()
        self._timer = self._supervision.start_task(_PART, lambda: self._count_down(before))

    def clear(self) -> None:
        """End the trial without restoring the earlier tuning."""
        self._before = self._cause = None
        if self._timer is not None and not self._timer.is_current:
            self._timer.cancel()
        self._timer = None

    def end(self, cause: str) -> None:
        """Restore the earlier tuning now because of ``cause``.

        Does nothing without a trial.
        """
        if self._cause is not None and not self._cause.done():
            self._cause.set_result(cause)

    def view(self) -> TrialView | None:
        """Return the trial as the page shows it; None without one."""
        if self._before is None:
            return None
        return TrialView(
            **list_tuning_parts(self._before.settings),
            remaining_s=max(0.0, self._ends - asyncio.get_running_loop().time()),
            duration_s=self._duration_s,
        )

    async def _count_down(self, before: ActiveTuning) -> None:
        """Wait for the set time or a cause, then restore.

        Continues after a restart of the task by the supervision.
        """
        cause = self._cause
        if cause is None:
            return
        await asyncio.wait([cause], timeout=max(0.0, self._ends - asyncio.get_running_loop().time()))
        await self._restore(before, cause.result() if cause.done() else "")
