"""Changes of the tuning: by an operator, for a trial, or for a run.

And the tunings saved for banks.
"""

import asyncio
import logging
from collections import deque
from collections.abc import Awaitable, Callable
from dataclasses import replace

from backend.banks import TuningSettings, saved_tuning_key
from backend.errors import RequestRejectedError, check_range
from backend.event_bus import EventBus
from backend.models import SAVED_TUNING, SavedLoopSettings
from backend.realtime import BIAS_NOT_CALIBRATED, Accepted, LoopExitedError, SetTuning, Supervisor
from backend.schemas import (
    MarkKind,
    Motion,
    MotorPreview,
    RobustTuning,
    SavedTuning,
    TrialRequest,
    TrialView,
    TuningPreview,
    TuningRequest,
    TuningView,
)
from backend.services import background_work, messages
from backend.services.background_work import Compute, TuningSnapshot
from backend.services.contact import BiasDiscarded, ContactService
from backend.services.event_log import EventLog
from backend.services.state import LiveState
from backend.services.tuning_state import ActiveTuning, ResolvedTuning, TuningStore, TuningTrial, list_tuning_parts
from backend.storage import Bank, Database, StoredSetting, settings
from backend.supervision import Supervision
from backend.tuning import DEVIATIONS, UNSEEN_F
from plant import ErrorCode

# Tuning service ------------------------------------------------------------------------------------
# An operator changes the active tuning permanently or for a limited trial. A run can replace it by
# a temporary tuning: when the program of the run has ended, the operator's tuning is restored. Only
# the operator's tuning is stored for the next start of the service.


RETRY_S = 0.5
"""Time [s] until a tuning that the control loop has refused is restored again."""

_log = logging.getLogger(__name__)


class TuningService:
    """Changes the active tuning. Runs in the event loop of the service."""

    def __init__(
        self,
        supervisor: Supervisor,
        live_state: LiveState,
        event_log: EventLog,
        tuning_store: TuningStore,
        supervision: Supervision,
        send: Callable[[SetTuning], Awaitable[Accepted]],
        change_lock: asyncio.Lock,
        on_change: Callable[[], None],
        contact: ContactService,
        events: EventBus,
    ) -> None:
        """Send tunings with ``send``; ``change_lock`` is held during each change."""
        self._supervisor = supervisor
        self._live_state = live_state
        self._event_log = event_log
        self._tuning_store = tuning_store
        self._send = send
        self._change_lock = change_lock
        self._on_change = on_change
        self._contact = contact
        self._trial = TuningTrial(self._end_trial_automatically, supervision)
        events.subscribe(BiasDiscarded, lambda _: self._disable_rejection())
        live_state.reset_undo(tuning_store.load_previous(live_state.tuning))

    def view_trial(self) -> TrialView | None:
        """Return the trial in progress; None without one."""
        return self._trial.view()

    async def apply(self, request: TuningRequest, who: str) -> TuningView:
        """Change the active tuning permanently.

        Raises OutOfRangeError and RequestRejectedError without a change.
        """
        view = await self._change(request, who, self._apply_permanently)
        await self._store_active(who)
        return view

    async def start_trial(self, request: TrialRequest, who: str) -> None:
        """Change the active tuning for a trial.

        A trial during a trial reverts to the tuning before the first. Raises OutOfRangeError and RequestRejectedError
        without a change.
        """
        before = self._trial.before or self._live_state.tuning
        await self._change(request, who, self._send_tuning)
        self._trial.begin(before, request.duration_s)
        self._on_change()

    async def end_trial(self, keep: bool, who: str) -> None:
        """Keep the tuning of the trial, or revert now.

        Raises RequestRejectedError without a trial.
        """
        before = self._trial.before
        if before is None:
            raise RequestRejectedError(ErrorCode.NOT_NOW, messages.no_trial_is_active())
        if keep:
            self._trial.clear()
            self._push_undo(before)
            self._event_log.add_mark(MarkKind.TUNING, messages.trial_kept(), self._live_state.tick, who)
            await self._store_active(who)
        else:
            await self._end_trial(before, who)
        self._on_change()

    def cancel_trial(self, cause: str) -> None:
        """Revert a trial in progress because of ``cause``; does not wait for it."""
        self._trial.end(cause)

    async def use_bank(self, bank: Bank | None, who: str) -> TuningView:
        """Use the models of a bank, or geometric gains for None.

        Raises OutOfRangeError if λ is unsafe with them.
        """
        async with self._change_lock:
            self._require_no_override()
            before = self._live_state.tuning
            tick = await self._apply_permanently(await asyncio.to_thread(before.with_bank, bank))
            text = messages.models_in_use(bank=None if bank is None else (bank.name, bank.version))
            self._event_log.add_mark(MarkKind.BANK, text, tick, who)
        await self._store_active(who)
        return self._live_state.tuning.view(self._live_state.entry)

    async def undo(self, who: str) -> TuningView:
        """Restore the operator's tuning from before the last change.

        Each further call goes one change back. Raises RequestRejectedError if there is nothing to undo, and
        OutOfRangeError if that tuning is no longer safe.
        """
        stack, other = self._live_state.undo_stack, self._live_state.redo_stack
        return await self._move_between_stacks(stack, other, True, messages.nothing_to_undo(), who)

    async def redo(self, who: str) -> TuningView:
        """Restore the tuning that the last undo has replaced. Raises like ``undo``."""
        stack, other = self._live_state.redo_stack, self._live_state.undo_stack
        return await self._move_between_stacks(stack, other, False, messages.nothing_to_redo(), who)

    async def _move_between_stacks(
        self, stack: deque[ResolvedTuning], other: deque[ResolvedTuning], undo: bool, nothing: str, who: str
    ) -> TuningView:
        """Activate the newest tuning of ``stack`` and push the active one onto ``other``.

        ``undo`` selects the text for the event log; ``nothing`` is the message for an empty stack.
        """
        async with self._change_lock:
            self._require_no_override()
            if self._trial.before is not None:
                raise RequestRejectedError(ErrorCode.NOT_NOW, messages.trial_in_progress())
            if not stack:
                raise RequestRejectedError(ErrorCode.NOT_NOW, nothing)
            step, before = stack[-1], self._live_state.tuning
            after = await asyncio.to_thread(before.with_settings, step.settings, step.bank)
            tick = await self._send_tuning(after)
            stack.pop()
            other.append(before)
            self._on_change()
            difference = after.describe_difference(before)
            text = (
                messages.tuning_undone(difference=difference) if undo else messages.tuning_redone(difference=difference)
            )
            self._event_log.add_mark(MarkKind.TUNING, text, tick, who)
        await self._store_active(who)
        return self._live_state.tuning.view(self._live_state.entry)

    async def apply_temporary(self, settings: TuningSettings, bank: Bank | None, who: str) -> None:
        """Activate the tuning of a run; locked until ``restore_operator_tuning``.

        Raises OutOfRangeError and RequestRejectedError without a change.
        """
        async with self._change_lock:
            self._require_no_override()
            if self._trial.before is not None:
                raise RequestRejectedError(ErrorCode.NOT_NOW, messages.trial_in_progress())
            own = self._live_state.tuning
            if settings != own.settings:
                temporary = await asyncio.to_thread(own.with_settings, settings, bank)
                tick = await self._send_tuning(temporary)
                self._event_log.add_mark(
                    MarkKind.TUNING, messages.tuning_for_run(difference=temporary.describe_difference(own)), tick, who
                )
            self._live_state.overridden_tuning = own
        self._on_change()

    async def restore_operator_tuning(self) -> None:
        """Restore the operator's tuning after a run; repeats it until accepted."""
        own = self._live_state.overridden_tuning
        if own is not None:
            await self._retry_restore(messages.tuning_of_operator(), own, lambda: self._restore_after_run(own))
        self._on_change()

    async def preview(
        self,
        lam_q: float,
        lam_S: float,
        S: float | None = None,
        *,
        motion: Motion | None = None,
        u_plan: float | None = None,
        k_ext: float | None = None,
        printed: bool = False,
        compute: Compute,
    ) -> TuningPreview:
        """Predict robustness and step responses of a tuning.

        Args:
            lam_q: Tuning parameter of the position loop [s].
            lam_S: Tuning parameter of the stiffness loop [s].
            S: Stiffness [N·m/rad]; None for the current reference.
            motion: Motion; None for the active one.
            u_plan: Feed-forward voltage limit [V]; None for the active one.
            k_ext: Gain of the disturbance rejection; None for the active one.
            printed: Whether to add the prediction of the formula printed in the paper.
            compute: Runs the computation in a worker process.

        Raises OutOfRangeError.

        """
        live_state, bounds = self._live_state, self._live_state.bounds
        if S is None:
            S_ref = live_state.references.S_ref
            S = bounds.S_min if S_ref is None else min(max(S_ref, bounds.S_min), bounds.S_max)
        check_range("S_ref", S, bounds.S_min, bounds.S_max, "N·m/rad")
        snapshot = TuningSnapshot.from_active(live_state.tuning)
        arguments = lam_q, lam_S, S, live_state.entry, motion, u_plan, k_ext, printed
        preview: TuningPreview = await compute(background_work.preview_tuning, snapshot, *arguments)
        return preview

    async def preview_motor(self, lam_motor: float, compute: Compute) -> MotorPreview:
        """Return the robustness of the motor loops at ``lam_motor`` [s]."""
        snapshot = TuningSnapshot.from_active(self._live_state.tuning)
        preview: MotorPreview = await compute(background_work.preview_motor, snapshot, lam_motor)
        return preview

    async def compute_robust_tuning(self, M_s: float, compute: Compute) -> RobustTuning:
        """Return the λ of each loop that gives the sensitivity peak ``M_s``."""
        snapshot = TuningSnapshot.from_active(self._live_state.tuning)
        robust: RobustTuning = await compute(background_work.compute_robust_tuning, snapshot, M_s)
        return robust

    async def _change(
        self, request: TuningRequest, who: str, activate: Callable[[ActiveTuning], Awaitable[int]]
    ) -> TuningView:
        async with self._change_lock:
            self._require_no_override()
            before = self._live_state.tuning
            after = await asyncio.to_thread(before.with_request, request)
            tick = await activate(after)
            self._event_log.add_mark(MarkKind.TUNING, after.describe_difference(before), tick, who)
        return after.view(self._live_state.entry)

    def _disable_rejection(self) -> None:
        """Show disturbance rejection as off after the bias was discarded.

        The control loop has turned it off itself.
        """
        live_state = self._live_state
        if live_state.tuning.settings.k_ext == 0.0:
            return
        live_state.tuning = live_state.tuning.without_rejection()
        self._supervisor.setup = replace(self._supervisor.setup, tuning=live_state.tuning.build_command())
        self._event_log.add_mark(MarkKind.TUNING, messages.rejection_disabled(), live_state.tick)
        self._on_change()

    def _drop_unusable_rejection(self, tuning: ActiveTuning) -> ActiveTuning:
        """Return a tuning without disturbance rejection if the bias is not calibrated."""
        return tuning if self._contact.points else tuning.without_rejection()

    def _require_known_bias(self, tuning: ActiveTuning) -> None:
        """Raise RequestRejectedError if the external force is not known well enough.

        Disturbance rejection needs a calibrated bias and an estimate with little noise.
        """
        if tuning.settings.k_ext == 0.0:
            return
        points = self._contact.points
        if not points:
            raise RequestRejectedError(ErrorCode.NOT_NOW, BIAS_NOT_CALIBRATED)
        noise = max(point.std_N for point in points)
        if not noise <= UNSEEN_F / DEVIATIONS:
            raise RequestRejectedError(
                ErrorCode.NOT_NOW,
                messages.rejection_within_noise(std_N=noise, threshold_N=UNSEEN_F, factor=DEVIATIONS),
            )

    async def _retry_restore(self, what: str, tuning: ActiveTuning, restore: Callable[[], Awaitable[None]]) -> None:
        """Call ``restore`` until it succeeds.

        Meanwhile the state shows that ``tuning`` is not restored.
        """
        try:
            while True:
                try:
                    return await restore()
                except Exception as error:
                    # For example, the control loop is restarting. The tuning must be restored in any case.
                    _log.exception("The service could not restore %s yet.", what)
                    difference = tuning.describe_difference(self._live_state.tuning)
                    self._live_state.tuning_problem = messages.tuning_not_restored(
                        tuning=what, difference=difference, reason=str(error), retry_s=RETRY_S
                    )
                    self._on_change()
                    await asyncio.sleep(RETRY_S)
        finally:
            if self._live_state.tuning_problem:
                self._live_state.tuning_problem = ""
                self._on_change()

    async def _restore_after_run(self, own: ActiveTuning) -> None:
        async with self._change_lock:
            if self._live_state.overridden_tuning is not own:  # restored by another task meanwhile
                return
            temporary, restored = self._live_state.tuning, self._drop_unusable_rejection(own)
            if restored.settings != temporary.settings:
                try:
                    is_alive = self._supervisor.is_alive
                    tick = await self._send_tuning(restored) if is_alive else self._set_active(restored)
                except LoopExitedError:
                    tick = self._set_active(restored.without_rejection())
                self._event_log.add_mark(
                    MarkKind.TUNING, messages.tuning_after_run(difference=restored.describe_difference(temporary)), tick
                )
            self._live_state.overridden_tuning = None

    async def _end_trial_automatically(self, before: ActiveTuning, cause: str) -> None:
        await self._retry_restore(messages.tuning_before_trial(), before, lambda: self._end_trial(before, cause=cause))

    async def _end_trial(self, before: ActiveTuning, who: str = "", cause: str = "") -> None:
        async with self._change_lock:
            tried = self._live_state.tuning
            if self._trial.before is not before:  # the operator has changed the tuning meanwhile
                return
            restored = self._drop_unusable_rejection(before)
            tick = await self._send_tuning(restored) if self._supervisor.is_alive else self._set_active(restored)
            text = messages.trial_ended(cause=cause, difference=restored.describe_difference(tried))
            self._event_log.add_mark(MarkKind.TUNING, text, tick, who)

    def _require_no_override(self) -> None:
        """Raise RequestRejectedError while a run has replaced the operator's tuning."""
        if self._live_state.overridden_tuning is None:
            return
        task = self._live_state.task
        raise RequestRejectedError(
            ErrorCode.NOT_NOW,
            messages.starting_run_contains_tuning() if task is None else messages.run_contains_tuning(kind=task.kind),
        )

    async def _store_active(self, who: str) -> None:
        """Store the operator's tuning for the next start of the service.

        Not called for a trial or a temporary tuning.
        """
        await asyncio.to_thread(self._tuning_store.save, self._live_state.tuning, who)

    async def _apply_permanently(self, tuning: ActiveTuning) -> int:
        """Activate an operator's tuning, which ``undo`` can revert; return its tick."""
        before = self._trial.before or self._live_state.tuning
        tick = await self._send_tuning(tuning)
        if tuning.settings != before.settings:
            self._push_undo(before)
            self._on_change()
        return tick

    def _push_undo(self, before: ResolvedTuning) -> None:
        """Let ``undo`` return to ``before``, and clear what ``redo`` could restore."""
        self._live_state.undo_stack.append(before)
        self._live_state.redo_stack.clear()

    async def _send_tuning(self, tuning: ActiveTuning) -> int:
        self._require_known_bias(tuning)
        accepted = await self._send(tuning.build_command())
        self._set_active(tuning)
        return accepted.tick

    def _set_active(self, tuning: ActiveTuning) -> int:
        """Store ``tuning`` as the active one, also for a restarted loop process.

        Returns the tick of the change.
        """
        self._trial.clear()
        self._live_state.tuning = tuning
        self._supervisor.setup = replace(self._supervisor.setup, tuning=tuning.build_command())
        self._on_change()
        return self._live_state.tick


# Saved tunings -------------------------------------------------------------------------------------
# The tuning that an operator has saved for each bank, as settings in the database.


class SavedTunings:
    """Reads and writes saved tunings.

    The methods access the database: the event loop calls them in a thread.
    """

    def __init__(self, database: Database) -> None:
        self._database = database

    def load(self, tuning: ActiveTuning) -> SavedTuning:
        """Return the tuning saved for the active bank.

        Without one, the default on its models.
        """
        with self._database.reading() as session:
            stored = settings.newest(session, _get_setting_name(tuning))
        if stored is not None:
            return _read_saved(stored)
        default = tuning.compute_default()
        return SavedTuning(**list_tuning_parts(default.tuning), who=None, at=None, moved=default.moved)

    def save(self, tuning: ActiveTuning, who: str) -> SavedTuning:
        """Save the active tuning for the active bank.

        Earlier values remain in the history of the setting.
        """
        parts = SAVED_TUNING.write(SavedLoopSettings(**list_tuning_parts(tuning.settings)))
        with self._database.session() as session:
            stored = settings.save(session, _get_setting_name(tuning), parts, who)
        return _read_saved(stored)


def _read_saved(stored: StoredSetting) -> SavedTuning:
    saved = SAVED_TUNING.read(stored.value, f"setting “{stored.name}”")
    return SavedTuning(
        **list_tuning_parts(TuningSettings.from_values(saved.get_known_values())),
        who=stored.who,
        at=stored.at,
        moved="",
    )


def _get_setting_name(tuning: ActiveTuning) -> str:
    return saved_tuning_key(None if tuning.bank is None else tuning.bank.id)
