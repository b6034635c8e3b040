"""What is broken on purpose is told in words, by the symbols of the paper, wherever it is told."""

import math
import re

import pytest

from plant.interface import NOT_MEASURED, InjectedFault, InjectedFaultKind, Sensor, T_s
from plant.simulator import FaultInjector


@pytest.mark.parametrize("sensor", Sensor)
@pytest.mark.parametrize("kind", InjectedFaultKind)
def test_words_hold_no_name_of_the_code(kind: InjectedFaultKind, sensor: Sensor) -> None:
    words = InjectedFault(kind, sensor).words
    assert FaultInjector(InjectedFault(kind, sensor)).description == words
    assert not re.search(r"[a-z]{2,}_|_[a-z]|theta", words), words
    about_a_sensor = kind in (*list(InjectedFaultKind)[:5], InjectedFaultKind.SATURATION, InjectedFaultKind.LOST_COUNTS)
    assert words.endswith(f" of {sensor.replace('theta', 'θ')}") == about_a_sensor


def test_a_sensor_goes_by_its_symbol() -> None:
    assert InjectedFault(InjectedFaultKind.DRIFT_UP, Sensor.THETA_A).words == "drift up of θ_A"
    assert InjectedFault(InjectedFaultKind.WATCHDOG_DEATH).words == "watchdog death"


@pytest.mark.parametrize(
    ("sensor", "per_s", "most"),
    [
        (Sensor.Q, 20.0, 3.0),
        (Sensor.THETA_A, 10.0, 2.0),
        (Sensor.THETA_B, 10.0, 2.0),
        (Sensor.F_A, 400.0, 100.0),
        (Sensor.F_B, 400.0, 100.0),
    ],
)
def test_a_drift_goes_on_evenly_to_its_end_and_a_load_cell_reads_nothing_at_least(
    sensor: Sensor, per_s: float, most: float
) -> None:
    m = NOT_MEASURED._replace(**{sensor.value: 5.0})
    up, down = (
        FaultInjector(InjectedFault(InjectedFaultKind.DRIFT_UP, sensor)),
        FaultInjector(InjectedFault(InjectedFaultKind.DRIFT_DOWN, sensor)),
    )
    least = 0.0 if sensor in (Sensor.F_A, Sensor.F_B) else -math.inf
    for tick in range(1, 400):
        drift = min(per_s * tick * T_s, most)
        assert getattr(up.distort(m), sensor.value) == pytest.approx(5.0 + drift)
        assert getattr(down.distort(m), sensor.value) == pytest.approx(max(5.0 - drift, least))
