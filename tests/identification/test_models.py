"""Models: structures, published numbers, simulated responses."""

import numpy as np
import pytest
from scipy.signal import cont2discrete, dlsim, tf2ss

from backend.identification.models import (
    DEAD_TIME,
    KNOWN,
    MAX_LAGS,
    MAX_ORDER,
    TABLE_1,
    find_structure,
    free_responses,
    simulate_response,
)
from backend.identification.records import StructureError, UnstableModelError
from tests.refusals import refused

# The names of model structures.


@pytest.mark.parametrize(
    ("name", "order"),
    [
        ("first", 1),
        ("third", 3),
        ("lags2", 2),
        (f"lags{MAX_LAGS}", MAX_LAGS),
        ("order:1", 1),
        (f"order:{MAX_ORDER}", MAX_ORDER),
    ],
)
def test_the_name_of_a_structure_determines_its_order(name: str, order: int) -> None:
    plain, late = find_structure(name), find_structure(f"{name}{DEAD_TIME}")
    assert plain.order == late.order == order
    assert not plain.delayed
    assert late.delayed
    assert late.names == (*plain.names, "t_d")


@pytest.mark.parametrize("name", ["", "lags1", f"lags{MAX_LAGS + 1}", "order:0", f"order:{MAX_ORDER + 1}", "fourth"])
def test_a_structure_beyond_the_largest_order_is_rejected_with_the_known_ones(name: str) -> None:
    assert f"lags2 .. lags{MAX_LAGS}, order:1 .. order:{MAX_ORDER}" in KNOWN
    with refused(StructureError, "unknown_structure", name=name, known=KNOWN):
        find_structure(name)


# Table 1 against the paper, number by number, as printed except a1 of G_q (docs/explanation/errata.md, E2).

PRINTED = {
    # F [N]: K and T of G_q, a2 and a1 of G_q, K and T of G_S, a2 and a1 of G_S
    10.0: ("0.0498", "0.64", "7.329e-5", "0.05747", "1.17", "0.57", "2.3e-5", "1.6e-3"),
    20.0: ("0.0484", "0.78", "4.919e-5", "0.04688", "2.826", "1.19", "2.1e-5", "2.2e-3"),
    30.0: ("0.0495", "1.58", "3.475e-5", "0.03309", "1.821", "0.62", "1.3e-5", "4.2e-3"),
    40.0: ("0.0491", "2.98", "2.2e-6", "1.07e-2", "1.47", "0.43", "7.7e-6", "7.4e-4"),
}
NOMINAL_S = {10.0: 8.24, 20.0: 10.55, 30.0: 12.43, 40.0: 14.06}


@pytest.mark.parametrize("tension", PRINTED)
def test_table_1_contains_the_numbers_of_the_paper(tension: float) -> None:
    row, (K_q, T_q, a2_q, a1_q, K_S, T_S, a2_S, a1_S) = TABLE_1[tension], map(float, PRINTED[tension])
    assert (row.S, row.K_q, row.T_q, row.a2_q) == (NOMINAL_S[tension], K_q, T_q, a2_q)
    assert row.a1_q == pytest.approx(a1_q / 10.0, rel=1e-12)
    assert (row.K_S, row.T_S, row.a2_S, row.a1_S) == (K_S, T_S, a2_S, a1_S)


def test_table_1_has_no_additional_rows() -> None:
    assert set(TABLE_1) == set(PRINTED)


# Simulation by sections, compared with the step-by-step discretization of SciPy.

PERIOD_S = 1e-3
MODELS = [
    ("first", [1.0, 0.78]),
    ("third", [1.0, 0.78, 4.919e-5, 4.688e-3]),
    ("third", [1.0, 0.05, 4e-4, 0.09]),
    ("lags4", [1.0, 0.0854]),
    ("order:2", [1.0, 0.3, 0.05]),
    ("order:4", [1.0, 0.35, 0.045, 2.6e-3, 5.5e-5]),
]


@pytest.mark.parametrize(("name", "parameters"), MODELS)
def test_the_response_to_a_held_input_is_exact(name: str, parameters: list[float]) -> None:
    shape = find_structure(name)
    values = np.array(parameters)
    u = np.repeat(np.random.default_rng(0).standard_normal(60), 50)
    system = cont2discrete(tf2ss([1.0], shape.denominator(values)[::-1]), PERIOD_S)
    expected = dlsim((*system[:4], PERIOD_S), u)[1][:, 0]
    np.testing.assert_allclose(simulate_response(shape.poles(values), PERIOD_S, u), expected, atol=1e-9)


def test_free_responses_span_every_decay_of_the_system() -> None:
    shape = find_structure("third")
    poles = shape.poles(np.array([1.0, 0.3, 1e-3, 0.02]))
    t = np.arange(2000) * PERIOD_S
    decays = np.column_stack([np.exp(poles[0].real * t), np.exp(poles[1] * t).real, np.exp(poles[1] * t).imag])
    columns = free_responses(poles, PERIOD_S, t.size)
    explained = columns @ np.linalg.lstsq(columns, decays, rcond=None)[0]
    np.testing.assert_allclose(explained, decays, atol=1e-9)


@pytest.mark.parametrize("order", [1, 3])
def test_free_responses_below_e_to_the_minus_40_are_zero(order: int) -> None:
    """Computing with subnormal numbers, to which a decay leads, is a hundred times slower."""
    rate = 16.0
    columns = free_responses(np.full(order, -rate, dtype=np.complex128), PERIOD_S, 10_000)
    last = np.flatnonzero(np.any(columns, axis=1))[-1]
    # The initial samples, one per pole, are not zero.
    assert rate * PERIOD_S * (last + 1 - order) == pytest.approx(40.0, abs=rate * PERIOD_S)


def test_an_initial_state_adds_to_the_response() -> None:
    poles = find_structure("lags4").poles(np.array([1.0, 0.05]))
    u = np.random.default_rng(1).standard_normal(300)
    initial = np.array([0.3, -1.0, 2.0, 0.5])
    expected = simulate_response(poles, PERIOD_S, u) + free_responses(poles, PERIOD_S, u.size) @ initial
    np.testing.assert_allclose(simulate_response(poles, PERIOD_S, u, initial), expected, atol=1e-12)


@pytest.mark.parametrize("poles", [[0.1 + 0j], [-1e-12 + 0j], [-1e5 + 0j], [np.nan + 0j]])
def test_unstable_and_unsampled_poles_are_refused(poles: list[complex]) -> None:
    with pytest.raises(UnstableModelError):
        simulate_response(np.array(poles), PERIOD_S, np.ones(10))


@pytest.mark.parametrize(("name", "parameters"), MODELS)
def test_a_structure_recovers_its_denominator(name: str, parameters: list[float]) -> None:
    shape = find_structure(name)
    values = np.array(parameters)
    again = shape.denominator(shape.from_denominator(1.0, shape.denominator(values)))
    np.testing.assert_allclose(again, shape.denominator(values), rtol=1e-9)
    np.testing.assert_allclose(np.polyval(shape.denominator(values)[::-1], shape.poles(values)), 0.0, atol=1e-6)


@pytest.mark.parametrize("name", ["", "second", "lags1", "lags7", "order:0", "order:5", "order:x"])
def test_unknown_structures_are_refused(name: str) -> None:
    with refused(StructureError, "unknown_structure", name=name):
        find_structure(name)
