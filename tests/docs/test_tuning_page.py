"""docs/explanation/tuning.md: every formula places the stated poles, computed with polynomials."""

import math
import re
from pathlib import Path

import numpy as np
import pytest
from numpy.polynomial import Polynomial
from scipy.optimize import brentq

from backend.tuning.gains import motor_gains, outer_gains

PAGE = " ".join((Path(__file__).parents[2] / "docs" / "explanation" / "tuning.md").read_text(encoding="utf-8").split())
s = Polynomial([0.0, 1.0])
GREEK = {"Σ": "Sum", "Π": "Pro", "λ": "lam"}


def formulas(line: str, **known: float) -> dict[str, float]:
    """Return the values of the formulas "name = expression" in one section of the page."""
    found = re.search(line, PAGE)
    assert found, line
    values = dict(known)
    for name, text in re.findall(r"(\w+) = (.+?)(?= \w+ = |$)", found[0]):
        expression = text.replace("²", "**2").replace("³", "**3").replace("−", "-")
        for letter, spelled in GREEK.items():
            expression = expression.replace(letter, spelled)
        expression = re.sub(r"(?<=[\w)]) (?=[\w(])", "*", expression).replace("**2(", "**2*(")
        values[name] = eval(expression, {}, values)
    return values


def close(left: Polynomial, right: Polynomial) -> None:
    assert left.coef == pytest.approx(right.coef, rel=1e-12)


@pytest.mark.parametrize("lam", [0.05, 0.0854, 0.3])
def test_the_formulas_of_the_motor_loop_equal_the_code_and_place_four_poles(lam: float) -> None:
    K_m, T_m = 2.86, 0.22
    page = formulas(
        r"t_f = T_m λ/D .*?k_d = \S+ \S+ \S+ \S+ \S+/\(K_m λ D\)", K_m=K_m, T_m=T_m, lam=lam, D=4.0 * T_m - lam
    )
    gains = motor_gains(K_m, T_m, lam)
    assert {name: page[name] for name in gains._fields} == pytest.approx(gains._asdict(), rel=1e-12)
    closed = s**2 * (T_m * s + 1) * (page["t_f"] * s + 1) + K_m * (page["k_d"] * s**2 + page["k_p"] * s + page["k_i"])
    close(closed, K_m * page["k_i"] * (lam * s + 1) ** 4)


@pytest.mark.parametrize("lam", [0.2, 0.5])
def test_the_first_order_formulas_equal_the_code_and_place_two_poles(lam: float) -> None:
    K, T = 0.05, 0.342
    page = formulas(r"k_i = T/\(K λ²\) k_p = \(2 T − λ\)/\(K λ\)", K=K, T=T, lam=lam)
    assert (page["k_p"], page["k_i"]) == pytest.approx(outer_gains(K, T, lam)[:2], rel=1e-12)
    close(s * (T * s + 1) + K * (page["k_p"] * s + page["k_i"]), K * page["k_i"] * (lam * s + 1) ** 2)


@pytest.mark.parametrize(("first", "second"), [(0.64, 0.09), (0.2, 0.2), (0.05 + 0.1j, 0.05 - 0.1j)])
@pytest.mark.parametrize("share", [0.2, 0.5, 0.9])
def test_the_formulas_for_two_plant_poles_place_four_poles(first: complex, second: complex, share: float) -> None:
    K, Pro, Sum = 0.7, (first * second).real, (first + second).real
    lam = share * 4.0 * Pro / Sum
    page = formulas(r"t_f = Π λ/D .*?k_d = .*?/\(K λ D\)", K=K, Pro=Pro, Sum=Sum, lam=lam, D=4.0 * Pro - lam * Sum)
    process = Pro * s**2 + Sum * s + 1
    closed = s * process * (page["t_f"] * s + 1) + K * (page["k_d"] * s**2 + page["k_p"] * s + page["k_i"])
    close(closed, K * page["k_i"] * (lam * s + 1) ** 4)


def test_the_two_pole_formulas_with_an_integrator_equal_the_motor_formulas() -> None:
    K_m, T_m, lam, far = 2.86, 0.22, 0.1, 1e9
    Pro, Sum = far * T_m, far + T_m
    page = formulas(
        r"t_f = Π λ/D .*?k_d = .*?/\(K λ D\)", K=K_m * far, Pro=Pro, Sum=Sum, lam=lam, D=4.0 * Pro - lam * Sum
    )
    gains = motor_gains(K_m, T_m, lam)._asdict()
    assert {name: page[name] for name in gains} == pytest.approx(gains, rel=1e-6)


def test_times_to_90_percent_and_the_example_of_four_lags() -> None:
    for lags in (2, 4):

        def missing(x: float, n: int = lags) -> float:
            return math.exp(-x) * sum(x**k / math.factorial(k) for k in range(n)) - 0.1

        assert f"{brentq(missing, 0.1, 50.0):.2f} λ (n = {lags})" in PAGE
    jw = 1j * np.geomspace(1e-2, 1e3, 20_000)

    def excess(lam: float) -> float:
        k_p, k_i, _ = outer_gains(1.0, 4 * 0.0854, lam)
        return float(np.max(1.0 / np.abs(1.0 + (k_p + k_i / jw) / (0.0854 * jw + 1.0) ** 4))) - 1.7

    lam = brentq(excess, 0.3, 0.5)
    assert f"M_s = 1.7 is met at λ = {lam:.2f} s, that is {lam / (4 * 0.0854):.2f} times the sum of lags" in PAGE
