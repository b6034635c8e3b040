"""What is broken on purpose is told in words, by the symbols of the paper, wherever it is told."""

import re

import pytest

from plant.breakage import Breakage, Broken, BrokenPart, Sensor


@pytest.mark.parametrize("sensor", Sensor)
@pytest.mark.parametrize("kind", Breakage)
def test_words_hold_no_name_of_the_code(kind: Breakage, sensor: Sensor) -> None:
    words = Broken(kind, sensor).words
    assert BrokenPart(Broken(kind, sensor)).description == words
    assert not re.search(r"[a-z]{2,}_|_[a-z]|theta", words), words
    about_a_sensor = kind in (*list(Breakage)[:5], Breakage.SATURATION, Breakage.LOST_COUNTS)
    assert words.endswith(f" of {sensor.replace('theta', 'θ')}") == about_a_sensor


def test_a_sensor_goes_by_its_symbol() -> None:
    assert Broken(Breakage.DRIFT_UP, Sensor.THETA_A).words == "drift up of θ_A"
    assert Broken(Breakage.WATCHDOG_DEATH).words == "watchdog death"
