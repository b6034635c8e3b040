"""What the service sees of a card beside the loop: when nobody would take the drives away any more."""

import itertools

import pytest

from backend.realtime.heartbeat import POLL_S, WatchdogMonitor
from plant.safety_card import WATCHDOG_S, Card, CardState


class Shown(Card):
    """A card with these registers; its watchdog never looks again."""

    def __init__(self, armed: bool, drive_enabled: bool) -> None:
        self._shown = CardState(1, 7, armed, drive_enabled, False, False, False, False, WATCHDOG_S, 0.0, 0.0)

    def state(self) -> CardState:
        return self._shown


@pytest.mark.parametrize(("armed", "drive_enabled"), [*itertools.product((True, False), repeat=2)])
def test_a_watchdog_that_stands_still_is_lost_where_it_has_drives_to_take_away(
    armed: bool, drive_enabled: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    now_s = [100.0]
    monkeypatch.setattr("plant.safety_card.time.monotonic", lambda: now_s[0])
    guard = WatchdogMonitor(Shown(armed, drive_enabled))
    looks = 0
    while guard.watchdog_silent_s <= WATCHDOG_S:
        assert not guard.is_watchdog_lost
        guard.poll(loop_ended=False)
        now_s[0] += POLL_S
        looks += 1
        assert looks < 1000
    assert guard.is_watchdog_lost is (armed and drive_enabled)
