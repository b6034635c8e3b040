"""The control loop: one tick, the commands between two ticks, and zero volts at every way out.

The same class runs live in the loop process and headless for the command line; what differs is who calls ``tick``.
"""

from typing import assert_never

import numpy as np

from backend.control.motion_types import AT_REST
from backend.control.step import DECIDED, DONE, FELT, FOUND, PUSHES, QUIET, TUNES, Stretch
from backend.faults import Fault
from backend.loop import bring_up
from backend.loop.checks import Checks
from backend.loop.commands import (
    Accepted,
    Command,
    Event,
    Heartbeat,
    Inject,
    Obstruct,
    Push,
    Refused,
    Reset,
    RunProgram,
    SetMode,
    SetReferences,
    Shutdown,
    Stop,
    Zero,
)
from backend.loop.hand_push import HandPush
from backend.loop.mode import LEGAL, Mode, RefusedError
from backend.loop.mode_machine import ModeMachine
from backend.loop.now import Now
from backend.loop.orders import orders_of
from backend.loop.plant_watch import PlantWatch
from backend.loop.play_recording import PlayRecording
from backend.loop.ring import Ring, SampleRing
from backend.loop.set_touch import SetTouch
from backend.loop.set_tuning import SetTuning
from backend.loop.tick_desk import TickDesk
from backend.loop.tuned import tuning_of
from backend.sample import FIELDS
from backend.tuning.gains import knowledge
from backend.tuning.models import Lambdas
from plant.interface import ZERO_VOLTS, MotorCommand, Plant, PlantError
from plant.parameters import PlantParameters
from plant.safety_card import WatchdogDeadError, WatchdogExpiredError
from plant.simulator import Simulator

_AT_REST_TOO = (Fault.SAFETY_MODULE, Fault.SENSOR_INVALID, Fault.SENSOR_SATURATED)


class Loop:
    """Control of one plant. ``finished`` tells that a Shutdown has been asked for."""

    def __init__(self, plant: Plant, parameters: PlantParameters, ring: SampleRing, tuning: SetTuning) -> None:
        self._plant, self._ring, self.finished = plant, ring, False
        self._known = known = knowledge(parameters)
        self.bounds = known.bounds
        self._checks, self._plant_watch = Checks(parameters), PlantWatch()
        self._tick = self._newest_tick = self._overruns = 0
        self._command = ZERO_VOLTS  # what was written last
        self._changed = True  # whether the desk may not know yet what has become of the machine
        self._hand, self._row = HandPush(plant), np.zeros(len(FIELDS))
        self._events: list[Event] = []
        gains = tuning_of(tuning, self._known)
        self._desk = TickDesk(parameters, plant.unattended_max_s, gains)  # once open, a card waits for 50 ms at most
        try:
            plant.open()
            self._desk.begin(plant.read())
            self._machine = ModeMachine(
                plant, parameters, self._desk, gains, Lambdas(tuning.lam_q, tuning.lam_S), self._events
            )
        except BaseException:  # the drives may be on already, and nobody else has this plant to close
            self.close()
            raise

    @property
    def mode(self) -> Mode:
        """What the loop is doing."""
        return self._machine.mode

    @property
    def fault(self) -> Fault:
        """The latched fault, or NONE."""
        return self._machine.fault

    @property
    def pretension_done(self) -> bool:
        """Whether the moves out of pretension towards motion are granted now."""
        return self._machine.pretension_done

    @property
    def readiness(self) -> tuple[str, bool]:
        """What has to come before pretension, empty where nothing has; and whether the drives are locked off."""
        return self._machine.unready, self._machine.drives_off

    def drain_events(self) -> list[Event]:
        """Events since the last call, oldest first."""
        events, self._events[:] = list(self._events), []
        return events

    def handle(self, sequence: int, command: Command) -> None:
        """Carry out a command between two ticks, or refuse it whole; the answer is queued as an event."""
        events, tick = self._events, self._tick
        self._changed = True
        try:
            self._carry_out(command)
        except RefusedError as refused:
            events.append(Refused(sequence, tick, str(refused), refused.legal))
        except (ValueError, PlantError) as error:
            events.append(Refused(sequence, tick, str(error)))
        except AssertionError:  # of assert_never: a service of another version, which no type checker has seen
            events.append(Refused(sequence, tick, f"this loop knows no command {type(command).__name__}"))
        else:
            events.append(Accepted(sequence, tick))

    def _carry_out(self, command: Command) -> None:
        if isinstance(command, bring_up.Asked):
            bring_up.carry_out(command, self._machine, self._plant, Now(self._newest_tick, self._desk.m))
            if isinstance(command, Zero):
                self._desk.stands_at(command.q)
            return
        match command:
            case Stop():
                self._machine.begin_stop(command, command.detail, Now(self._newest_tick, self._desk.m))
            case SetMode():
                self._machine.set_mode(command, Now(self._newest_tick, self._desk.m))
            case SetReferences():
                self._machine.set_references(command)
            case SetTuning():
                self._machine.set_tuning(tuning_of(command, self._known), Lambdas(command.lam_q, command.lam_S))
            case SetTouch():
                self._machine.contact.put(command)
            case RunProgram():
                self._machine.run_program(command, Now(self._newest_tick, self._desk.m))
            case Push():
                self._hand.begin(command, self._tick, self._machine.mode)
            case Inject():
                self._plant.inject(command.broken)
            case Obstruct():
                self._machine.push.obstruct(command.obstacle, self._tick)
            case Reset():
                self._reset()
            case Shutdown():
                self.finished = True
            case Heartbeat():
                pass
            case PlayRecording():
                raise RefusedError("no recording is played: there is nothing to play, pause or go to")
            case _:
                assert_never(command)

    def _reset(self) -> None:
        machine = self._machine
        if machine.mode is not Mode.TRIPPED:
            raise RefusedError(f"there is no fault to reset; the mode is {machine.mode}", LEGAL[machine.mode])
        fault, seen = self._checks.standing(machine.zeros.from_middle(self._desk.m), self._plant.raw)
        seen = self._plant_watch.failure or seen
        if fault is not Fault.NONE or self._plant_watch.failure:
            raise RefusedError(f"the cause is still there: {seen}")
        machine.reset(Now(self._newest_tick, self._desk.m))

    def tick(self, lateness_s: float = 0.0, overruns: int = 0) -> None:
        """One period: read, look, decide, write, keep the row. Zero volts on any way out by an error."""
        self._make_tick(None, lateness_s, overruns)

    def run(self, ticks: int) -> int:
        """Make at most so many ticks, and at least one: in a batch where nobody has to be asked in between; how many.

        A batch ends in the tick that something comes of, which is made by itself from there on.
        """
        plant, ring, machine, desk = self._plant, self._ring, self._machine, self._desk
        told = self._plant_watch.answers and not machine.has_to_tell
        undisturbed = told and self._hand.is_idle and machine.interpreted is None
        alone = plant.alone_for(ticks) if undisturbed and isinstance(plant, Simulator) else 0
        if not (alone and isinstance(plant, Simulator) and isinstance(ring, Ring)):
            self.tick(overruns=self._overruns)
            return 1
        self._tell_desk()
        stretch = Stretch(self._tick, plant.periods, alone, self._overruns)
        made, came, u_A, u_B, m = desk.run(plant.simulated, plant.read(), stretch, ring.rows)
        plant.has_gone(made, m)
        ring.count_in(made)
        machine.push.has_become(*desk.acting)
        self._tick += made
        self._newest_tick = self._tick - 1
        self._command = desk.command
        if came == QUIET:
            return made
        self._make_tick((came, u_A, u_B), 0.0, self._overruns)
        return made + 1

    def _make_tick(self, begun: tuple[int, float, float] | None, lateness_s: float, overruns: int) -> None:
        """Make a tick, or the rest of one that a batch has ``begun``: what came of it so far, and voltages [V]."""
        machine, missed = self._machine, overruns - self._overruns
        self._newest_tick = self._tick
        self._plant_watch.begin()
        self._events += self._hand.step(self._tick, machine.mode)
        command = ZERO_VOLTS
        try:
            came, u_A, u_B = begun or self._begin_tick(missed)
            if came not in (QUIET, DECIDED) or machine.interpreted is not None:
                u_A, u_B = self._attend(came, missed)
                self._changed = True
            if machine.mode not in (Mode.OFF, Mode.TRIPPED):
                command = MotorCommand(u_A, u_B)
        except PlantError as error:
            self._desk.decision = AT_REST
            self._plant_failed(error)
        finally:
            self._write(command)
        self._events += self._plant_watch.end(self._tick)
        self._overruns = overruns
        self._tell_desk()
        self._desk.write_row(self._row, self._tick, self._command, self._plant.raw, lateness_s, overruns)
        self._ring.append(self._row)
        self._tick += 1

    def _begin_tick(self, missed: int) -> tuple[int, float, float]:
        """Read, look, and let a compiled motion decide; what came of it, and voltages [V]."""
        desk, raw = self._desk, self._plant.read()
        self._tell_desk()
        found = desk.look(raw, missed)
        if found != QUIET or self._machine.interpreted is not None:
            return found, 0.0, 0.0
        return desk.decide()

    def _tell_desk(self) -> None:
        if self._changed:
            self._desk.order(orders_of(self._machine))
            self._changed = False

    def _attend(self, came: int, missed: int) -> tuple[float, float]:
        """See to what came of a tick that was looked at; return the voltages [V] that are decided then."""
        machine, desk = self._machine, self._desk
        if came & FOUND:
            self._react(missed)
        elif came & FELT:
            machine.give_way(Now(self._newest_tick, desk.m))
        desk.order(orders_of(machine))
        if machine.interpreted is not None:
            decision = desk.decision = machine.interpreted.step(machine.tunings.gains, desk.m)
            came = DONE if machine.interpreted.done else QUIET
        else:
            if came & (FOUND | FELT):
                came, _, _ = desk.decide()
            decision = desk.decision
        if came & PUSHES:
            machine.push.act(decision.target, self._newest_tick)
        if came & TUNES:
            machine.tunings.use(decision.target.tuning, self._newest_tick)
        motion, m = machine.motion, desk.m
        if came & DONE and motion is not None:
            motion.done = True
            bring_up.zero_where_homed(motion, machine, self._plant, desk)
            desk.m = machine.end_motion(Now(self._newest_tick, m))
        return decision.u_A, decision.u_B

    def _react(self, missed: int) -> None:
        """Stop for what the checks have found, where that is to be stopped for."""
        machine, desk, m, command = self._machine, self._desk, self._desk.m, self._command
        if machine.mode is Mode.TRIPPED:
            return
        heard = machine.zeros.from_middle(m)
        fault, seen = self._checks.told(desk.found, desk.readings, m, heard, command, self._plant.raw, missed)
        if machine.motion is not None or fault in _AT_REST_TOO:
            machine.begin_stop(Stop(fault), seen, Now(self._newest_tick, m))

    def _write(self, command: MotorCommand) -> None:
        machine = self._machine
        try:
            self._plant.write(command)
            self._command = command  # what cannot be written leaves the outputs as they were
        except (WatchdogExpiredError, WatchdogDeadError) as error:
            # The drives are off already: this is zero volts, and stays so until somebody resets.
            self._command = ZERO_VOLTS
            self._changed = True
            if machine.mode is not Mode.TRIPPED:
                fault = Fault.WATCHDOG if isinstance(error, WatchdogExpiredError) else Fault.WATCHDOG_DEAD
                machine.begin_stop(Stop(fault), str(error), Now(self._newest_tick, self._desk.m))
        except PlantError as error:
            self._plant_failed(error)
            return
        machine.tell_stopped(self._tick)

    def _plant_failed(self, error: PlantError) -> None:
        self._plant_watch.failure = str(error)
        self._changed = True
        if self._machine.mode is not Mode.TRIPPED:
            self._machine.begin_stop(Stop(Fault.PLANT_ERROR), str(error), Now(self._newest_tick, self._desk.m))

    def close(self) -> None:
        """Zero volts and let go of the plant. Safe to call twice."""
        try:
            self._plant.write(ZERO_VOLTS)
        except PlantError:
            pass
        finally:
            self._plant.close()
