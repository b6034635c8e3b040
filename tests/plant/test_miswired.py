"""What is broken at the terminals: one place of the wiring differs, by what is said, and nothing else does."""

import pytest

from plant.interface import InjectedFault, InjectedFaultKind, Sensor
from plant.virtual_daq import apply_miswiring
from plant.wiring import SECTIONS, Wiring, load_wiring

SAID = load_wiring("pcie-6323")


def differing(wiring: Wiring) -> list[str]:
    """Return the entries in which a wiring is not what its file says, as section.entry."""
    return [
        f"{section}.{entry}"
        for section in SECTIONS
        for entry, value in vars(getattr(SAID, section)).items()
        if repr(vars(getattr(wiring, section))[entry]) != repr(value)  # a place that is not known is no number
    ]


@pytest.mark.parametrize("kind", [kind for kind in InjectedFaultKind if not kind.startswith("swapped")])
def test_only_what_happens_at_a_terminal_is_another_wiring(kind: InjectedFaultKind) -> None:
    expected = {
        InjectedFaultKind.LOST_COUNTS: ["encoder_A.counts_per_rev"],
        InjectedFaultKind.SATURATION: ["load_cell_B.slope", "load_cell_B.offset"],
    }
    sensor = Sensor.F_B if kind is InjectedFaultKind.SATURATION else Sensor.THETA_A
    assert differing(apply_miswiring(SAID, InjectedFault(kind, sensor))) == expected.get(kind, [])
    assert apply_miswiring(SAID, None) == SAID


def test_three_of_ten_counts_are_lost_and_a_saturated_cell_stands_beyond_the_range() -> None:
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
def test_swapped_wires_change_places_and_twice_swapped_are_right(
    kind: InjectedFaultKind, pair: tuple[str, str], terminal: str
) -> None:
    swapped = apply_miswiring(SAID, InjectedFault(kind))
    assert differing(swapped) == [f"{section}.{terminal}" for section in pair]
    assert [getattr(getattr(swapped, section), terminal) for section in pair] == [
        getattr(getattr(SAID, section), terminal) for section in reversed(pair)
    ]
    assert apply_miswiring(swapped, InjectedFault(kind)) == SAID
