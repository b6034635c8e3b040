"""Coefficients of identified models as tables, plain text and runnable code."""

from collections.abc import Iterator, Mapping

import numpy as np
from numpy.typing import NDArray

from backend.identification import DenominatorKind, Structure, find_structure
from backend.models import CHANNELS, ActuatorModel, ChannelModel, ChannelName, IdentifiedMotor, SpringModel
from backend.reports import messages
from backend.reports.model import Block, Code, Column, Table, format_measured
from plant import SIDES, Side

_GAIN_UNITS = {"G_q": "rad/rad", "G_S": "N·m/rad²"}
_OUTPUTS = {"G_q": "q [rad]", "G_S": "S [N*m/rad]"}
_PADE_ORDER = 4
_MEANINGS = {
    "b0": messages.static_gain(),
    "K": messages.static_gain(),
    "T": messages.first_order_time_constant(),
    "tau": messages.time_constant_of_each_factor(),
    "t_d": messages.dead_time(),
}
_RAISED = str.maketrans("23456", "²³⁴⁵⁶")
_LOWERED = {raised: f"^{chr(digit)}" for digit, raised in _RAISED.items()}
_OF_THIRD = {"a1": messages.second_order_coefficient(), "a2": messages.second_order_coefficient()}

Coefficient = tuple[str, float, float | None, int]
"""Name, value, standard error, and the power i of s that it belongs to. Its unit is s^i, except for the gain."""


def actuator_blocks(model: ActuatorModel) -> tuple[Block, ...]:
    """Return the coefficients of G_q and G_S as table, text and python-control code."""
    channels: dict[ChannelName, ChannelModel] = {"G_q": model.G_q, "G_S": model.G_S}
    return (
        _coefficient_table(channels),
        Code(messages.actuator_models_as_text(), "\n".join(_text_lines(channels))),
        Code(messages.actuator_models_as_code(), "\n".join(_control_lines(channels))),
    )


def motor_blocks(motors: Mapping[Side, IdentifiedMotor]) -> tuple[Block, ...]:
    """Return the least-squares models of both motors as text and python-control code."""
    text, code = [], ["import control", ""]
    for side in SIDES:
        model = motors[side]
        fitted, std = model.parameters, model.std_errors
        text.append(f"motor {side}: theta/u = K_m/(s (T_m s + 1)), Coulomb friction of u_c")
        known = (("K_m", fitted.K_m, std.K_m, "rad/(V*s)"), ("T_m", fitted.T_m, std.T_m, "s"))
        for name, value, error, unit in (*known, ("u_c", fitted.u_c, std.u_c, "V")):
            if value is not None:
                text.append(_line(name, value, error, unit))
        if fitted.K_m is not None and fitted.T_m is not None:
            code.append(f"# from u_{side} [V] to theta_{side} [rad]")
            code.append(f"motor_{side} = control.tf([{fitted.K_m!r}], [{fitted.T_m!r}, 1.0, 0.0])")
    return (
        Code(messages.motor_models_as_text(), "\n".join(text)),
        Code(messages.motor_models_as_code(), "\n".join(code)),
    )


def spring_blocks(springs: Mapping[Side, SpringModel]) -> tuple[Block, ...]:
    """Return the recommended polynomials as text and NumPy code."""
    text, code = [], ["import numpy as np", ""]
    for side in SIDES:
        model = springs[side]
        fit = next(fit for fit in model.fits if fit.order == model.recommended)
        text.append(f"spring {side}: F [N] over x [m], order {fit.order}: F(x) = k_0 + k_1 x + k_2 x^2 + ...")
        for power, (k, std) in enumerate(zip(fit.k, fit.std_errors, strict=True)):
            text.append(_line(f"k_{power}", k, std, "N" if power == 0 else f"N/m^{power}"))
        code.append(f"spring_{side} = np.polynomial.Polynomial({list(fit.k)!r})  # F [N] of x [m]")
    return (
        Code(messages.spring_models_as_text(), "\n".join(text)),
        Code(messages.spring_models_as_code(), "\n".join(code)),
    )


def _coefficient_table(channels: Mapping[ChannelName, ChannelModel]) -> Table:
    columns = (
        Column("Model", number=False),
        Column("Coefficient", number=False),
        Column("Value"),
        Column("±"),
        Column("Unit", number=False),
        Column("Meaning", number=False, wide=True),
    )
    rows = []
    for key in CHANNELS:
        model = channels[key]
        shape = find_structure(model.structure)
        for name, value, std, power in _own(shape, model):
            figures = format_measured(value, 6), format_measured(std, 2), _unit(key, power)
            rows.append((key, name, *figures, _meaning(shape, name)))
        for name, value, std, power in _of_denominator(shape, model):
            figures = format_measured(value, 6), format_measured(std, 2), _unit(key, power)
            rows.append((key, name, *figures, messages.expanded_denominator_coefficient(power=_power(power))))
    caption = messages.coefficients_of_models()
    return Table(caption, columns, tuple(rows))


def _meaning(shape: Structure, name: str) -> str:
    if shape.kind is DenominatorKind.THIRD and name in _OF_THIRD:
        return _OF_THIRD[name]
    return _MEANINGS.get(name) or messages.denominator_coefficient(power=_power(int(name[1:])))


def _power(power: int) -> str:
    return "s" if power == 1 else f"s{str(power).translate(_RAISED)}"


def _unit(key: ChannelName, power: int) -> str:
    return _GAIN_UNITS[key] if power == 0 else _power(power)


def _own(shape: Structure, model: ChannelModel) -> Iterator[Coefficient]:
    """Yield the parameters that were estimated."""
    for name in shape.names:
        power = 0 if name in ("K", "b0") else int(name[1:]) if name[0] == "a" else 1
        yield name, model.parameters[name], model.std_errors.get(name), power


def _of_denominator(shape: Structure, model: ChannelModel) -> Iterator[Coefficient]:
    """Yield the denominator coefficients if the parameters are not these already.

    Yields nothing for K/(T s + 1) and for structures with free coefficients. Standard errors follow from the covariance
    of the parameters, to first order.
    """
    if shape.kind in (DenominatorKind.FIRST, DenominatorKind.FREE):
        return
    at = np.array([model.parameters[name] for name in shape.names])
    std = _propagate_errors(shape, at, model)
    for power, value in enumerate(shape.denominator(at)[1:], start=1):
        yield f"a_{power}", float(value), None if std is None else float(std[power]), power


def _propagate_errors(shape: Structure, at: NDArray[np.float64], model: ChannelModel) -> NDArray[np.float64] | None:
    """Return the standard errors of the denominator [order + 1].

    Returns None if no covariance was stored.
    """
    covariance = np.array([[np.nan if one is None else one for one in row] for row in model.covariance])
    if covariance.shape != (at.size, at.size) or not np.isfinite(covariance).all():
        return None
    columns = []
    for place, value in enumerate(at):
        step = np.zeros_like(at)
        step[place] = 1e-6 * (abs(value) or 1.0)
        columns.append((shape.denominator(at + step) - shape.denominator(at - step)) / (2.0 * step[place]))
    slopes = np.stack(columns, axis=1)
    return np.sqrt(np.maximum(np.diag(slopes @ covariance @ slopes.T), 0.0))


def _text_lines(channels: Mapping[ChannelName, ChannelModel]) -> Iterator[str]:
    for key in CHANNELS:
        model = channels[key]
        shape, reduced = find_structure(model.structure), model.first_order
        yield f"{key}: theta_A_ref [rad] to {_OUTPUTS[key]}, structure {model.structure}"
        for name, value, std, power in (*_own(shape, model), *_of_denominator(shape, model)):
            yield _line(name, value, std, _ascii(_unit(key, power)))
        yield "  first order with the same gain and sum of lags:"
        yield _line("K", reduced.K, reduced.K_std, _ascii(_GAIN_UNITS[key]))
        yield _line("T", reduced.T, reduced.T_std, "s")
        if model.noise:
            noise = [number for number in model.noise if number is not None]
            yield f"  whitening of the residuals, 1 + c_1 z^-1 + ...: {', '.join(f'{c:.6g}' for c in noise)}"


def _line(name: str, value: float, std: float | None, unit: str) -> str:
    error = messages.not_known() if std is None else f"{std:.3g}"
    return f"  {name:<4} = {value!r} +/- {error} {unit}"


def _ascii(unit: str) -> str:
    return unit.replace("·", "*").translate(_LOWERED)


def _control_lines(channels: Mapping[ChannelName, ChannelModel]) -> Iterator[str]:
    yield "import control"
    for key in CHANNELS:
        model = channels[key]
        shape = find_structure(model.structure)
        at = np.array([model.parameters[name] for name in shape.names])
        denominator = [float(one) for one in shape.denominator(at)[::-1]]
        yield ""
        yield f"# {key}: theta_A_ref [rad] to {_OUTPUTS[key]}, structure {model.structure}"
        yield f"{key} = control.tf("
        yield f"    [{float(at[0])!r}],"
        yield f"    [{', '.join(map(repr, denominator))}],"
        yield ")"
        if shape.delayed:
            yield f"t_d_{key[2:]} = {shape.dead_time(at)!r}  # dead time [s], approximated below (Pade)"
            yield f"{key} = {key} * control.tf(*control.pade(t_d_{key[2:]}, {_PADE_ORDER}))"
        yield f"{key}_first_order = control.tf([{model.first_order.K!r}], [{model.first_order.T!r}, 1.0])"
