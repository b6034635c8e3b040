"""The control loop: one tick, the commands between two ticks, and zero volts at every way out.

The same class runs live in the loop process and headless for the command line; what differs is who calls ``tick``.
"""

from typing import Protocol, assert_never

import numpy as np
from numpy.typing import NDArray

from backend.controllers import decoupler
from backend.controllers.limits import bounds_for
from backend.faults import FAULT_CODE, Fault
from backend.loop import bring_up
from backend.loop.causes import HomingEnd
from backend.loop.checks import Checks
from backend.loop.commands import (
    Accepted,
    Command,
    Event,
    Heartbeat,
    Inject,
    Push,
    Refused,
    Reset,
    RunProgram,
    SetMode,
    SetReferences,
    SetTuning,
    Shutdown,
    Stop,
    Zero,
)
from backend.loop.hand_push import HandPush
from backend.loop.homing import Homing
from backend.loop.mode import LEGAL, MODE_CODE, Mode, RefusedError
from backend.loop.mode_machine import ModeMachine, Now
from backend.loop.motion import AT_REST, Decision
from backend.loop.plant_watch import PlantWatch
from backend.loop.tuned import tuning_of
from backend.loop.velocity import JointVelocity
from backend.sample import FIELDS, ROW
from backend.tuning.models import Lambdas
from plant.card import WatchdogDeadError, WatchdogExpiredError
from plant.compiled import Specialised
from plant.interface import ZERO_VOLTS, MotorCommand, Plant, PlantError, T_s
from plant.parameters import PlantParameters

_AT_REST_TOO = (Fault.SAFETY_MODULE, Fault.SENSOR_INVALID, Fault.SENSOR_SATURATED)


class SampleRing(Protocol):
    """Where the loop leaves its samples: rows of len(FIELDS) numbers, one a tick."""

    def append(self, row: NDArray[np.float64]) -> None:
        """Publish one row."""
        ...


class Loop:
    """Control of one plant. ``finished`` tells that a Shutdown has been asked for."""

    def __init__(self, plant: Plant, parameters: PlantParameters, ring: SampleRing, tuning: SetTuning) -> None:
        self.bounds = bounds_for(parameters)
        self.finished = False
        self._plant = plant
        self._ring = ring
        self._decoupler = decoupler.decoupler_for(parameters)
        self._stiffness = Specialised(decoupler.stiffness, self._decoupler, 0.0, 0.0)
        self._checks = Checks(parameters, plant.unattended_max_s)
        self._plant_watch = PlantWatch()
        self._row = np.zeros(len(FIELDS))
        self._tick = self._newest_tick = 0
        self._overruns = 0
        self._hand = HandPush(plant)
        self._events: list[Event] = []
        gains = tuning_of(tuning, self._decoupler, self.bounds)
        try:
            plant.open()
            self._raw = self._m = m = plant.read()
            self._machine = ModeMachine(plant, parameters, gains, Lambdas(tuning.lam_q, tuning.lam_S), self._events)
            self._velocity = JointVelocity(m.q)
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
        events = list(self._events)
        self._events.clear()
        return events

    def handle(self, sequence: int, command: Command) -> None:
        """Carry out a command between two ticks, or refuse it whole; the answer is queued as an event."""
        events, tick = self._events, self._tick
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

    def _now(self) -> Now:
        return Now(self._newest_tick, self._m)

    def _carry_out(self, command: Command) -> None:
        if isinstance(command, bring_up.Asked):
            bring_up.carry_out(command, self._machine, self._plant, self._now())
            if isinstance(command, Zero):
                self._velocity.stands_at(command.q)
            return
        match command:
            case Stop():
                self._machine.begin_stop(command, command.detail, self._now())
            case SetMode():
                self._machine.set_mode(command, self._now())
            case SetReferences():
                self._machine.set_references(command)
            case SetTuning():
                gains = tuning_of(command, self._decoupler, self.bounds)
                self._machine.set_tuning(gains, Lambdas(command.lam_q, command.lam_S))
            case RunProgram():
                self._machine.run_program(command, self._now())
            case Push():
                self._hand.begin(command, self._tick, self._machine.mode)
            case Inject():
                self._plant.inject(command.broken)
            case Reset():
                self._reset()
            case Shutdown():
                self.finished = True
            case Heartbeat():
                pass
            case _:
                assert_never(command)

    def _reset(self) -> None:
        machine = self._machine
        if machine.mode is not Mode.TRIPPED:
            raise RefusedError(f"there is no fault to reset; the mode is {machine.mode}", LEGAL[machine.mode])
        fault, seen = self._checks.standing(machine.heard(self._m), self._plant.raw)
        seen = self._plant_watch.failure or seen
        if fault is not Fault.NONE or self._plant_watch.failure:
            raise RefusedError(f"the cause is still there: {seen}")
        machine.reset(self._now())

    def tick(self, lateness_s: float = 0.0, overruns: int = 0) -> None:
        """One period: read, estimate, decide, limit, write, append. Zero volts on any way out by an error."""
        machine = self._machine
        self._newest_tick = self._tick
        self._plant_watch.begin()
        released = self._hand.step(self._tick, machine.mode)
        if released is not None:
            self._events.append(released)
        command, decision = ZERO_VOLTS, AT_REST
        try:
            self._read()
            self._check(overruns - self._overruns)
            decision = self._decide()
            if machine.mode not in (Mode.OFF, Mode.TRIPPED):
                command = MotorCommand(decision.u_A, decision.u_B)
        except PlantError as error:
            self._plant_failed(error)
        finally:
            self._write(command)
        self._events += self._plant_watch.end(self._tick)
        self._overruns = overruns
        self._append(decision, lateness_s)
        self._tick += 1

    def _read(self) -> None:
        self._raw = self._plant.read()
        self._m = self._machine.zeros.counted(self._raw)
        self._velocity.step(self._m.q)

    def _check(self, missed: int) -> None:
        machine = self._machine
        heard, known = machine.heard(self._m), machine.zeros.motors_known
        fault, seen = self._checks.step(self._raw, heard, known, machine.keeps_taut, missed, self._plant.raw)
        at_risk = machine.motion is not None or fault in _AT_REST_TOO
        if fault is not Fault.NONE and machine.mode is not Mode.TRIPPED and at_risk:
            machine.begin_stop(Stop(fault), seen, self._now())

    def _decide(self) -> Decision:
        machine, m = self._machine, self._m
        decision = machine.decide(m)
        if decision is None:
            return AT_REST
        motion = machine.motion
        if motion is not None and motion.done:
            if isinstance(motion, Homing) and motion.end is HomingEnd.HOMED:
                found = Zero(motion.position_of(m.q), 0.0, 0.0)
                bring_up.set_zero(found, machine, self._plant)
                self._velocity.stands_at(found.q)
            self._m = machine.end_motion(self._now())
        return decision

    def _write(self, command: MotorCommand) -> None:
        machine = self._machine
        try:
            self._plant.write(command)
            self._checks.command = command  # what cannot be written leaves the outputs as they were
        except (WatchdogExpiredError, WatchdogDeadError) as error:
            # The drives are off already: this is zero volts, and stays so until somebody resets.
            self._checks.command = ZERO_VOLTS
            if machine.mode is not Mode.TRIPPED:
                fault = Fault.WATCHDOG if isinstance(error, WatchdogExpiredError) else Fault.WATCHDOG_DEAD
                machine.begin_stop(Stop(fault), str(error), self._now())
        except PlantError as error:
            self._plant_failed(error)
            return
        machine.tell_stopped(self._tick)

    def _plant_failed(self, error: PlantError) -> None:
        self._plant_watch.failure = str(error)
        if self._machine.mode is not Mode.TRIPPED:
            self._machine.begin_stop(Stop(Fault.PLANT_ERROR), str(error), self._now())

    def _append(self, y: Decision, lateness_s: float) -> None:
        machine = self._machine
        m, raw, put = self._m, self._plant.raw, self._checks.command
        ROW.pack_into(
            self._row.data,
            0,
            self._tick,
            self._tick * T_s,
            MODE_CODE[machine.mode],
            machine.run,
            m.q,
            y.target.q_ref,
            y.q_ref_gov,
            self._velocity.q_dot,
            self._stiffness(self._decoupler, m.theta_A, m.theta_B),
            y.target.S_ref,
            y.S_ref_gov,
            m.S_true,
            m.theta_A,
            y.theta_A_ref,
            m.theta_B,
            y.theta_B_ref,
            m.F_A,
            m.F_B,
            put.u_A,
            put.u_B,
            m.F_push,
            raw.V_A,
            raw.V_B,
            raw.n_q,
            raw.n_A,
            raw.n_B,
            machine.lambdas.lam_q,
            machine.lambdas.lam_S,
            y.bank_entry,
            int(y.limits),
            FAULT_CODE[machine.fault],
            lateness_s,
            self._overruns,
        )
        self._ring.append(self._row)

    def close(self) -> None:
        """Zero volts and let go of the plant. Safe to call twice."""
        try:
            self._plant.write(ZERO_VOLTS)
        except PlantError:
            pass
        finally:
            self._plant.close()
