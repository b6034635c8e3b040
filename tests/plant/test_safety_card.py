"""The watchdog process of the simulated card: its proof test before the drives are enabled, and its death."""

import os
import signal
import threading
import time
from collections.abc import Callable, Iterator
from itertools import count

import pytest

from plant.interface import MotorCommand, PlantError
from plant.safety_card import TRIAL_S, WATCHDOG_S, Card, CardState, Stillness, WatchdogDeadError
from tests.refusals import refused

PATIENCE_S = 20.0


@pytest.fixture
def card() -> Iterator[Card]:
    made = Card.create()
    yield made
    made.disarm()
    made.close()


def kill_watchdog(card: Card) -> None:
    assert card.watchdog_pid is not None
    os.kill(card.watchdog_pid, signal.SIGKILL)


def write_until(card: Card, reached: Callable[[], bool]) -> float:
    """Write like a control loop until the condition holds; return the duration [s]."""
    begun_s = time.monotonic()
    while not reached():
        assert time.monotonic() - begun_s < PATIENCE_S
        card.write(MotorCommand(1.0, -1.0), False)
        time.sleep(0.001)
    return time.monotonic() - begun_s


def test_the_proof_test_takes_its_full_time_at_zero_volts(card: Card) -> None:
    """Together with the failing watchdogs below: only the action of the watchdog ends the proof test."""
    card.start_watchdog()
    while card.state().polls == 0:
        time.sleep(0.005)
    seen: list[CardState] = []
    done = threading.Event()

    def look() -> None:
        while not done.is_set():
            seen.append(card.state())
            time.sleep(0.001)

    looking = threading.Thread(target=look)
    looking.start()
    begun_s = time.monotonic()
    card.arm()
    assert time.monotonic() - begun_s > 0.5 * TRIAL_S
    done.set()
    looking.join()
    assert {(state.u_A, state.u_B) for state in seen} == {(0.0, 0.0)}
    assert card.state().drive_enabled
    assert not card.state().expired


def test_the_watchdog_waits_its_full_timeout_after_the_proof_test(card: Card) -> None:
    card.arm()
    written_s = time.monotonic()
    card.write(MotorCommand(1.0, 1.0), False)
    while not card.state().expired:
        assert time.monotonic() - written_s < PATIENCE_S
        time.sleep(0.005)
    assert time.monotonic() - written_s >= WATCHDOG_S


def test_a_watchdog_that_died_before_its_proof_test_keeps_the_drives_off(card: Card) -> None:
    card.start_watchdog()
    while card.state().polls == 0:
        time.sleep(0.005)
    kill_watchdog(card)
    with refused(PlantError, "watchdog_test_failed"):
        card.arm()
    assert not card.state().drive_enabled
    assert not card.state().armed


def test_a_watchdog_that_polls_but_never_disables_keeps_the_drives_off(card: Card) -> None:
    card.start_watchdog()
    while card.state().polls == 0:
        time.sleep(0.005)
    kill_watchdog(card)
    done = threading.Event()

    def pretend() -> None:
        while not done.wait(0.002):
            card.count_poll()

    pretending = threading.Thread(target=pretend)
    pretending.start()
    try:
        with refused(PlantError, "watchdog_test_failed"):
            card.arm()
    finally:
        done.set()
        pretending.join()
    assert not card.state().drive_enabled


@pytest.mark.parametrize("how", [signal.SIGKILL, signal.SIGSTOP])
def test_a_watchdog_that_stops_polling_disables_the_drives(card: Card, how: signal.Signals) -> None:
    card.arm()
    write_until(card, lambda: card.state().u_A == 1.0)
    assert card.watchdog_pid is not None
    os.kill(card.watchdog_pid, how)
    with refused(WatchdogDeadError, "watchdog_not_responding"):
        write_until(card, lambda: False)
    state = card.state()
    assert (state.u_A, state.u_B, state.drive_enabled, state.watchdog_dead) == (0.0, 0.0, False, True)
    os.kill(card.watchdog_pid, signal.SIGCONT)
    time.sleep(0.1)
    with refused(PlantError, "watchdog_dead"):
        card.rearm()
    assert not card.state().drive_enabled


def test_a_pause_of_the_whole_machine_is_not_a_dead_watchdog() -> None:
    """Two polls far apart count as two periods: no process could count in between."""
    still = Stillness(0.001)
    times = count(0.0, 0.3)
    assert max(still.update(7, next(times)) for _ in range(100)) <= 100 * 0.002
    assert still.update(8, next(times)) == 0.0


def test_a_constant_counter_is_timed() -> None:
    still = Stillness(0.001)
    assert [round(still.update(7, 0.001 * tick), 6) for tick in range(4)] == [0.0, 0.001, 0.002, 0.003]
