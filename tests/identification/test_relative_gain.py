"""Relative gain: published values, derivatives, and standard errors by Monte Carlo."""

import numpy as np
import pytest

from backend.identification import relative_gain, relative_gain_std


def test_the_column_of_wood_and_berry_has_its_published_relative_gain() -> None:
    # Seborg, Edgar, Mellichamp and Doyle, Process Dynamics and Control, example 18.
    assert relative_gain(np.array([[12.8, -18.9], [6.6, -19.4]])) == pytest.approx(2.0094, abs=1e-4)


def test_it_is_the_entry_of_g_times_its_transposed_inverse() -> None:
    random = np.random.default_rng(1)
    G = random.standard_normal((50, 2, 2)) + 1j * random.standard_normal((50, 2, 2))
    array = G * np.swapaxes(np.linalg.inv(G), 1, 2)
    assert relative_gain(G) == pytest.approx(array[:, 0, 0])
    assert 1.0 - relative_gain(G) == pytest.approx(array[:, 0, 1])


def test_it_does_not_depend_on_the_units() -> None:
    G = np.array([[1.0, 0.4], [-0.7, 2.0]])
    assert relative_gain(np.diag([3.0, 1e-3]) @ G @ np.diag([50.0, 0.2])) == pytest.approx(relative_gain(G))


def test_a_singular_matrix_has_an_infinite_relative_gain() -> None:
    assert np.isinf(np.abs(relative_gain(np.array([[1.0, 2.0], [0.5, 1.0]]))))


REAL = [
    np.array([[1.0, 0.3], [0.2, 2.0]]),
    np.array([[12.8, -18.9], [6.6, -19.4]]),
    np.array([[1.0, 0.0], [0.0, 2.0]]),
    np.array([[1.0, 0.5], [0.0, 1.0]]),
]


@pytest.mark.parametrize("G", REAL)
def test_the_standard_error_is_that_of_monte_carlo(G: np.ndarray) -> None:
    random = np.random.default_rng(7)
    factor = 0.01 * np.mean(np.abs(G)) * random.standard_normal((4, 4))
    covariance = factor @ factor.T
    drawn = G.ravel() + random.multivariate_normal(np.zeros(4), covariance, 200_000)
    values = relative_gain(drawn.reshape(-1, 2, 2)).real
    assert relative_gain_std(G, covariance) == pytest.approx(np.std(values), rel=0.03)


def test_the_standard_error_of_a_complex_relative_gain_is_that_of_monte_carlo() -> None:
    random = np.random.default_rng(5)
    G = np.array([[1.0 - 0.5j, 0.3 + 0.2j], [0.2j, 2.0 + 1.0j]])
    factor = 0.01 * (random.standard_normal((4, 6)) + 1j * random.standard_normal((4, 6)))
    drawn = G.ravel() + random.standard_normal((200_000, 6)) @ factor.T
    values = relative_gain(drawn.reshape(-1, 2, 2))
    assert relative_gain_std(G, factor @ factor.conj().T) == pytest.approx(np.std(values), rel=0.03)


def test_several_matrices_have_their_errors_at_once() -> None:
    G = np.array(REAL)
    covariance = np.array([np.diag([1.0, 2.0, 3.0, 4.0]) * 1e-4 * scale for scale in (1.0, 2.0, 3.0, 4.0)])
    together = relative_gain_std(G, covariance)
    assert together == pytest.approx(
        [float(relative_gain_std(one, spread)) for one, spread in zip(G, covariance, strict=True)]
    )
