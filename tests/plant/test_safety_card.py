"""The simulated card's watchdog as a process of its own: tried before the drives come on, and missed when it dies."""

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
    """Write as a loop does; return for how long [s]."""
    begun_s = time.monotonic()
    while not reached():
        assert time.monotonic() - begun_s < PATIENCE_S
        card.write(MotorCommand(1.0, -1.0), False)
        time.sleep(0.001)
    return time.monotonic() - begun_s


def test_the_trial_is_made_at_zero_volts_and_takes_its_time(card: Card) -> None:
    """With the watchdogs below that fail theirs: nothing but the watchdog's own act ends the trial."""
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


def test_after_its_trial_it_waits_its_whole_time(card: Card) -> None:
    card.arm()
    written_s = time.monotonic()
    card.write(MotorCommand(1.0, 1.0), False)
    while not card.state().expired:
        assert time.monotonic() - written_s < PATIENCE_S
        time.sleep(0.005)
    assert time.monotonic() - written_s >= WATCHDOG_S


def test_a_watchdog_that_died_before_its_trial_keeps_the_drives_off(card: Card) -> None:
    card.start_watchdog()
    while card.state().polls == 0:
        time.sleep(0.005)
    kill_watchdog(card)
    with refused(PlantError, "watchdog_test_failed"):
        card.arm()
    assert not card.state().drive_enabled
    assert not card.state().armed


def test_a_watchdog_that_looks_but_never_cuts_keeps_the_drives_off(card: Card) -> None:
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
def test_a_watchdog_that_does_not_look_any_more_takes_the_drives_with_it(card: Card, how: signal.Signals) -> None:
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


def test_a_pause_of_the_whole_machine_is_no_dead_watchdog() -> None:
    """Two looks that are far apart count as two periods: nobody could have counted in between."""
    still = Stillness(0.001)
    times = count(0.0, 0.3)
    assert max(still.update(7, next(times)) for _ in range(100)) <= 100 * 0.002
    assert still.update(8, next(times)) == 0.0


def test_a_counter_that_stands_is_timed() -> None:
    still = Stillness(0.001)
    assert [round(still.update(7, 0.001 * tick), 6) for tick in range(4)] == [0.0, 0.001, 0.002, 0.003]
