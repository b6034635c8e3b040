"""The limit flags in the sample say which limit acted, in the tick it acted; a fault tells the limit as it is."""

import math

import numpy as np
import pytest

from backend.control.motion_types import make_voltage_limit_flags
from backend.faults import Fault, Limit
from backend.realtime.commands import ApplyPush, SetReferences
from backend.realtime.control_loop import FaultDescriber
from backend.units import AngleUnit, format_text
from plant.interface import Measurement
from plant.parameters import load_parameters
from tests.realtime.bench_top import BenchTop


@pytest.fixture(scope="module")
def pushed_bench() -> BenchTop:
    bench = BenchTop(load_parameters("ideal"))
    bench.run()
    bench.send(SetReferences(0.0, 8.0))
    bench.advance(4.0)
    bench.send(ApplyPush(18.0, 3.0))
    bench.advance(3.0)
    bench.advance(3.0)
    return bench


def test_tension_floor_is_flagged_while_it_lifts_the_stiffness(pushed_bench: BenchTop) -> None:
    flags, S, S_ref = (pushed_bench.column(name, last=6000) for name in ("limits", "S", "S_ref"))
    at_floor = (flags.astype(int) & Limit.TENSION_FLOOR) != 0
    assert np.all(at_floor[1000:3000])
    assert np.all((S - S_ref)[1500:3000] > 0.3)
    assert not np.any(at_floor[-1000:])


def test_governor_is_flagged_while_it_moves_the_references(pushed_bench: BenchTop) -> None:
    flags, S_ref, governed = (pushed_bench.column(name, last=10_000) for name in ("limits", "S_ref", "S_ref_gov"))
    held_back = (flags.astype(int) & Limit.GOVERNOR) != 0
    assert np.array_equal(held_back, governed != S_ref)
    assert 0 < np.count_nonzero(held_back) < 1000


def test_a_joint_beyond_its_limit_is_told_with_the_limit_that_it_has() -> None:
    """In degrees too, in which most people read it: the bound is 90, not what three decimals of a radian make of it."""
    checks = FaultDescriber(load_parameters("ideal"))
    fault, seen = checks.find_static_fault(Measurement(math.radians(-91.25), 0.0, 0.0, 20.0, 20.0, 10.0, 0.0, 0.0))
    assert fault is Fault.JOINT_LIMIT
    told, bound = format_text(seen, AngleUnit.DEGREES).split("; ")
    assert bound == "the bound is 90° to either side"
    assert float(told.removeprefix("q = ").removesuffix("°")) == pytest.approx(-91.25, abs=5e-4)


def test_a_clipped_voltage_is_flagged_at_its_own_motor_and_no_other_flag_with_it() -> None:
    flags = [make_voltage_limit_flags(A, B) for A in (False, True) for B in (False, True)]
    assert flags == [0, Limit.VOLTAGE_B, Limit.VOLTAGE_A, Limit.VOLTAGE_A | Limit.VOLTAGE_B]
