"""Commands to the actuator: modes, references, inputs, drives, stop and reset."""

import asyncio
import logging
from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace

from backend import __version__
from backend.commissioning import DriveLockout, find_for_next_start, switch_drives
from backend.errors import RequestRejectedError, check_range
from backend.event_bus import EventBus, StateChanged
from backend.faults import EXPLANATIONS, Fault
from backend.models import SETTINGS, RunSettings, StoredLoopSettings
from backend.realtime import (
    LEGAL,
    MOVING,
    PUSH_MAX_S,
    Accepted,
    Command,
    Event,
    LoopExited,
    LoopExitedError,
    Mode,
    ModeChanged,
    Obstruct,
    PlayerMoved,
    PushReleased,
    Refused,
    Ring,
    RunEnded,
    Stop,
    Stopped,
    Supervisor,
    commands,
    wait_for_result,
)
from backend.schemas import MarkKind, PlayedRecording, PushRequest, References, StopProof, WallOrder, WallView
from backend.services import messages
from backend.services.contact import ContactService
from backend.services.event_log import EventLog
from backend.services.live_stream import build_mark
from backend.services.player import RecordingPlayer
from backend.services.state import F_PUSH_MAX, LiveState, compute_wall_bounds
from backend.services.tuning import TuningService
from backend.services.tuning_state import ActiveTuning, TuningStore
from backend.storage import Database, EndState, NewRun, RunKind, runs
from backend.supervision import Part, SupervisedTask, Supervision
from plant import ErrorCode, InjectedFault, Obstacle, PlantKind, PlantParameters

# Legality ------------------------------------------------------------------------------------------
# Translates rejections of the control loop, and rejects illegal modes with the reason.


def raise_if_rejected(answer: Accepted | Refused) -> Accepted:
    """Return the answer to an accepted command.

    Raises RequestRejectedError with the reason for a rejected one.
    """
    if isinstance(answer, Refused):
        legal = [str(mode) for mode in answer.legal] or None
        raise RequestRejectedError(ErrorCode.NOT_NOW, answer.reason, code="refused", legal=legal)
    return answer


def require_legal(live_state: LiveState, wanted: Mode, *, loop_alive: bool) -> None:
    """Raise RequestRejectedError if the mode ``wanted`` is illegal now.

    A control loop that is dead or not ready rejects the command itself, with its own reason.
    """
    mode = live_state.mode
    legal = live_state.list_legal_modes(mode)
    paused = live_state.task is not None and live_state.task.paused and wanted in MOVING
    if wanted in legal or (live_state.not_ready_reason and wanted in LEGAL[mode] and not paused) or not loop_alive:
        return
    if mode is Mode.TRIPPED:
        reason = messages.fault_is_latched()
    elif wanted in LEGAL[mode] and paused:
        reason = messages.request_is_paused()
    elif wanted in LEGAL[mode]:
        reason = messages.mode_needs_pretension(mode=wanted)
    else:
        reason = messages.no_direct_change_of_mode(before=mode, after=wanted)
    names = [str(choice) for choice in legal]
    raise RequestRejectedError(
        ErrorCode.NOT_NOW, messages.illegal_mode(reason=reason, legal=names), code="illegal_mode", legal=names
    )


# Safe stop -----------------------------------------------------------------------------------------
# Brings the joint to rest when a safety-relevant part of the service dies.


ANSWER_S = 0.5
"""Time [s] that the control loop has to answer a soft stop."""

SILENCE_S = 2.0
"""Time [s] without heartbeat after an unanswered soft stop: longer than the timeout of the control loop."""

_PART = Part("The soft stop after the failure of a part", "Press STOP if the joint still moves.")
_STOPPED = (Mode.OFF, Mode.STOPPING, Mode.TRIPPED)
_log = logging.getLogger(__name__)


class SafeStop:
    """Stops the control loop softly by command.

    If the loop does not answer, the heartbeat is suspended: its timeout makes the loop stop itself.
    """

    def __init__(self, supervisor: Supervisor, live_state: LiveState, supervision: Supervision) -> None:
        self._supervisor = supervisor
        self._live_state = live_state
        self._supervision = supervision
        self._stopping: SupervisedTask | None = None

    def begin(self, fault: Fault) -> None:
        """Start a soft stop with ``fault`` unless stopped; does not wait for it."""
        self._stopping = self._supervision.start_task(_PART, lambda: self._stop(fault))

    async def _stop(self, fault: Fault) -> None:
        try:
            if self._live_state.mode in _STOPPED or not self._supervisor.is_alive:
                return
            await asyncio.wait_for(self._supervisor.send(Stop(fault, hard=False)), ANSWER_S)
        except LoopExitedError:
            return
        except Exception:
            _log.exception(
                "The control loop does not confirm a soft stop. The service suspends its heartbeat, so "
                "that the control loop stops itself."
            )
            self._supervisor.fall_silent(SILENCE_S)


# Session runs --------------------------------------------------------------------------------------
# Runs of kind ``session`` record manual operation in the modes run and compliance. The recorder
# closes them.


RECORDED_MODES = (Mode.RUN, Mode.COMPLIANCE)


class SessionRuns:
    """Stores session runs.

    They are stored before the control loop changes the mode, so that every sample belongs to a stored run. The methods
    access the database: the event loop calls them in a thread.
    """

    def __init__(self, database: Database, plant: str) -> None:
        self._database = database
        self._plant = plant

    def begin(self, mode: Mode, tuning: ActiveTuning, who: str) -> int:
        """Store a running session run and return its number."""
        new = NewRun(
            kind=RunKind.SESSION,
            plant=self._plant,
            parameters_name=tuning.parameters.name,
            parameters=tuning.parameters.to_document(),
            who=who,
            software=__version__,
            settings=SETTINGS.write(
                RunSettings(mode=str(mode), loop=StoredLoopSettings(**tuning.settings.to_document()))
            ),
            bank_id=None if tuning.bank is None else tuning.bank.id,
        )
        with self._database.session() as session:
            return runs.create(session, new).id

    def abandon(self, run: int) -> None:
        """Close a run whose mode the control loop has refused."""
        with self._database.session() as session:
            runs.end(session, run, EndState.STOPPED, messages.mode_refused_before_run())


# Actuator service ----------------------------------------------------------------------------------
# Sends commands to the control loop. A command takes effect only when the loop has accepted it.


STOP_PROOF_S = 1.0
"""Longest wait [s] for the confirmation of STOP; the control loop needs two ticks."""

_SHOWN_S = 0.2
"""Longest wait [s] until the samples show an accepted command."""

_RELEASE = Part("The release of a push", "Press STOP if the joint is still pushed.")


class ActuatorService:
    """Sends commands to the control loop and logs them.

    ``contact``, ``tuning_service`` and ``player`` have the commands of their subjects. All methods run in the event
    loop of the service. Changes of mode, tuning and drives wait for each other; STOP and soft stops do not wait.
    """

    def __init__(
        self,
        supervisor: Supervisor,
        live_state: LiveState,
        database: Database,
        session_runs: SessionRuns,
        event_log: EventLog,
        tuning_store: TuningStore,
        on_ring_changed: Callable[[Ring], None],
        supervision: Supervision,
        drive_lockout: DriveLockout,
        events: EventBus,
        recording: PlayedRecording | None = None,
    ) -> None:
        """Connect to the control loop of ``supervisor``.

        ``on_ring_changed`` gets the ring buffer of each restarted loop process. ``database`` holds the commissioning
        results that a loop process starts with. ``recording`` is replayed in place of a plant.
        """
        self.live_state = live_state
        self._database = database
        self._supervisor, self._session_runs, self._event_log = supervisor, session_runs, event_log
        self._on_ring_changed = on_ring_changed
        self._supervision, self._drive_lockout = supervision, drive_lockout
        self._pushed = False
        self._requested_mode: tuple[Mode, str] | None = None
        self._releasing: SupervisedTask | None = None
        self._stop_waiters: list[asyncio.Future[Stopped]] = []
        self._events = events
        self._command_lock = asyncio.Lock()
        # Held while a start checks that nothing occupies the rig, until the state shows what was started.
        self.start_lock = asyncio.Lock()
        self.contact = ContactService(
            supervisor=supervisor,
            live_state=live_state,
            event_log=event_log,
            send=self._send,
            on_change=self.publish_change,
            start_lock=self.start_lock,
            events=events,
        )
        self.tuning_service = TuningService(
            supervisor=supervisor,
            live_state=live_state,
            event_log=event_log,
            tuning_store=tuning_store,
            supervision=supervision,
            send=self._send,
            change_lock=self._command_lock,
            on_change=self.publish_change,
            contact=self.contact,
            events=events,
        )
        self.player = RecordingPlayer(recording, self._send, self.publish_change)
        supervisor.listen(self._handle_event)

    def publish_change(self) -> None:
        """Publish a StateChanged event."""
        self._events.publish(StateChanged())

    async def stop(self, who: str) -> StopProof:
        """Stop with zero volts and return the proof.

        Raises RequestRejectedError if the loop does not confirm it.
        """
        waiter: asyncio.Future[Stopped] = asyncio.get_running_loop().create_future()
        self._stop_waiters.append(waiter)
        try:
            await self._supervisor.send(commands.Stop(Fault.STOP_PRESSED, hard=True))
            stopped = await wait_for_result(waiter, STOP_PROOF_S)
        except TimeoutError:
            raise RequestRejectedError(ErrorCode.UNAVAILABLE, messages.zero_volts_not_confirmed()) from None
        finally:
            self._stop_waiters.remove(waiter)
        if self.player.has_recording:
            self._event_log.add_mark(MarkKind.NOTE, messages.playback_paused_by_stop(), stopped.arrived_tick, who)
        else:
            self._event_log.add_mark(MarkKind.TRIP, EXPLANATIONS[Fault.STOP_PRESSED].message, stopped.arrived_tick, who)
        return self.live_state.build_stop_proof(stopped)

    async def stop_after_operator_loss(self, who: str) -> None:
        """Stop softly after the page with control was lost.

        The references were held for HOLD_S before.
        """
        self.log_control_change(messages.control_lost(), who)
        if self.live_state.mode in _STOPPED or not self._supervisor.is_alive:
            return
        with suppress(LoopExitedError):
            await self._supervisor.send(commands.Stop(Fault.OPERATOR_LOST, hard=False))

    def log_control_change(self, text: str, who: str) -> None:
        """Log a change of the control lease."""
        self._event_log.add_mark(MarkKind.NOTE, text, self.live_state.tick, who)
        self.publish_change()

    async def reset(self, who: str) -> None:
        """Clear the latched fault. Raises RequestRejectedError while its cause persists.

        Restarts the loop process after an internal error, and if the process, the watchdog or the card has died.
        """
        async with self.start_lock, self._command_lock:
            has_failed = self.live_state.fault is Fault.INTERNAL_ERROR
            is_lost = has_failed or self._supervisor.watchdog_monitor.is_watchdog_lost or self.live_state.card_lost
            if self._supervisor.is_alive and not is_lost:
                accepted = await self._send(commands.Reset())
                self._event_log.add_mark(MarkKind.NOTE, messages.fault_reset(), accepted.tick, who)
            else:
                self.require_unoccupied()  # a new process loses the encoder zeros that a commissioning step uses
                await self._restart_loop(messages.restarted_after_failure(), messages.loop_restarted(), who)
        self.live_state.clear_stop()
        await self._wait_for_sample(lambda: self.live_state.fault is Fault.NONE)

    async def restart_loop_with(self, apply_change: Callable[[], None], change: str, who: str) -> None:
        """Call ``apply_change`` and restart the loop process with the change.

        ``change`` describes it in messages. Raises RequestRejectedError unless the mode is off, and LoopExitedError if
        no loop process starts: the change then takes effect at the next start.
        """
        async with self._command_lock:
            if self.live_state.mode is not Mode.OFF:
                raise RequestRejectedError(
                    ErrorCode.NOT_NOW, messages.change_needs_mode_off(change=change, mode=self.live_state.mode)
                )
            apply_change()
            try:
                purpose, text = messages.restarted_with_change(change=change), messages.loop_started_with(change=change)
                await self._restart_loop(purpose, text, who)
            except LoopExitedError as error:
                self._event_log.add_mark(MarkKind.FAULT, messages.loop_not_started_with(change=change), 0, who)
                raise LoopExitedError(
                    messages.change_takes_effect_at_next_start(change=change, reason=error.message)
                ) from error
            finally:
                self.publish_change()

    async def _restart_loop(self, purpose: str, text: str, who: str) -> None:
        plant, before = self._supervisor.setup.plant, self._supervisor.setup.commissioning_results
        commissioning_results = await asyncio.to_thread(find_for_next_start, self._database, plant, before)
        if (
            self._supervisor.setup.commissioning_results is before
        ):  # else a commissioning step has stored a newer result meanwhile
            self._supervisor.setup = replace(self._supervisor.setup, commissioning_results=commissioning_results)
        self.contact.discard(messages.bias_lost_by_restart())
        self.publish_change()
        await self._supervisor.restart(purpose)
        self._on_ring_changed(self._supervisor.ring)
        self.live_state.starts += 1
        self._event_log.add_mark(MarkKind.NOTE, text, 0, who)

    async def set_mode(self, mode: Mode, who: str) -> None:
        """Change the mode; records a session run in RECORDED_MODES.

        Raises RequestRejectedError.
        """
        if mode in _STOPPED:
            await self._change_mode(mode, who)
            return
        async with self.start_lock:
            self.require_unoccupied()
            await self._change_mode(mode, who)

    async def _change_mode(self, mode: Mode, who: str) -> None:
        async with self._command_lock:
            require_legal(self.live_state, mode, loop_alive=self._supervisor.is_alive)
            sessions, run = self._session_runs, 0
            if mode in RECORDED_MODES:
                run = await asyncio.to_thread(sessions.begin, mode, self.live_state.tuning, who)
            self._requested_mode = mode, who
            try:
                await self._send(commands.SetMode(mode, run))
            except BaseException:
                self._requested_mode = None  # a later change to this mode has another cause
                if run:
                    await asyncio.to_thread(sessions.abandon, run)
                raise
        await self._wait_for_sample(lambda: self.live_state.mode is mode)

    def require_unoccupied(self) -> None:
        """Raise RequestRejectedError while a commissioning step occupies the rig."""
        if self.live_state.occupied_by:
            raise RequestRejectedError(ErrorCode.NOT_NOW, messages.rig_is_occupied(reason=self.live_state.occupied_by))

    async def switch_drives(self, on: bool, who: str) -> None:
        """Disable the drives, or enable them in mode off.

        They cannot be enabled during a commissioning step. Raises RequestRejectedError, and LoopExitedError if the
        drives were to be enabled.
        """
        # Disabling does not wait. It is sent once more in turn below, for a loop process that was starting.
        if not on:
            with suppress(LoopExitedError):
                await self._supervisor.send(commands.SwitchDrives(on=False))
        async with self._command_lock:
            if on:
                self.require_unoccupied()
            accepted = raise_if_rejected(await switch_drives(self._supervisor, self._drive_lockout, on, who))
            self._event_log.add_mark(MarkKind.NOTE, messages.drives_switched(on=on), accepted.tick, who)
        self.publish_change()

    async def set_references(self, q_ref: float, S_ref: float, who: str) -> References:
        """Set the references: position [rad] and stiffness [N·m/rad].

        Raises OutOfRangeError.
        """
        bounds = self.live_state.bounds
        check_range("q_ref", q_ref, bounds.q_min, bounds.q_max, "rad")
        check_range("S_ref", S_ref, bounds.S_min, bounds.S_max, "N·m/rad")
        self.contact.sweep.abort(messages.other_references_set(), who)
        accepted = await self._send(commands.SetReferences(q_ref, S_ref))
        text = messages.references_set(q_ref=q_ref, S_ref=S_ref)
        self._event_log.add_mark(MarkKind.REFERENCES, text, accepted.tick, who)
        self.publish_change()
        return References(q_ref=q_ref, S_ref=S_ref)

    async def push(self, push: PushRequest, who: str) -> PushRequest:
        """Push the joint of a simulated plant.

        Raises RequestRejectedError on another plant, and OutOfRangeError.
        """
        plant = self.live_state.plant
        if not plant.simulated:
            message = messages.push_needs_simulated_plant(plant=plant.name, is_rig=plant.kind is PlantKind.RIG)
            raise RequestRejectedError(ErrorCode.NOT_NOW, message, code="not_a_simulator")
        check_range("F_push", push.F_push, -F_PUSH_MAX, F_PUSH_MAX, "N")
        remedy = messages.push_again()
        check_range(
            "duration_s",
            push.duration_s,
            minimum=0.0,
            maximum=PUSH_MAX_S,
            unit="s",
            remedy=remedy,
            label="duration of the push",
        )
        # Set before the command is sent: if control is lost meanwhile, the push is released after it has started.
        self._pushed = push.F_push != 0.0
        accepted = await self._send(commands.ApplyPush(push.F_push, push.duration_s))
        text = (
            messages.push_started(F_push=push.F_push, duration_s=push.duration_s)
            if push.F_push
            else messages.push_released()
        )
        self._event_log.add_mark(MarkKind.NOTE, text, accepted.tick, who)
        return push

    def release_push(self) -> None:
        """Release a push and abort a sweep, because their operator has lost control."""
        self.contact.sweep.abort(messages.sweep_without_operator())
        if self._pushed:
            self._releasing = self._supervision.start_task(_RELEASE, self._release_push)

    async def _release_push(self) -> None:
        self._pushed = False
        if not self._supervisor.is_alive:
            return
        with suppress(LoopExitedError):
            await self._supervisor.send(commands.ApplyPush(0.0, 0.0))
        self._event_log.add_mark(MarkKind.NOTE, messages.push_without_operator(), self.live_state.tick)

    async def inject_fault(self, injected_fault: InjectedFault | None, who: str) -> None:
        """Inject a fault into a simulated plant; None clears all.

        Raises RequestRejectedError on another plant.
        """
        text = (
            messages.injected_fault_cleared()
            if injected_fault is None
            else messages.fault_injected(fault=injected_fault.words)
        )
        await self.send_and_log(commands.Inject(injected_fault), text, who)

    async def send_and_log(self, command: Command, text: str, who: str) -> None:
        """Send a command and log it as ``text``. Raises RequestRejectedError."""
        accepted = await self._send(command)
        self._event_log.add_mark(MarkKind.NOTE, text, accepted.tick, who)

    def suspend_heartbeat(self, duration_s: float, who: str) -> None:
        """Suspend the heartbeat of the service, to test the reaction of the control loop."""
        self._supervisor.fall_silent(duration_s)
        self._event_log.add_mark(MarkKind.NOTE, messages.heartbeat_suspended(), self.live_state.tick, who)

    async def _send(self, command: Command) -> Accepted:
        return raise_if_rejected(await self._supervisor.send(command))

    async def _wait_for_sample(self, reached: Callable[[], bool]) -> None:
        """Wait until the samples show an accepted command, at most _SHOWN_S."""
        with suppress(TimeoutError, LoopExitedError):
            await self._supervisor.advance_until(reached, timeout_s=_SHOWN_S)
        self.publish_change()

    def _handle_event(self, event: Event | LoopExited) -> None:
        self.live_state.handle_event(event)
        if isinstance(event, PlayerMoved):
            self.player.handle_event(event)
        if isinstance(event, PushReleased):
            self._pushed = False
        if isinstance(event, ModeChanged):
            self.tuning_service.cancel_trial(messages.trial_ended_by_mode(mode=event.after))
        elif isinstance(event, LoopExited):
            self.tuning_service.cancel_trial(messages.trial_ended_by_loop())
        if (mark := build_mark(event, self.live_state.tick)) is not None:
            if isinstance(event, Stopped) and self.live_state.is_expected(event.fault):
                mark = mark._replace(kind=MarkKind.NOTE)
            self._event_log.add_mark(*mark, who=self._find_requester(event))
        if isinstance(event, Stopped):
            for waiter in self._stop_waiters:
                if not waiter.done():
                    waiter.set_result(event)
        if not isinstance(event, Accepted | Refused | RunEnded):
            self.publish_change()

    def _find_requester(self, event: Event | LoopExited) -> str:
        """Return who has requested the new mode; empty if it was not requested."""
        if (
            self._requested_mode is None
            or not isinstance(event, ModeChanged)
            or event.after is not self._requested_mode[0]
        ):
            return ""
        (_, who), self._requested_mode = self._requested_mode, None
        return who


# Obstacle ------------------------------------------------------------------------------------------
# Places or removes the simulated obstacle, in any mode.


async def set_obstacle(actuator: ActuatorService, order: WallOrder, who: str) -> WallOrder:
    """Place the obstacle, or remove it.

    Raises OutOfRangeError, and RequestRejectedError on a real plant, if the joint is inside the obstacle, and while a
    program sets its own.
    """
    plant = actuator.live_state.plant
    if not plant.simulated:
        message = messages.obstacle_needs_simulated_plant(plant=plant.name)
        raise RequestRejectedError(ErrorCode.NOT_NOW, message, code="not_a_simulator")
    wall = None if order.wall is None else _build_obstacle(order.wall, actuator.live_state.parameters)
    await actuator.send_and_log(Obstruct(wall), messages.obstacle(wall=wall), who)
    return order


def _build_obstacle(wall: WallView, parameters: PlantParameters) -> Obstacle:
    """Return a checked obstacle. Raises OutOfRangeError."""
    bounds, q_max = compute_wall_bounds(parameters), parameters.geometry.q_max
    remedy = messages.larger_value_not_resolved()
    check_range("q_wall", wall.q_wall, -q_max, q_max, "rad", path=("wall", "q_wall"))
    check_range(
        "k_wall",
        wall.k_wall,
        minimum=bounds.k_min,
        maximum=bounds.k_max,
        unit="N/m",
        remedy=remedy,
        path=("wall", "k_wall"),
    )
    check_range(
        "c_wall", wall.c_wall, minimum=0.0, maximum=bounds.c_max, unit="s/m", remedy=remedy, path=("wall", "c_wall")
    )
    return Obstacle(1.0 if wall.side == "above" else -1.0, wall.q_wall, wall.k_wall, wall.c_wall)
