"""Coefficients of identified models in a report, and the code that rebuilds them, against closed forms."""

from typing import Any

import numpy as np
import pytest
from numpy.polynomial import Polynomial

from backend.identification.models import FirstOrder
from backend.models.identification import (
    ActuatorModel,
    ChannelModel,
    IdentifiedMotor,
    MotorConstants,
    MotorFit,
    SpringModel,
    StoredSpringFit,
)
from backend.reports.model import Code, Table
from backend.reports.model_code import actuator_blocks, motor_blocks, spring_blocks
from plant.parameters import Side

OMEGA = np.array([0.0, 0.5, 3.0, 12.0, 40.0])
ORDER_4 = {"b0": 0.0501, "a1": 0.3431, "a2": 0.0462, "a3": 2.9e-3, "a4": 7.3e-5}
LAGS_4 = {"K": 0.723, "tau": 0.0861}
THIRD = {"K": 0.723, "T": 0.22, "a2": 1.1e-3, "a1": 0.031, "t_d": 0.012}


def model(G_q: ChannelModel, G_S: ChannelModel) -> ActuatorModel:
    return ActuatorModel(S_nominal=10.5, G_q=G_q, G_S=G_S)


def channel(structure: str, parameters: dict[str, float], std: float = 0.01) -> ChannelModel:
    size = len(parameters)
    errors = {name: std * value for name, value in parameters.items()}
    covariance = np.diag(np.square(list(errors.values())))
    assert covariance.shape == (size, size)
    return ChannelModel(
        structure=structure,
        parameters=parameters,
        std_errors=dict(errors),
        covariance=tuple(map(tuple, covariance.tolist())),
        first_order=FirstOrder(0.05, 0.34, 1e-4, 2e-3),
    )


def run_code(blocks: tuple[Any, ...]) -> dict[str, Any]:
    code = [block.text for block in blocks if isinstance(block, Code)][-1]
    assert code.isascii()
    found: dict[str, Any] = {}
    exec(code, found)
    return found


def test_the_code_builds_the_stored_transfer_functions() -> None:
    found = run_code(actuator_blocks(model(channel("order:4", ORDER_4), channel("lags4", LAGS_4))))
    s = 1j * OMEGA
    order_4 = ORDER_4["b0"] / (1 + sum(ORDER_4[f"a{power}"] * s**power for power in (1, 2, 3, 4)))
    np.testing.assert_allclose(found["G_q"](s), order_4, rtol=1e-12)
    np.testing.assert_allclose(found["G_S"](s), LAGS_4["K"] / (LAGS_4["tau"] * s + 1) ** 4, rtol=1e-12)
    np.testing.assert_allclose(found["G_q_first_order"](s), 0.05 / (0.34 * s + 1), rtol=1e-12)
    assert found["G_q"].den_list[0][0].tolist() == [ORDER_4[name] for name in ("a4", "a3", "a2", "a1")] + [1.0]


def test_a_dead_time_is_in_the_code() -> None:
    found = run_code(actuator_blocks(model(channel("third+delay", THIRD), channel("first", {"K": 0.7, "T": 0.3}))))
    s = 1j * OMEGA
    lag = (THIRD["T"] * s + 1) * (THIRD["a2"] * s**2 + THIRD["a1"] * s + 1)
    np.testing.assert_allclose(found["G_q"](s), THIRD["K"] / lag * np.exp(-THIRD["t_d"] * s), rtol=1e-9)
    assert found["t_d_q"] == THIRD["t_d"]
    np.testing.assert_allclose(found["G_S"](s), 0.7 / (0.3 * s + 1), rtol=1e-12)


def test_coefficients_that_are_computed_from_parameters_have_standard_errors() -> None:
    """a_i of K/(τ s + 1)⁴ is binomial(4, i) τ^i, so its relative error is i times that of τ."""
    blocks = actuator_blocks(model(channel("order:4", ORDER_4), channel("lags4", LAGS_4)))
    table = blocks[0]
    assert isinstance(table, Table)
    rows = {(row[0], row[1]): row for row in table.rows}
    assert {name for key, name in rows if key == "G_q"} == set(ORDER_4)
    assert {name for key, name in rows if key == "G_S"} == {"K", "tau", "a_1", "a_2", "a_3", "a_4"}
    assert rows["G_q", "a2"][2:5] == ("0.0462000", "0.00046", "s²")
    assert rows["G_S", "a_1"][2:5] == ("0.344400", "0.0034", "s")
    assert float(rows["G_S", "a_2"][2]) == pytest.approx(6 * LAGS_4["tau"] ** 2, rel=1e-5)
    assert float(rows["G_S", "a_2"][3]) == pytest.approx(0.02 * 6 * LAGS_4["tau"] ** 2, rel=0.02)


def test_a_model_of_an_earlier_version_has_no_standard_errors() -> None:
    old = ChannelModel(structure="lags4", parameters=LAGS_4, first_order=FirstOrder(0.7, 0.34))
    blocks = actuator_blocks(model(old, old))
    assert isinstance(blocks[0], Table)
    assert {row[3] for row in blocks[0].rows} == {"–"}
    assert isinstance(blocks[1], Code)
    assert "not known" in blocks[1].text


def test_the_code_rebuilds_identified_motors() -> None:
    numbers: dict[Side, tuple[float, float]] = {"A": (2.861, 0.2213), "B": (2.93, 0.2187)}
    motors = {
        side: IdentifiedMotor(
            MotorFit(K_m, T_m, 0.12),
            MotorFit(0.01, 0.002, 0.003),
            True,
            (),
            MotorConstants(K_m, T_m),
            MotorConstants(0, 0),
            MotorConstants(2.86, 0.22),
        )
        for side, (K_m, T_m) in numbers.items()
    }
    found = run_code(motor_blocks(motors))
    s = 1j * OMEGA[1:]
    for side, (K_m, T_m) in numbers.items():
        np.testing.assert_allclose(found[f"motor_{side}"](s), K_m / (s * (T_m * s + 1)), rtol=1e-12)


def test_the_code_rebuilds_identified_springs() -> None:
    fits = tuple(
        StoredSpringFit(len(k) - 1, k, tuple(0.1 for _ in k), 0.1, 0.2, 0.1, True)
        for k in ((-2.498, 331.49, 8543.8), (0.1, 200.0, 9000.0, 12.5))
    )
    springs: dict[Side, SpringModel] = {"A": SpringModel(2, "", fits), "B": SpringModel(3, "", fits)}
    found = run_code(spring_blocks(springs))
    x = np.linspace(0.0, 0.05, 7)
    assert isinstance(found["spring_A"], Polynomial)
    np.testing.assert_allclose(found["spring_A"](x), -2.498 + 331.49 * x + 8543.8 * x**2, rtol=1e-12)
    np.testing.assert_allclose(found["spring_B"](x), 0.1 + 200 * x + 9000 * x**2 + 12.5 * x**3, rtol=1e-12)
