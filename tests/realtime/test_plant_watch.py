"""A plant that fails is told of once, and that it answers again once it has done so for a second."""

from backend.realtime.commands import Event, PlantAnswers, PlantFailing
from backend.realtime.control_loop import PlantHealthMonitor


def watched(failing: set[int], ticks: int) -> list[Event]:
    watch, events = PlantHealthMonitor(), []
    for tick in range(ticks):
        watch.begin()
        if tick in failing:
            watch.failure = f"it broke in tick {tick}"
        events += watch.end(tick)
    return events


def test_a_failure_is_told_and_its_end_after_a_thousand_good_ticks() -> None:
    assert watched({5}, 1005) == [PlantFailing(5, "it broke in tick 5")]
    assert watched({5}, 3000) == [PlantFailing(5, "it broke in tick 5"), PlantAnswers(1005)]


def test_one_that_fails_now_and_then_is_told_of_once() -> None:
    now_and_then = set(range(0, 10_000, 1000))
    assert watched(now_and_then, 10_999) == [PlantFailing(0, "it broke in tick 0"), PlantAnswers(10_000)]


def test_a_plant_that_never_fails_is_not_spoken_of() -> None:
    assert watched(set(), 3000) == []
