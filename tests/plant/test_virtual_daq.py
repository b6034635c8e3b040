"""The virtual card: its terminals and the faults injected there."""

import math
import re
from dataclasses import replace

import numpy as np
import pytest

from plant.dynamics import PlantState
from plant.interface import (
    NOT_MEASURED,
    ZERO_VOLTS,
    InjectedFault,
    InjectedFaultKind,
    MotorCommand,
    PlantError,
    Sensor,
    T_s,
)
from plant.parameters import load_parameters
from plant.safety_card import WATCHDOG_S
from plant.simulator import FaultInjector, Simulator
from plant.terminals import LoadCellScaling, compute_volts, quantize_volts
from plant.virtual_daq import VirtualRig, apply_miswiring
from plant.wiring import SECTIONS, Wiring, load_wiring

# Signals at the terminals of a virtual card, compared with numpy and with the joint position.

PARAMETERS = load_parameters("lab")
WIRING = load_wiring("pcie-6323")


def test_a_table_gives_the_volts_interpolated_between_its_points() -> None:
    """The card produces the volts of its own table, compared with numpy's interpolation of the same points."""
    F, V = (0.0, 5.0, 20.0, 60.0), (0.1, 1.0, 2.0, 9.0)
    cell = LoadCellScaling(math.nan, 0.0, np.column_stack((F, V)))
    for force in np.linspace(0.0, 60.0, 241):
        assert compute_volts(cell, float(force)) == pytest.approx(np.interp(force, F, V), rel=1e-12)
    assert compute_volts(cell, 70.0) == pytest.approx(9.0 + 10.0 * 7.0 / 40.0)
    assert compute_volts(cell, -1.0) == pytest.approx(0.1 - 0.9 / 5.0)


@pytest.mark.parametrize("active", ["high", "low"])
@pytest.mark.parametrize(
    ("position", "q", "held"),
    [(1.0, -1.1, False), (1.0, 0.9, False), (1.0, 1.1, True), (-0.5, -0.6, True), (-0.5, 0.6, False)],
)
def test_the_end_switch_is_read_at_either_active_level(active: str, position: float, q: float, held: bool) -> None:
    wiring = replace(WIRING, end_switch=replace(WIRING.end_switch, active=active, position=position))
    slack = -abs(q) * PARAMETERS.geometry.r_j / PARAMETERS.geometry.r_m
    start = PlantState(*Simulator(PARAMETERS).x)._replace(q=q, theta_A=slack, theta_B=slack)
    rig = VirtualRig(wiring, Simulator(PARAMETERS, 0, start))
    rig.open()
    rig.read()
    assert rig.at_end is held
    rig.close()


def test_a_converter_saturates_at_its_first_and_last_code() -> None:
    step = 20.0 / 2**16
    assert (quantize_volts(25.0), quantize_volts(-25.0)) == (10.0 - step, -10.0)
    assert (quantize_volts(10.0), quantize_volts(10.0 - step)) == (10.0 - step, 10.0 - step)
    assert quantize_volts(1.2345) == pytest.approx(1.2345, abs=step / 2)
    assert math.isnan(quantize_volts(math.nan))


def test_a_disconnected_card_keeps_its_last_volts_until_its_watchdog_expires() -> None:
    rig = VirtualRig(WIRING, Simulator(PARAMETERS, 0))
    rig.open()
    rig.read()
    rig.write(MotorCommand(2.0, 0.0))
    rig.inject(InjectedFault(InjectedFaultKind.DEVICE_GONE))
    driven = 0
    while rig.card_state().drive_enabled and driven < 1000:
        with pytest.raises(PlantError):
            rig.write(ZERO_VOLTS)
        driven += 1
    assert driven * T_s == pytest.approx(WATCHDOG_S, abs=1.5 * T_s)
    rig.close()


# Faults at the terminals: each changes exactly one entry of the wiring.

SAID = load_wiring("pcie-6323")


def differing(wiring: Wiring) -> list[str]:
    """Return the entries in which a wiring differs from its file, as section.entry."""
    return [
        f"{section}.{entry}"
        for section in SECTIONS
        for entry, value in vars(getattr(SAID, section)).items()
        if repr(vars(getattr(wiring, section))[entry]) != repr(value)  # a place that is not known is no number
    ]


@pytest.mark.parametrize("kind", [kind for kind in InjectedFaultKind if not kind.startswith("swapped")])
def test_only_faults_at_terminals_change_the_wiring(kind: InjectedFaultKind) -> None:
    expected = {
        InjectedFaultKind.LOST_COUNTS: ["encoder_A.counts_per_rev"],
        InjectedFaultKind.SATURATION: ["load_cell_B.slope", "load_cell_B.offset"],
    }
    sensor = Sensor.F_B if kind is InjectedFaultKind.SATURATION else Sensor.THETA_A
    assert differing(apply_miswiring(SAID, InjectedFault(kind, sensor))) == expected.get(kind, [])
    assert apply_miswiring(SAID, None) == SAID


def test_three_of_ten_counts_are_lost_and_a_saturated_cell_exceeds_the_range() -> None:
    lost = apply_miswiring(SAID, InjectedFault(InjectedFaultKind.LOST_COUNTS, Sensor.Q)).encoder_q
    assert lost.counts_per_rev == pytest.approx(0.7 * SAID.encoder_q.counts_per_rev, rel=1e-12)
    cell = apply_miswiring(SAID, InjectedFault(InjectedFaultKind.SATURATION, Sensor.F_A)).load_cell_A
    assert (cell.slope, cell.offset, cell.table) == (1.0, 20.0, ())


@pytest.mark.parametrize(
    ("kind", "pair", "terminal"),
    [
        (InjectedFaultKind.SWAPPED_LOAD_CELLS, ("load_cell_A", "load_cell_B"), "channel"),
        (InjectedFaultKind.SWAPPED_ENCODERS, ("encoder_A", "encoder_B"), "counter"),
        (InjectedFaultKind.SWAPPED_MOTORS, ("motor_A", "motor_B"), "channel"),
    ],
)
def test_swapped_wires_exchange_signals_and_a_second_swap_restores_them(
    kind: InjectedFaultKind, pair: tuple[str, str], terminal: str
) -> None:
    swapped = apply_miswiring(SAID, InjectedFault(kind))
    assert differing(swapped) == [f"{section}.{terminal}" for section in pair]
    assert [getattr(getattr(swapped, section), terminal) for section in pair] == [
        getattr(getattr(SAID, section), terminal) for section in reversed(pair)
    ]
    assert apply_miswiring(swapped, InjectedFault(kind)) == SAID


# Injected faults are described in words, with the symbols of the paper.


@pytest.mark.parametrize("sensor", Sensor)
@pytest.mark.parametrize("kind", InjectedFaultKind)
def test_texts_of_injected_faults_contain_no_identifiers(kind: InjectedFaultKind, sensor: Sensor) -> None:
    words = InjectedFault(kind, sensor).words
    assert FaultInjector(InjectedFault(kind, sensor)).description == words
    assert not re.search(r"[a-z]{2,}_|_[a-z]|theta", words), words
    about_a_sensor = kind in (*list(InjectedFaultKind)[:5], InjectedFaultKind.SATURATION, InjectedFaultKind.LOST_COUNTS)
    assert words.endswith(f" of {sensor.replace('theta', 'θ')}") == about_a_sensor


def test_a_sensor_is_named_by_its_symbol() -> None:
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
def test_a_drift_is_linear_to_its_end_and_load_cells_never_read_below_zero(
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
