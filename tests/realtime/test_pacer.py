"""Deadlines are absolute, late ones are reported, missed ones are skipped and counted: on a simulated clock."""

import os
import signal
import threading
import time

import pytest
from hypothesis import given
from hypothesis import strategies as st

from backend.realtime.timing import Pacer, request_real_time

pytestmark = pytest.mark.live

MS = 1_000_000


class Clock:
    def __init__(self, wake_up_ns: int = 0) -> None:
        self.ns = 5 * MS
        self.wake_up_ns = wake_up_ns
        self.slept_until: list[int] = []

    def now_ns(self) -> int:
        return self.ns

    def sleep_until(self, deadline_ns: int) -> None:
        self.slept_until.append(deadline_ns)
        self.ns = max(self.ns, deadline_ns) + self.wake_up_ns


def test_deadlines_do_not_drift_with_late_wake_ups() -> None:
    clock = Clock(wake_up_ns=100_000)
    pacer = Pacer(0.001, clock.now_ns, clock.sleep_until)
    lateness_s = [pacer.wait() for _ in range(5)]
    assert clock.slept_until == [(6 + k) * MS for k in range(5)]
    assert lateness_s == pytest.approx([1e-4] * 5)
    assert pacer.overruns == 0


def test_lateness_below_one_period_skips_no_tick() -> None:
    clock = Clock()
    pacer = Pacer(0.001, clock.now_ns, clock.sleep_until)
    clock.ns += 1_700_000
    assert pacer.wait() == pytest.approx(0.7e-3)
    assert pacer.overruns == 0
    assert clock.slept_until == []
    pacer.wait()
    assert clock.slept_until == [7 * MS]


def test_missed_deadlines_are_skipped() -> None:
    clock = Clock()
    pacer = Pacer(0.001, clock.now_ns, clock.sleep_until)
    clock.ns += 301_200_000
    assert pacer.wait() == pytest.approx(0.2e-3)
    assert pacer.overruns == 300
    pacer.wait()
    assert clock.slept_until == [(5 + 302) * MS]
    assert pacer.overruns == 300


@given(st.lists(st.integers(0, 5 * MS), max_size=50))
def test_ticks_and_overruns_account_for_all_time(work_ns: list[int]) -> None:
    clock = Clock()
    pacer = Pacer(0.001, clock.now_ns, clock.sleep_until)
    start_ns = clock.ns
    for busy_ns in work_ns:
        clock.ns += busy_ns
        lateness_s = pacer.wait()
        assert 0 <= lateness_s < 0.001
    periods = len(work_ns) + pacer.overruns
    assert 0 <= clock.ns - start_ns - periods * MS < MS


def test_the_real_clock_is_never_early_and_survives_signals() -> None:
    received = []
    before = signal.signal(signal.SIGUSR1, lambda *_: received.append(time.monotonic()))
    try:
        start_s = time.monotonic()  # before the pacer is made, whose period begins there
        pacer = Pacer(0.2)
        kill = threading.Timer(0.02, os.kill, (os.getpid(), signal.SIGUSR1))
        kill.start()
        assert pacer.wait() >= 0
        assert time.monotonic() - start_s >= 0.2
        kill.join()  # on a busy machine the thread may come later than that, but not once the handler is gone
        assert len(received) == 1
    finally:
        signal.signal(signal.SIGUSR1, before)


def test_reported_privileges_match_the_kernel() -> None:
    read_end, write_end = os.pipe()
    child = os.fork()
    if child == 0:
        granted = request_real_time()
        fifo = os.sched_getscheduler(0) == os.SCHED_FIFO
        with open("/proc/self/status", encoding="ascii") as status:
            locked_kB = next(int(line.split()[1]) for line in status if line.startswith("VmLck"))
        honest = (granted.priority > 0) == fifo and granted.memory_locked == (locked_kB > 0)
        complete = (granted.priority == 0) + (not granted.memory_locked) == len(granted.refusals)
        os.write(write_end, b"yes" if honest and complete else b"no")
        os._exit(0)
    os.waitpid(child, 0)
    assert os.read(read_end, 10) == b"yes"
    os.close(read_end)
    os.close(write_end)
