"""Changes of the tuning, and the tunings saved for banks."""

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
from backend.services import background_work
from backend.services.background_work import Compute, TuningSnapshot
from backend.services.contact import BiasDiscarded, ContactService
from backend.services.event_log import EventLog
from backend.services.state import LiveState
from backend.services.tuning_state import ActiveTuning, ResolvedTuning, TuningStore, TuningTrial, list_tuning_parts
from backend.storage import Bank, Database, StoredSetting, settings
from backend.supervision import Supervision
from backend.tuning import DEVIATIONS, UNSEEN_F
from plant import ErrorCode

# Retuning ------------------------------------------------------------------------------------------
#
# Changes of the tuning in force: by a person for good or on trial, and lent to a run that asks for
# its own.
#
# What a run asks for is in force until its program has ended; then what the operator had chosen
# comes back. Only the operator's tuning outlives the service.


RETRY_S = 0.5
"""How soon it is tried again to put a tuning back that the loop did not take [s]."""

_log = logging.getLogger(__name__)


class TuningService:
    """Belongs to the service's event loop. ``send`` hands a tuning to the loop; ``turn`` is held by who changes it."""

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
        """Return what is on trial; None for nothing."""
        return self._trial.view()

    async def apply(self, request: TuningRequest, who: str) -> TuningView:
        """Change the tuning while the loop runs. Raises OutOfRangeError; nothing changes then."""
        view = await self._change(request, who, self._apply_permanently)
        await self._store_active(who)
        return view

    async def start_trial(self, request: TrialRequest, who: str) -> None:
        """Change the tuning for a while. Raises OutOfRangeError. A trial of a trial goes back to before the first."""
        before = self._trial.before or self._live_state.tuning
        await self._change(request, who, self._send_tuning)
        self._trial.begin(before, request.duration_s)
        self._on_change()

    async def end_trial(self, keep: bool, who: str) -> None:
        """Keep what is tried, or go back at once. Raises RequestRejectedError when nothing is on trial."""
        before = self._trial.before
        if before is None:
            raise RequestRejectedError(ErrorCode.NOT_NOW, "nothing is on trial: what is in force stays")
        if keep:
            self._trial.forget()
            self._push_undo(before)
            self._event_log.add_mark(MarkKind.TUNING, "trial kept", self._live_state.tick, who)
            await self._store_active(who)
        else:
            await self._end_trial(before, who)
        self._on_change()

    def cancel_trial(self, cause: str) -> None:
        """End a trial because of ``cause``; returns at once, and does nothing where nothing is on trial."""
        self._trial.end(cause)

    async def use_bank(self, bank: Bank | None, who: str) -> TuningView:
        """Use the models of a bank, None for those of geometry. Raises OutOfRangeError when λ is not safe on them."""
        async with self._change_lock:
            self._require_no_override()
            before = self._live_state.tuning
            tick = await self._apply_permanently(await asyncio.to_thread(before.with_bank, bank))
            said = "gains from geometry" if bank is None else f"bank {bank.name}, version {bank.version}"
            self._event_log.add_mark(MarkKind.BANK, said, tick, who)
        await self._store_active(who)
        return self._live_state.tuning.view(self._live_state.entry)

    async def undo(self, who: str) -> TuningView:
        """Put back in force what the operator had before the last change; once more goes one change further back.

        Raises RequestRejectedError where there is nothing to undo, OutOfRangeError where it would not be safe any more.
        """
        stack, other = self._live_state.undo_stack, self._live_state.redo_stack
        return await self._move_between_stacks(stack, other, "undone", "no change of the tuning is left to undo", who)

    async def redo(self, who: str) -> TuningView:
        """Put in force again what the last undo took back. Raises like ``undo``."""
        stack, other = self._live_state.redo_stack, self._live_state.undo_stack
        return await self._move_between_stacks(stack, other, "done again", "no change of the tuning was undone", who)

    async def _move_between_stacks(
        self, stack: deque[ResolvedTuning], other: deque[ResolvedTuning], done: str, nothing: str, who: str
    ) -> TuningView:
        """Put in force the newest tuning of a stack; what was in force goes onto the other one."""
        async with self._change_lock:
            self._require_no_override()
            if self._trial.before is not None:
                raise RequestRejectedError(ErrorCode.NOT_NOW, "a tuning is on trial: keep it or revert it first")
            if not stack:
                raise RequestRejectedError(ErrorCode.NOT_NOW, nothing)
            step, before = stack[-1], self._live_state.tuning
            after = await asyncio.to_thread(before.with_choice, step.choice, step.bank)
            tick = await self._send_tuning(after)
            stack.pop()
            other.append(before)
            self._on_change()
            self._event_log.add_mark(MarkKind.TUNING, f"{done}: {after.difference(before)}", tick, who)
        await self._store_active(who)
        return self._live_state.tuning.view(self._live_state.entry)

    async def apply_temporary(self, choice: TuningSettings, bank: Bank | None, who: str) -> None:
        """Put in force what a run asks for, until ``give_back``; nobody changes the tuning meanwhile.

        Raises OutOfRangeError and RequestRejectedError; nothing changes then.
        """
        async with self._change_lock:
            self._require_no_override()
            if self._trial.before is not None:
                raise RequestRejectedError(ErrorCode.NOT_NOW, "a tuning is on trial: keep it or revert it first")
            own = self._live_state.tuning
            if choice != own.choice:
                wanted = await asyncio.to_thread(own.with_choice, choice, bank)
                tick = await self._send_tuning(wanted)
                self._event_log.add_mark(MarkKind.TUNING, f"for the run: {wanted.difference(own)}", tick, who)
            self._live_state.overridden_tuning = own
        self._on_change()

    async def restore_operator_tuning(self) -> None:
        """Put the operator's tuning back in force; does so as soon as the loop takes it."""
        own = self._live_state.overridden_tuning
        if own is not None:
            await self._retry_restore("The operator's tuning", own, lambda: self._restore_after_run(own))
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
        """Predict what λ, a motion, its limit [V] and a share of pushes would do at S [N·m/rad]; None: as now.

        Raises OutOfRangeError for a stiffness, a limit or a share that is not offered.
        """
        live_state, bounds = self._live_state, self._live_state.bounds
        if S is None:
            S_ref = live_state.references.S_ref
            S = bounds.S_min if S_ref is None else min(max(S_ref, bounds.S_min), bounds.S_max)
        check_range("S_ref", S, bounds.S_min, bounds.S_max, "N·m/rad")
        snapshot = TuningSnapshot.from_active(live_state.tuning)
        wanted = lam_q, lam_S, S, live_state.entry, motion, u_plan, k_ext, printed
        previewed: TuningPreview = await compute(background_work.preview_tuning, snapshot, *wanted)
        return previewed

    async def preview_motor(self, lam_motor: float, compute: Compute) -> MotorPreview:
        """Tell how robust the motor loops are at a λ."""
        found: MotorPreview = await compute(
            background_work.preview_motor, TuningSnapshot.from_active(self._live_state.tuning), lam_motor
        )
        return found

    async def compute_robust_tuning(self, M_s: float, compute: Compute) -> RobustTuning:
        """Find the λ of each loop for a wanted M_s."""
        found: RobustTuning = await compute(
            background_work.compute_robustness, TuningSnapshot.from_active(self._live_state.tuning), M_s
        )
        return found

    async def _change(
        self, request: TuningRequest, who: str, put: Callable[[ActiveTuning], Awaitable[int]]
    ) -> TuningView:
        async with self._change_lock:
            self._require_no_override()
            before = self._live_state.tuning
            after = await asyncio.to_thread(before.with_request, request)
            tick = await put(after)
            self._event_log.add_mark(MarkKind.TUNING, after.difference(before), tick, who)
        return after.view(self._live_state.entry)

    def _disable_rejection(self) -> None:
        """Show that pushes are left to the position loop: what was learned is gone, and the loop does so by itself."""
        live_state = self._live_state
        if live_state.tuning.choice.k_ext == 0.0:
            return
        live_state.tuning = live_state.tuning.without_rejection()
        self._supervisor.setup = replace(self._supervisor.setup, tuning=live_state.tuning.command())
        self._event_log.add_mark(
            MarkKind.TUNING, "pushes are not rejected any more: what was learned is gone", live_state.tick
        )
        self._on_change()

    def _drop_unusable_rejection(self, tuning: ActiveTuning) -> ActiveTuning:
        """Return what can come back into force of a tuning."""
        return tuning if self._contact.points else tuning.without_rejection()

    def _require_known_bias(self, tuning: ActiveTuning) -> None:
        """Raise RequestRejectedError for a rejection of a force that is not known, or not well enough."""
        if tuning.choice.k_ext == 0.0:
            return
        points = self._contact.points
        if not points:
            raise RequestRejectedError(ErrorCode.NOT_NOW, BIAS_NOT_CALIBRATED)
        noise = max(point.std_N for point in points)
        if not noise <= UNSEEN_F / DEVIATIONS:
            raise RequestRejectedError(
                ErrorCode.NOT_NOW,
                f"a rejection is refused: the estimate itself moves by {noise:.4g} N (standard deviation), and what is "
                f"left to the position loop, {UNSEEN_F:g} N, has to be {DEVIATIONS:g} times that",
            )

    async def _retry_restore(self, what: str, tuning: ActiveTuning, restore: Callable[[], Awaitable[None]]) -> None:
        """Call ``restore`` until it works; meanwhile the problems of the state tell what is not back in force."""
        try:
            while True:
                try:
                    return await restore()
                except Exception as error:
                    # A loop that is being restarted refuses for a moment; what was promised to come back does.
                    _log.exception("The service could not restore %s yet.", what)
                    self._live_state.tuning_problem = (
                        f"{what} ({tuning.difference(self._live_state.tuning)}) is not back in force: {error}. "
                        f"It is tried again every {RETRY_S:g} s. If this stays, stop softly and start the service "
                        "again: it starts with the operator's tuning."
                    )
                    self._on_change()
                    await asyncio.sleep(RETRY_S)
        finally:
            if self._live_state.tuning_problem:
                self._live_state.tuning_problem = ""
                self._on_change()

    async def _restore_after_run(self, own: ActiveTuning) -> None:
        async with self._change_lock:
            if self._live_state.overridden_tuning is not own:  # given back by another road while this waited
                return
            lent, back = self._live_state.tuning, self._drop_unusable_rejection(own)
            if back.choice != lent.choice:
                try:
                    tick = await self._send_tuning(back) if self._supervisor.is_alive else self._set_active(back)
                except LoopExitedError:
                    tick = self._set_active(back.without_rejection())
                self._event_log.add_mark(MarkKind.TUNING, f"after the run: {back.difference(lent)}", tick)
            self._live_state.overridden_tuning = None

    async def _end_trial_automatically(self, before: ActiveTuning, cause: str) -> None:
        await self._retry_restore("The tuning before the trial", before, lambda: self._end_trial(before, cause=cause))

    async def _end_trial(self, before: ActiveTuning, who: str = "", cause: str = "") -> None:
        async with self._change_lock:
            tried = self._live_state.tuning
            if self._trial.before is not before:  # somebody chose another tuning while this waited
                return
            back = self._drop_unusable_rejection(before)
            tick = await self._send_tuning(back) if self._supervisor.is_alive else self._set_active(back)
            ended = f"trial over, {cause}" if cause else "trial over"
            self._event_log.add_mark(MarkKind.TUNING, f"{ended}: {back.difference(tried)}", tick, who)

    def _require_no_override(self) -> None:
        """Raise RequestRejectedError while a run has the tuning."""
        if self._live_state.overridden_tuning is None:
            return
        task = self._live_state.task
        what = "a run is being started" if task is None else f"{task.kind} is running"
        raise RequestRejectedError(ErrorCode.NOT_NOW, f"{what} and its tuning is part of its record: stop it first")

    async def _store_active(self, who: str) -> None:
        """Let the next start of the service find this tuning; a trial and what a run was lent are not kept."""
        await asyncio.to_thread(self._tuning_store.save, self._live_state.tuning, who)

    async def _apply_permanently(self, tuning: ActiveTuning) -> int:
        """Put in force what the operator has chosen for good; the way back is remembered."""
        before = self._trial.before or self._live_state.tuning
        tick = await self._send_tuning(tuning)
        if tuning.choice != before.choice:
            self._push_undo(before)
            self._on_change()
        return tick

    def _push_undo(self, before: ResolvedTuning) -> None:
        """Let ``undo`` go back to a tuning; what was undone before is not done again any more."""
        self._live_state.undo_stack.append(before)
        self._live_state.redo_stack.clear()

    async def _send_tuning(self, tuning: ActiveTuning) -> int:
        self._require_known_bias(tuning)
        accepted = await self._send(tuning.command())
        self._set_active(tuning)
        return accepted.tick

    def _set_active(self, tuning: ActiveTuning) -> int:
        """Show ``tuning`` as in force, and give it to a loop process that is started anew."""
        self._trial.forget()
        self._live_state.tuning = tuning
        self._supervisor.setup = replace(self._supervisor.setup, tuning=tuning.command())
        self._on_change()
        return self._live_state.tick


# Saved tunings -------------------------------------------------------------------------------------
#
# The tuning that each bank is meant to run with, saved by a person, as settings in the database.


class SavedTunings:
    """Reads and writes settings in the database. All methods wait for it: the event loop calls them in a thread."""

    def __init__(self, database: Database) -> None:
        self._database = database

    def of(self, tuning: ActiveTuning) -> SavedTuning:
        """Return what was saved for the bank in use; the defaults on its models where nobody has saved."""
        with self._database.reading() as session:
            stored = settings.newest(session, _setting_of(tuning))
        if stored is not None:
            return _saved(stored)
        default = tuning.default()
        return SavedTuning(**list_tuning_parts(default.tuning), who=None, at=None, moved=default.moved)

    def save(self, tuning: ActiveTuning, who: str) -> SavedTuning:
        """Save what is in force as what the bank in use is meant to run with; earlier values stay in the history."""
        parts = SAVED_TUNING.write(SavedLoopSettings(**list_tuning_parts(tuning.choice)))
        with self._database.session() as session:
            stored = settings.save(session, _setting_of(tuning), parts, who)
        return _saved(stored)


def _saved(stored: StoredSetting) -> SavedTuning:
    read = SAVED_TUNING.read(stored.value, f"setting “{stored.name}”")
    return SavedTuning(
        **list_tuning_parts(TuningSettings.from_values(read.get_known_values())), who=stored.who, at=stored.at, moved=""
    )


def _setting_of(tuning: ActiveTuning) -> str:
    return saved_tuning_key(None if tuning.bank is None else tuning.bank.id)
