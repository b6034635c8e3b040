"""Rate and lateness follow from the samples, not from the time at which they are read."""

import math

import numpy as np
import pytest

from backend.realtime.ring_buffer import WIDTH, Ring
from backend.realtime.timing import compute_timing, count_lateness
from backend.sample import INDEX


def write(ring: Ring, lateness_s: float, overruns: int) -> None:
    row = np.zeros(WIDTH)
    row[INDEX["lateness_s"]], row[INDEX["overruns"]] = lateness_s, overruns
    ring.append(row)


def test_ticks_on_time_give_the_nominal_rate() -> None:
    ring = Ring.create(6000)
    for tick in range(5500):
        write(ring, lateness_s=1e-4 if tick % 50 else 2e-3, overruns=3)
    kept = compute_timing(ring)
    assert kept.rate_Hz == pytest.approx(1000.0)
    assert kept.lateness_p50_s == pytest.approx(1e-4)
    assert kept.lateness_p99_s == pytest.approx(2e-3)
    assert kept.overruns == 3
    ring.close()


def test_skipped_deadlines_lower_the_rate() -> None:
    ring = Ring.create(6000)
    for tick in range(2001):
        write(ring, 0.0, overruns=tick // 2)
    assert compute_timing(ring).rate_Hz == pytest.approx(1000.0 * 2000 / 3000)
    ring.close()


def test_a_deadline_missed_directly_after_the_first_sample_counts() -> None:
    ring = Ring.create(16)
    for overruns in (5, 6, 6, 6, 6):
        write(ring, 0.0, overruns)
    assert compute_timing(ring).rate_Hz == pytest.approx(1000.0 * 4 / 5)
    ring.close()


def test_the_rate_is_unknown_before_the_first_samples() -> None:
    ring = Ring.create(16)
    write(ring, 0.0, 0)
    assert math.isnan(compute_timing(ring).rate_Hz)
    ring.close()


def test_ticks_are_counted_by_lateness() -> None:
    """Classes up to 20, 50, 100, 200, 500 us, 1, 2, 5 ms and above; an early tick has no lateness."""
    ring = Ring.create(64)
    for times, lateness_us in enumerate((10, 30, 80, 150, 400, 700, 1500, 4000, 9000), start=1):
        for _ in range(times):
            write(ring, 1e-6 * lateness_us, 0)
    write(ring, -1e-3, 0)
    assert count_lateness(ring) == [2, 2, 3, 4, 5, 6, 7, 8, 9]
    ring.close()
