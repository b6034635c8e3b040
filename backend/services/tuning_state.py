"""The tuning in use: trials of it, what follows from it, and what is kept of it."""

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
from backend.storage import Bank, Database, StorageError, UnknownRecordError, active_entry_name, banks
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

# Kept figures --------------------------------------------------------------------------------------
#
# What was computed once for a tuning outlives the process: a start neither loads python-control nor
# computes anew.
#
# A file beside the compiled functions, named after the sources and the libraries that compute: with
# others it is another file. Whoever finds it damaged, or of another form, computes anew.


_SOURCES = ("plant/*.py", "backend/control/*.py", "backend/tuning/*.py")
_LIBRARIES = ("numpy", "scipy", "control", "numba")
_ROOT = Path(__file__).resolve().parents[2]
_log = logging.getLogger(__name__)


class RobustnessCache:
    """The file of ``robustness.FIGURES`` in a ``folder``, that of caches where none is given; None without either."""

    def __init__(self, folder: Path | None = None) -> None:
        place = folder or (None if CACHE is None else CACHE.parent)
        self.file = None if place is None else place / f"figures-{_digest_of_what_computes()[:16]}.json"
        self._kept: dict[str, tuple[float, ...]] = {}

    def load(self) -> None:
        """Remember what is kept, if it can be read."""
        if self.file is None:
            return
        try:
            self._kept = _read(self.file.read_text(encoding="ascii"))
        except FileNotFoundError:
            return
        except (OSError, ValueError, TypeError, KeyError, AttributeError) as error:
            _log.warning("The service cannot use %s and computes its figures anew: %s", self.file, error)
            return
        FIGURES.update(self._kept)

    def save(self) -> None:
        """Write down what is remembered, where that is not what the file holds; a disk that refuses is no matter."""
        live_state = dict(FIGURES)
        if self.file is None or live_state == self._kept:
            return
        content = {key: list(figures) for key, figures in live_state.items()}
        try:
            self.file.parent.mkdir(parents=True, exist_ok=True)
            write_private(self.file, json.dumps({"figures": content, "digest": _digest(content)}))
        except OSError as error:
            _log.info("The service cannot write %s, so that its next start takes longer: %s", self.file, error)
        else:
            self._kept = live_state


def _read(text: str) -> dict[str, tuple[float, ...]]:
    """Return the figures of a file. Raises ValueError and its like where it is damaged."""
    document = json.loads(text)
    content = document["figures"]
    if document["digest"] != _digest(content):
        raise ValueError("its digest is another one")
    return {str(key): tuple(map(float, figures)) for key, figures in content.items()}


def _digest(content: object) -> str:
    return hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()


def _digest_of_what_computes() -> str:
    digest = hashlib.sha256(sys.version.encode())
    for library in _LIBRARIES:
        digest.update(f"{library} {version(library)} ".encode())
    for pattern in _SOURCES:
        for source in sorted(_ROOT.glob(pattern)):
            digest.update(source.read_bytes())
    return digest.hexdigest()


# Tuning in use -------------------------------------------------------------------------------------
#
# The tuning in force: λ, the bank whose models it is applied to, and what follows from both.


@dataclass(frozen=True)
class ResolvedTuning:
    """A choice with the bank that it names, None for gains from geometry."""

    choice: TuningSettings
    bank: Bank | None


@dataclass(frozen=True)
class ActiveTuning(ResolvedTuning):
    """A choice with the models that its bank stands for; without a bank the models follow from geometry."""

    parameters: PlantParameters
    previewer: TuningPreviewer

    @property
    def lambdas(self) -> TuningParameters:
        """The tuning parameters and b alone."""
        return self.choice.lambdas

    def command(self) -> SetTuning:
        """Return what tells the loop."""
        return build_tuning_command(self.parameters, self.choice, self.bank)

    def with_request(self, request: TuningRequest) -> "ActiveTuning":
        """Return the tuning after ``request``. Raises OutOfRangeError; takes a while where models change."""
        wanted = request.model_dump(exclude_none=True, include=set(TuningParts.model_fields))
        return self.with_choice(self.choice.replace_values(wanted), self.bank)

    def with_choice(self, choice: TuningSettings, bank: Bank | None) -> "ActiveTuning":
        """Return another tuning of the same plant, ``bank`` being what the choice names.

        Raises OutOfRangeError where a λ is not safe on its models.
        """
        return _resolve(self.parameters, choice, bank, self)

    def with_bank(self, bank: Bank | None) -> "ActiveTuning":
        """Return the tuning with another bank. Raises OutOfRangeError where a λ is not safe on its models."""
        return self.with_choice(self.choice, bank)

    def without_rejection(self) -> "ActiveTuning":
        """Return the tuning with pushes left to the position loop."""
        return replace(self, choice=replace(self.choice, k_ext=0.0))

    def difference(self, before: "ActiveTuning") -> str:
        """Return in words what differs from ``before``."""
        return ", ".join(self.choice.list_differences(before.choice)) or "the same tuning again"

    def default(self) -> DefaultTuning:
        """Return what would be in force on these models where nobody had chosen; takes a while at another λ_motor."""
        return compute_default_tuning(self.parameters, list_point_models(self.bank), self.previewer)

    def view(self, entry: float) -> TuningView:
        """Return what the page shows; ``entry`` is the active entry of the bank."""
        lam_q_min, lam_S_min = self.previewer.safe_range()
        lam_motor_min, lam_motor_max = self.previewer.motor_range()
        u_plan_min, u_plan_max = self.previewer.plan_range()
        return TuningView(
            **list_tuning_parts(self.choice),
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
        """Predict what these λ would do at S [N·m/rad]: robustness, a step of each reference, a held push.

        ``entry``: bank entry in use at present, −1 for the one nearest to S. ``motion``, ``u_plan`` [V], ``k_ext``
        [1]: None as now. ``steps``: other steps than the usual ones. ``printed``: with the printed formula beside it.
        Raises OutOfRangeError for a voltage limit or a share of the push that is not offered.
        """
        lambdas = replace(self.lambdas, lam_q=lam_q, lam_S=lam_S)
        wanted = {name: value for name, value in (("motion", motion), ("u_plan", u_plan)) if value is not None}
        budget = self.choice.replace_values(wanted).budget
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

    def preview_motor(self, lam_motor: float) -> MotorPreview:
        """Return how robust the motor loops are at this λ. Raises OutOfRangeError for one that is not offered."""
        return _motor(self.previewer.motor_at(lam_motor))

    def compute_robust_tuning(self, M_s: float) -> RobustTuning:
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


def make_active_tuning(parameters: PlantParameters, choice: TuningSettings, bank: Bank | None = None) -> ActiveTuning:
    """Return a tuning to start from, ``bank`` being what the choice names. Raises OutOfRangeError."""
    return _resolve(parameters, choice, bank, None)


def default_tuning(parameters: PlantParameters) -> tuple[ActiveTuning, str]:
    """Return the tuning where nobody has chosen one, and what to say of it: empty where it is the method's."""
    default = compute_default_tuning(parameters)
    return ActiveTuning(default.tuning, None, parameters, default.previewer), default.moved


def list_tuning_parts(choice: TuningSettings) -> dict[str, Any]:
    """Return the parts of a tuning that ``schemas.tuning.TuningParts`` shows; the bank is shown beside them."""
    return {name: value for name, value in choice.to_document().items() if name != "bank"}


def build_chosen_tuning(tuning: ResolvedTuning) -> ChosenTuning:
    """Return a tuning with its bank, as the page shows one that is not in force."""
    return ChosenTuning(**list_tuning_parts(tuning.choice), bank=_reference(tuning.bank))


def overlay_tuning(view: TuningView, chosen: ResolvedTuning, entry: float) -> TuningView:
    """Return what the page shows of a tuning with parts and bank of another one; ``entry`` is the active one."""
    bank = chosen.bank
    name = "" if bank is None else active_entry_name(bank.entries, entry)
    parts = {**list_tuning_parts(chosen.choice), "bank": _reference(bank), "entry": entry, "entry_name": name}
    return view.model_copy(update=parts)


def _reference(bank: Bank | None) -> BankReference | None:
    return None if bank is None else BankReference(id=bank.id, name=bank.name, version=bank.version)


def _resolve(
    parameters: PlantParameters, choice: TuningSettings, bank: Bank | None, before: ActiveTuning | None
) -> ActiveTuning:
    choice = replace(choice, bank=0 if bank is None else bank.id)
    check_range("b", choice.b, 0.0, 1.0, "1", words="weight b of the reference")
    if before is not None and all(
        getattr(before.choice, name) == getattr(choice, name) for name in ("lam_motor", "b", "bank")
    ):
        previewer = before.previewer
    else:
        previewer = TuningPreviewer(parameters, list_point_models(bank), lam_motor=choice.lam_motor, b=choice.b)
    previewer.require_safe(choice.lambdas, choice.budget)
    require_share(choice.k_ext)
    return ActiveTuning(choice, bank, parameters, previewer)


def _loop(lam: float, predicted: preview.OuterLoopPreview) -> LoopPreview:
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
        give=push.deflection,
        t=push.t.tolist(),
        off=push.off.tolist(),
        back_s=_finite(push.recovery_s),
        felt_slow=push.felt_slow,
        felt_fast=push.felt_fast,
    )


def _finite(value: float) -> float | None:
    """Return None for an unlimited margin: JSON has no infinity."""
    return value if isfinite(value) else None


# Kept tuning ---------------------------------------------------------------------------------------
#
# The tuning in force outlives the service: kept at each change, in force again at the next start.


class TuningStore:
    """Writes and reads the tuning in force as a setting in the database."""

    def __init__(self, database: Database) -> None:
        self._database = database

    def save(self, tuning: ActiveTuning, who: str) -> None:
        """Keep a tuning that has come into force; where the disk refuses, the loop goes on and the log says so."""
        try:
            tuning_settings.store_tuning(self._database, tuning.choice, tuning.parameters, who)
        except StorageError:
            _log.exception("The service could not store the active tuning for its next start.")

    def load_previous(self, tuning: ActiveTuning) -> ResolvedTuning | None:
        """Return what was in force before ``tuning`` came into force on this plant; None where nothing else was."""
        try:
            with self._database.reading() as session:
                choice = tuning_settings.load_earlier_tuning(session, tuning.choice, tuning.parameters)
                if choice is None:
                    return None
                return ResolvedTuning(choice, None if choice.bank == 0 else banks.own(session, choice.bank))
        except (SettingError, OutOfRangeError, UnknownRecordError, UnreadableDocumentError):
            _log.exception("The service cannot read the tuning before the active one.")
            return None

    def choose_for_parameters(self, now: ActiveTuning, parameters: PlantParameters) -> ActiveTuning:
        """Return what to go on with on other ``parameters``: what they were left with, else λ as it is, else defaults.

        A bank stays with the parameters that its models were made with. Raises TuningError where nothing is safe.
        """
        left = self._load_last_for(parameters)
        for choice in [*([left] if left else []), ResolvedTuning(replace(now.choice, bank=0), None)]:
            try:
                return make_active_tuning(parameters, replace(choice.choice, k_ext=0.0), choice.bank)
            except (OutOfRangeError, TuningError) as error:
                _log.warning("The active tuning does not fit the new parameters: %s", error)
        return default_tuning(parameters)[0]

    def _load_last_for(self, parameters: PlantParameters) -> ResolvedTuning | None:
        try:
            with self._database.reading() as session:
                choice = tuning_settings.load_tuning_of_plant(session, parameters)
                if choice is None:
                    return None
                return ResolvedTuning(choice, None if choice.bank == 0 else banks.own(session, choice.bank))
        except (SettingError, OutOfRangeError, UnknownRecordError, UnreadableDocumentError):
            _log.exception("The service cannot read the last tuning for these parameters.")
            return None

    def restore(self, parameters: PlantParameters) -> tuple[ActiveTuning, str]:
        """Return what to start with, and a sentence on it for the journal; mostly empty on a new data folder.

        What was kept for other parameters, or cannot be used any more, gives way to the defaults.
        """
        try:
            kept = tuning_settings.load_last_tuning(self._database, parameters)
            if kept is None:
                return default_tuning(parameters)
            if not kept.same_plant:
                return _defaults(parameters, "the tuning of last time was for other parameters")
            with self._database.reading() as session:
                bank = None if kept.tuning.bank == 0 else banks.own(session, kept.tuning.bank)
            tuning = make_active_tuning(parameters, replace(kept.tuning, k_ext=0.0), bank)  # as nothing is learned yet
        except (SettingError, OutOfRangeError, TuningError, UnknownRecordError, UnreadableDocumentError) as error:
            return _defaults(parameters, f"the tuning of last time is refused, {error}")
        return tuning, _describe_restored(tuning, kept)


def _defaults(parameters: PlantParameters, why: str) -> tuple[ActiveTuning, str]:
    tuning, moved = default_tuning(parameters)
    return tuning, f"defaults in force: {why}" + (f"; {moved}" if moved else "")


def _describe_restored(tuning: ActiveTuning, kept: LastTuning) -> str:
    bank = tuning.bank
    models = "gains from geometry" if bank is None else f"bank {bank.name}, version {bank.version}"
    return f"in force again as {kept.who} left it: {models}, {tuning.choice.format()}"


# Tuning trial --------------------------------------------------------------------------------------
#
# A tuning in force for a while only: the service puts the earlier one back, whatever has become of
# the page.
#
# A trial ends at its time, or earlier when the mode or the person in control changes: nobody
# watches it any more then.


_PART = Part("The clock of a tuning on trial", "The earlier tuning is put back at its time all the same.")


class TuningTrial:
    """At most one trial at a time. ``put_back`` gets a tuning to put in force again and why the trial ends."""

    def __init__(self, put_back: Callable[[ActiveTuning, str], Awaitable[None]], supervision: Supervision) -> None:
        self._put_back = put_back
        self._supervision = supervision
        self._before: ActiveTuning | None = None
        self._ends = 0.0
        self._duration_s = 0.0
        self._timer: SupervisedTask | None = None
        self._cause: asyncio.Future[str] | None = None

    @property
    def before(self) -> ActiveTuning | None:
        """What comes back at the end; None while nothing is tried."""
        return self._before

    def begin(self, before: ActiveTuning, duration_s: float) -> None:
        """Count down from ``duration_s`` [s], then put ``before`` back."""
        self.forget()
        self._before, self._duration_s = before, duration_s
        self._ends = asyncio.get_running_loop().time() + duration_s
        self._cause = asyncio.get_running_loop().create_future()
        self._timer = self._supervision.start_task(_PART, lambda: self._count_down(before))

    def forget(self) -> None:
        """Let what is in force stay."""
        self._before = self._cause = None
        if self._timer is not None and not self._timer.is_current:
            self._timer.cancel()
        self._timer = None

    def end(self, cause: str) -> None:
        """Put back what was before at once, because of ``cause``; nothing happens where nothing is on trial."""
        if self._cause is not None and not self._cause.done():
            self._cause.set_result(cause)

    def view(self) -> TrialView | None:
        """Return what the page shows of it."""
        if self._before is None:
            return None
        return TrialView(
            **list_tuning_parts(self._before.choice),
            remaining_s=max(0.0, self._ends - asyncio.get_running_loop().time()),
            duration_s=self._duration_s,
        )

    async def _count_down(self, before: ActiveTuning) -> None:
        """Wait for the time or for a cause; a task that is started again after it died finds what is left of both."""
        cause = self._cause
        if cause is None:
            return
        await asyncio.wait([cause], timeout=max(0.0, self._ends - asyncio.get_running_loop().time()))
        await self._put_back(before, cause.result() if cause.done() else "")
