"""Contact detection: bias of the external force and contact reaction."""

import asyncio
import logging
import math
from collections.abc import Awaitable, Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from backend.control import disturbance_observer
from backend.errors import RequestRejectedError, check_range
from backend.event_bus import EventBus
from backend.realtime import (
    CONTACT_MAX_N,
    CONTACT_MIN_N,
    MODES,
    NEIGHBOUR,
    SIGMAS,
    Accepted,
    BiasLost,
    Cause,
    Command,
    ContactDetected,
    Event,
    LoopExited,
    LoopExitedError,
    Mode,
    ModeChanged,
    SetReferences,
    Supervisor,
    commands,
)
from backend.sample import INDEX
from backend.schemas import ContactView, MarkKind, SweepView, TouchOrder, TouchPoint, TouchView
from backend.services import messages
from backend.services.event_log import EventLog
from backend.services.state import LiveState
from plant import ErrorCode, T_s

# Rest ----------------------------------------------------------------------------------------------
# Checks that the joint and the estimate of the external force are at rest, as a calibration of the
# bias requires.


REST_TICKS = 1000
"""Samples at rest from which one point of the bias is computed: 1 s."""

DRIFT_N = 0.1
"""Largest drift of the estimate [N] between both halves of the samples: as much as one count of the joint encoder."""

_MOVING_RAD, _MOVING_S = 0.01, 0.1
"""Largest range of joint position [rad] and stiffness [N·m/rad] at rest."""


def explain_not_at_rest(rows: NDArray[np.float64], since: int) -> str:
    """Return why the bias cannot be calibrated from these samples; empty if it can.

    Args:
        rows: The last samples, shape (n, columns).
        since: Tick from which on bias and references are unchanged.

    """
    if len(rows) < REST_TICKS or not np.all(np.isfinite(rows[:, INDEX["F_ext_hat"]])):
        return messages.external_force_not_available()
    if set(rows[:, INDEX["mode"]].astype(int)) != {MODES.index(Mode.RUN)}:
        return messages.not_held_in_mode_run(duration_s=REST_TICKS / 1000)
    if rows[0, INDEX["tick"]] < since:
        return messages.bias_or_references_changed(duration_s=REST_TICKS / 1000)
    input_acting = find_acting_input(rows)
    if input_acting:
        return input_acting
    if np.ptp(rows[:, INDEX["q"]]) > _MOVING_RAD or np.ptp(rows[:, INDEX["S"]]) > _MOVING_S:
        return messages.joint_not_at_rest(duration_s=REST_TICKS / 1000)
    return ""


def find_acting_input(rows: NDArray[np.float64]) -> str:
    """Return which simulated input acts on the joint in these samples; empty for none."""
    if np.any(rows[:, INDEX["F_push"]] != 0.0):
        return messages.joint_is_pushed()
    if np.any(np.nan_to_num(rows[:, INDEX["F_wall"]]) != 0.0):  # NaN on a rig, which has no simulated obstacle
        return messages.joint_presses_obstacle()
    return ""


def compute_drift(rows: NDArray[np.float64]) -> float:
    """Return the difference of the estimate [N] between both halves of the samples."""
    F = rows[:, INDEX["F_ext_hat"]]
    half = len(F) // 2
    return abs(float(F[:half].mean() - F[half:].mean()))


# Sweep ---------------------------------------------------------------------------------------------
# Calibrates the bias of the external force automatically over the whole range of stiffness.
#
# In mode run and without contact, S_ref is set to SWEEP_POINTS values. At each value the sweep
# waits for rest and calibrates one point; afterwards it restores S_ref. Any other motion of the
# joint aborts the sweep, and the points calibrated so far remain.


SWEEP_POINTS = 5
"""Points from the smallest to the largest S_ref. On ``lab``, linear interpolation is within 0.01 N of the bias."""

LONGEST_S = 20.0
"""Longest wait for rest at a point [s]; the slowest common λ_S needs half of it."""

_POLL_S = 0.1
_NEAR_S = 0.2
"""Largest deviation of the stiffness from S_ref at rest [N·m/rad]."""

_log = logging.getLogger(__name__)


class BiasSweep:
    """Calibrates the bias over the range of stiffness.

    Runs in the event loop of the service.
    """

    def __init__(
        self,
        supervisor: Supervisor,
        live_state: LiveState,
        event_log: EventLog,
        send: Callable[[Command], Awaitable[Accepted]],
        calibrate_point: Callable[[int], Awaitable[None]],
        is_reaction_active: Callable[[], bool],
        on_change: Callable[[], None],
    ) -> None:
        """Calibrate each point with ``calibrate_point``.

        Its argument is the tick from which on samples may be used. ``is_reaction_active`` returns whether the joint
        reacts to contacts, which excludes a calibration.
        """
        self._supervisor = supervisor
        self._live_state = live_state
        self._event_log = event_log
        self._send = send
        self._calibrate_point = calibrate_point
        self._is_reaction_active = is_reaction_active
        self._on_change = on_change
        self._view: SweepView | None = None
        self._task: asyncio.Task[None] | None = None
        self._start_references = (0.0, 0.0)
        self.problem = ""
        """Why the last sweep failed unexpectedly; empty after the next one has started."""

    @property
    def is_running(self) -> bool:
        """Whether a sweep is in progress."""
        return self._view is not None and self._view.under_way

    def view(self) -> SweepView | None:
        """Return the progress of the sweep or the end of the last one.

        None before the first.
        """
        return self._view

    def clear(self) -> None:
        """Remove the last sweep from the view."""
        self._view, self.problem = None, ""

    async def begin(self, who: str) -> None:
        """Start a sweep.

        Raises RequestRejectedError unless the mode is run and nothing acts on the joint.
        """
        _, rows, _ = self._supervisor.ring.read(max(self._supervisor.ring.count - 1, 0), 1)
        why = self._explain_not_startable(rows)
        if why:
            raise RequestRejectedError(ErrorCode.NOT_NOW, messages.sweep_not_possible(reason=why))
        bounds = self._live_state.bounds
        points = np.linspace(bounds.S_min, bounds.S_max, SWEEP_POINTS).tolist()
        q_ref, S_ref = (float(rows[-1, INDEX[name]]) for name in ("q_ref", "S_ref"))
        self._start_references, self.problem = (q_ref, S_ref), ""
        self._set_progress(1, points[0])
        try:
            accepted = await self._command_stiffness(points[0], who)
        except BaseException:
            self._view = None
            raise
        if self.is_running:  # not aborted meanwhile
            self._task = asyncio.create_task(self._run(points, accepted.tick, who), name="calibration over S")

    async def stop(self, who: str) -> None:
        """Stop the sweep and restore S_ref.

        Raises RequestRejectedError if no sweep is in progress.
        """
        if not self.is_running:
            raise RequestRejectedError(ErrorCode.NOT_NOW, messages.no_sweep_to_stop())
        self.abort(messages.sweep_stopped_on_request(), who)
        await self._restore_stiffness()

    def abort(self, why: str, who: str = "") -> None:
        """End a sweep in progress without restoring S_ref; ``why`` is shown and logged."""
        if not self.is_running:
            return
        self._end(why, who)
        if self._task is not None:
            self._task.cancel()

    async def _run(self, points: list[float], since: int, who: str) -> None:
        why = ""
        try:
            for number, S_ref in enumerate(points, 1):
                if number > 1:
                    self._set_progress(number, S_ref)
                    since = (await self._command_stiffness(S_ref, who)).tick
                await self._wait_at_rest(S_ref, since)
                # Shielded against an abort meanwhile: the points of service and control loop must stay the same.
                await asyncio.shield(self._calibrate_point(since))
        except asyncio.CancelledError:
            if not self.is_running:  # ``abort`` has logged the reason
                raise
            why = self._record_failure(messages.sweep_task_cancelled())
        except (RequestRejectedError, LoopExitedError) as error:
            why = str(error)
        except Exception as error:
            _log.exception("The sweep that calibrates the bias over S failed.")
            why = self._record_failure(f"{type(error).__name__}: {error}")
        try:
            await self._restore_stiffness()
        finally:
            self._end(why)

    def _record_failure(self, cause: str) -> str:
        self.problem = messages.sweep_failed(cause=cause)
        return messages.end_of_failed_sweep(cause=cause)

    async def _wait_at_rest(self, S_ref: float, since: int) -> None:
        """Wait for rest at ``S_ref``.

        Raises RequestRejectedError if an input acts on the joint, or after LONGEST_S.
        """
        ring, why = self._supervisor.ring, ""
        end = ring.count + round(LONGEST_S / T_s)
        while ring.count < end:
            await self._supervisor.advance(_POLL_S)
            _, rows, _ = ring.read(max(ring.count - REST_TICKS, 0), REST_TICKS)
            input_acting = find_acting_input(rows[-round(_POLL_S / T_s) :])
            if input_acting:
                raise RequestRejectedError(ErrorCode.NOT_NOW, input_acting)
            why = explain_not_at_rest(rows, since) or _explain_drift(rows, S_ref)
            if not why:
                return
        raise RequestRejectedError(
            ErrorCode.NOT_NOW, messages.no_rest_in_sweep(S_ref=S_ref, duration_s=LONGEST_S, reason=why)
        )

    async def _command_stiffness(self, S_ref: float, who: str = "", *, restored: bool = False) -> Accepted:
        accepted = await self._send(SetReferences(self._start_references[0], S_ref))
        text = messages.stiffness_of_sweep(S_ref=S_ref, restored=restored)
        self._event_log.add_mark(MarkKind.REFERENCES, text, accepted.tick, who)
        return accepted

    async def _restore_stiffness(self) -> None:
        """Restore S_ref from before the sweep, if the joint is still in mode run."""
        if self._live_state.mode is Mode.RUN and self._supervisor.is_alive:
            with suppress(RequestRejectedError, LoopExitedError):
                await self._command_stiffness(self._start_references[1], restored=True)

    def _set_progress(self, point: int, S_ref: float) -> None:
        self._view = SweepView(under_way=True, point=point, points=SWEEP_POINTS, S_ref=S_ref, why="")
        self._on_change()

    def _end(self, why: str, who: str = "") -> None:
        view = self._view
        if view is None or not view.under_way:
            return
        self._view = view.model_copy(update={"under_way": False, "why": why})
        text = (
            messages.sweep_ended(point=view.point, points=view.points, S_ref=view.S_ref, reason=why)
            if why
            else messages.bias_calibrated_over_S(points=view.points)
        )
        self._event_log.add_mark(MarkKind.FAULT if self.problem else MarkKind.NOTE, text, self._live_state.tick, who)
        self._on_change()

    def _explain_not_startable(self, rows: NDArray[np.float64]) -> str:
        """Return why a sweep cannot start; empty if it can. ``rows`` is the newest sample."""
        task = self._live_state.task
        if self.is_running:
            return messages.sweep_in_progress_already()
        if task is not None:
            return messages.run_prevents_sweep(run=task.run, kind=task.kind)
        if self._live_state.mode is not Mode.RUN:
            return messages.sweep_needs_mode_run(mode=self._live_state.mode)
        if self._is_reaction_active():
            return messages.contact_reaction_is_armed()
        if not np.all(np.isfinite(rows[-1:, INDEX["F_ext_hat"]])):
            return messages.external_force_not_available()
        return find_acting_input(rows)


def _explain_drift(rows: NDArray[np.float64], S_ref: float) -> str:
    """Return why a joint at rest cannot be calibrated at ``S_ref`` [N·m/rad].

    The stiffness may differ from ``S_ref``, or the estimate may drift. Empty if it can be calibrated.
    """
    S, drift = float(rows[:, INDEX["S"]].mean()), compute_drift(rows)
    if not abs(S - S_ref) <= _NEAR_S:
        return messages.stiffness_not_reached(S=S)
    if not drift <= DRIFT_N:
        return messages.estimate_drifts(drift_N=drift, maximum_N=DRIFT_N)
    return ""


# Contact service -----------------------------------------------------------------------------------
# The calibrated bias of the external force, and the threshold of the contact reaction.
#
# The bias comes from deviations of springs and motor zeros from their identified values. It is
# valid for one loop process and its motor zeros. A new loop process, or new zeros, start without
# bias and without contact reaction.


@dataclass(frozen=True)
class BiasDiscarded:
    """Event: the bias of the external force is no longer calibrated."""


class ContactService:
    """Calibrates the bias and configures the contact reaction.

    Runs in the event loop of the service. Publishes BiasDiscarded.
    """

    def __init__(
        self,
        supervisor: Supervisor,
        live_state: LiveState,
        event_log: EventLog,
        send: Callable[[Command], Awaitable[Accepted]],
        on_change: Callable[[], None],
        start_lock: asyncio.Lock,
        events: EventBus,
    ) -> None:
        self.sweep = BiasSweep(
            supervisor=supervisor,
            live_state=live_state,
            event_log=event_log,
            send=send,
            calibrate_point=self._calibrate_point,
            is_reaction_active=lambda: self._contact_N != 0.0,
            on_change=on_change,
        )
        self._supervisor = supervisor
        self._event_log = event_log
        self._send = send
        self._on_change = on_change
        self._events = events
        self._command_lock, self._start_lock = asyncio.Lock(), start_lock
        self._points: list[TouchPoint] = []
        self._contact_N = 0.0  # threshold of the contact reaction; 0 for none
        self._detected: ContactView | None = None
        self._since = 0  # tick from which on the configuration is active
        supervisor.listen(self._handle_event)

    @property
    def points(self) -> Sequence[TouchPoint]:
        """Calibrated points of the bias, sorted by stiffness."""
        return self._points

    def view(self) -> TouchView:
        """Return calibration, threshold, sweep, and the contact that is reacted to."""
        sweep = self.sweep.view()
        return TouchView(contact_N=self._contact_N, learned=self._points, felt=self._detected, sweep=sweep)

    async def apply(self, order: TouchOrder, who: str) -> TouchView:
        """Calibrate, discard the calibration, or set the threshold of the reaction.

        An empty order changes nothing. Raises RequestRejectedError and OutOfRangeError without a change.
        """
        if order == TouchOrder():
            return self.view()
        if order.sweep is not None:
            return await self._apply_sweep(order, who)
        if self.sweep.is_running:
            raise RequestRejectedError(ErrorCode.NOT_NOW, messages.sweep_in_progress())
        async with self._command_lock:
            points = [] if order.forget else self._points
            if order.learn:
                points = _insert_point(points, self._measure_point(self._since))
            contact_N = self._contact_N if order.contact_N is None else order.contact_N
            if contact_N != 0.0:
                check_range(
                    "contact_N",
                    contact_N,
                    minimum=CONTACT_MIN_N,
                    maximum=CONTACT_MAX_N,
                    unit="N",
                    remedy=messages.zero_disables_contact_reaction(),
                )
                _require_calibrated(points, contact_N)
            tick = await self._configure(points, contact_N)
        if order.forget:
            self.sweep.clear()
        for text in _describe_changes(order, points):
            self._event_log.add_mark(MarkKind.NOTE, text, tick, who)
        self._on_change()
        return self.view()

    async def _apply_sweep(self, order: TouchOrder, who: str) -> TouchView:
        if order.learn or order.forget or order.contact_N is not None:
            raise RequestRejectedError(ErrorCode.BAD_VALUE, messages.sweep_with_other_field())
        if order.sweep == "stop":
            await self.sweep.stop(who)
        else:
            async with self._start_lock, self._command_lock:
                await self.sweep.begin(who)
        return self.view()

    async def _calibrate_point(self, since: int) -> None:
        """Calibrate one more point with samples from the tick ``since`` on."""
        async with self._command_lock:
            await self._configure(
                _insert_point(self._points, self._measure_point(max(since, self._since))), self._contact_N
            )
        self._on_change()

    async def _configure(self, points: list[TouchPoint], contact_N: float) -> int:
        """Send bias and threshold to the control loop.

        Return the tick from which on they are active.
        """
        bias = tuple((point.S, point.F) for point in points)
        accepted = await self._send(commands.ConfigureContactDetection(bias, contact_N))
        self._points, self._contact_N, self._since = points, contact_N, accepted.tick
        return accepted.tick

    def _measure_point(self, since: int) -> TouchPoint:
        """Return the bias at the current stiffness.

        Raises RequestRejectedError unless the joint is at rest.
        """
        ring = self._supervisor.ring
        _, rows, _ = ring.read(max(ring.count - REST_TICKS, 0), REST_TICKS)
        why = explain_not_at_rest(rows, since)
        if why:
            raise RequestRejectedError(ErrorCode.NOT_NOW, messages.bias_not_measured(reason=why))
        S, F = float(rows[:, INDEX["S"]].mean()), rows[:, INDEX["F_ext_hat"]]
        bias = np.array([(point.S, point.F) for point in self._points], dtype=np.float64).reshape(-1, 2)
        # The samples have the active bias subtracted.
        return TouchPoint(S=S, F=float(F.mean()) + disturbance_observer.interpolate_bias(bias, S), std_N=float(F.std()))

    def _handle_event(self, event: Event | LoopExited) -> None:
        match event:
            case ContactDetected(tick, F_ext_hat, contact_N):
                self._detected = ContactView(F_ext_hat=F_ext_hat, contact_N=contact_N, tick=tick)
            case ModeChanged(after=mode, cause=cause):
                self.sweep.abort(messages.mode_changed_in_sweep(mode=mode))
                self._detected = self._detected if cause is Cause.CONTACT else None
            case BiasLost():
                self.discard(messages.bias_lost_by_zeros())
            case LoopExited():
                self.discard(messages.bias_lost_with_loop())
            case _:
                return
        self._on_change()

    def discard(self, why: str) -> None:
        """Discard the calibration because of ``why``, as a new loop process does."""
        self.sweep.abort(why)
        self._points, self._contact_N, self._detected, self._since = [], 0.0, None, 0
        self._events.publish(BiasDiscarded())


def _insert_point(points: list[TouchPoint], new: TouchPoint) -> list[TouchPoint]:
    """Return the points, sorted by stiffness, with ``new`` in place of close ones."""
    others = [point for point in points if abs(point.S - new.S) >= NEIGHBOUR]
    return sorted([*others, new], key=lambda point: point.S)


def _require_calibrated(points: list[TouchPoint], contact_N: float) -> None:
    """Raise RequestRejectedError for a threshold that noise or bias could exceed."""
    if not points:
        raise RequestRejectedError(ErrorCode.NOT_NOW, messages.contact_reaction_needs_bias())
    noise = max(point.std_N for point in points)
    if not math.isfinite(noise) or contact_N < SIGMAS * noise:
        raise RequestRejectedError(
            ErrorCode.NOT_NOW,
            messages.contact_threshold_within_noise(contact_N=contact_N, std_N=noise, factor=SIGMAS),
        )


def _describe_changes(order: TouchOrder, points: list[TouchPoint]) -> list[str]:
    """Return the texts of an applied order for the event log."""
    texts: list[str] = [messages.bias_discarded()] if order.forget else []
    if order.learn:
        texts.append(messages.bias_calibrated(points=[(point.S, point.F) for point in points]))
    if order.contact_N is not None:
        texts.append(messages.contact_reaction_set(contact_N=order.contact_N))
    return texts
