"""Figures of an actuator identification: record and model, frequency and step responses, residual tests."""

import math
from collections.abc import Mapping
from functools import partial
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.ticker import NullFormatter
from numpy.typing import NDArray

from backend.identification.models import Model, simulate
from backend.identification.validation import judged
from backend.models.identification import ChannelModel, ChannelName, ResidualTests
from backend.recording.reader import Columns
from backend.reports.drawing import (
    COLOURS,
    INK,
    LIMIT_GREY,
    axis_label,
    draw_error,
    figure,
    in_unit,
    panel_letter,
    thinned,
    to_svg,
    upper_legend,
)
from backend.reports.drawn_once import drawn_once
from backend.units import Angles, reading_of

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]

WRITTEN: dict[ChannelName, tuple[str, str, str]] = {"G_q": ("q", "$G_q$", "rad"), "G_S": ("S", "$G_S$", "N·m/rad")}
"""Per transfer function: its output, how it is written, the output's unit."""

STEP_RAD = {Angles.DEGREES: math.radians(10.0), Angles.RADIANS: 1.0}
"""The step whose response is drawn, round as it is read; the models are linear [rad]."""

_DASHES = (0, (4, 2))
_REST_S = 0.5
_SEGMENT_S = 8.0
_COHERENT = 0.9
_OMEGA_MAX = 60.0


def model_of(channel: ChannelModel) -> Model:
    """Return the transfer function that was stored."""
    return Model(channel.structure, channel.parameters)


@drawn_once
def record_panels(
    columns: Columns, start: int, models: Mapping[ChannelName, Model], period_s: float, name: str, angles: Angles
) -> str:
    """Draw the excitation, both outputs with the models' simulation from rest, and the tensions."""
    begin = max(0, start - round(2.0 / period_s))
    shown = {key: column[begin:] for key, column in columns.items()}
    t = shown["t"] - columns["t"][start]
    with figure(7, height_in=6.6, sharex=True, height_ratios=(3, 4, 3, 4, 3, 3, 3)) as (drawn, axes):
        axes[0].plot(*thinned(t, in_unit(shown["theta_A_ref"], "rad", angles)), color=INK, linewidth=0.8)
        axes[0].set_ylabel(axis_label(r"$\theta_{A,ref}$", "rad", angles))
        panels = ((axes[1], axes[2]), (axes[3], axes[4]))
        for (row, apart), (key, (output, label, unit)) in zip(panels, WRITTEN.items(), strict=True):
            simulated = simulated_from_rest(columns, start, output, models[key], period_s)
            read = partial(in_unit, unit=unit, angles=angles)
            since = slice(start - begin, None)
            row.plot(*thinned(t, read(shown[output])), color=COLOURS[output], label="measured")
            row.plot(*thinned(t[since], read(simulated)), color=INK, linewidth=0.7, linestyle=_DASHES, label=label)
            row.set_ylabel(axis_label(output, unit, angles))
            upper_legend(row)
            error, shown_in = read(shown[output][since] - simulated), reading_of(unit, angles).unit
            reach = float(np.abs(error).max(initial=0.0))
            draw_error(apart, t[since], error, f"$e_{output}$", shown_in, colour=COLOURS[output], reach=reach)
        for row, force in zip(axes[5:], ("F_A", "F_B"), strict=True):
            row.plot(*thinned(t, shown[force]), color=COLOURS[force], linewidth=0.8, label=f"${force}$")
            row.set_ylabel("Tension [N]")
            upper_legend(row)
        axes[6].set(xlabel="t from the start of the excitation [s]", xlim=(t[0], t[-1]))
        for row, letter in zip(axes, "ABCDEFG", strict=True):
            panel_letter(row, letter)
        return to_svg(drawn, name)


@drawn_once
def bode_panels(
    columns: Columns, start: int, channels: Mapping[ChannelName, ChannelModel], period_s: float, name: str
) -> str:
    """Draw magnitude and phase of both models, of their first-order reductions, and of the data themselves."""
    omega = np.geomspace(0.1, _OMEGA_MAX, 300)
    with figure(2, 2, height_in=3.4, sharex=True) as (drawn, axes):
        for (top, bottom), (key, (output, label, unit)), letters in zip(
            axes.T, WRITTEN.items(), ("AC", "BD"), strict=True
        ):
            model, first_order = model_of(channels[key]), channels[key].first_order
            reduced: Complex = np.asarray(first_order.K / (1j * omega * first_order.T + 1.0), dtype=np.complex128)
            seen, response = _frequency_response(columns, start, output, period_s)
            dots = {"marker": "o", "markersize": 2.0, "linestyle": "none"}
            _bode(top, bottom, seen, response, color=COLOURS[output], label="data", **dots)
            _bode(top, bottom, omega, model.response(omega), color=INK, label=label)
            _bode(top, bottom, omega, reduced, color=LIMIT_GREY, linestyle=_DASHES, label="first order")
            top.set(yscale="log", xscale="log", ylabel=f"|{label}| [{unit} per rad]")
            for axis in (top.xaxis, top.yaxis):
                axis.set_minor_formatter(NullFormatter())
            bottom.set(xlabel="ω [rad/s]", ylabel="phase [°]", ylim=(-370, 20), yticks=(-360, -270, -180, -90, 0))
            top.legend(loc="lower left")
            panel_letter(top, letters[0])
            panel_letter(bottom, letters[1])
        return to_svg(drawn, name)


@drawn_once
def step_panels(channels: Mapping[ChannelName, ChannelModel], name: str, angles: Angles) -> str:
    """Draw the response of both models and of their first-order reductions to a step of theta_A by STEP_RAD."""
    from scipy.signal import step

    with figure(1, 2, height_in=2.1) as (drawn, axes):
        for panel, (key, (output, label, unit)), letter in zip(axes, WRITTEN.items(), "AB", strict=True):
            model, first_order = model_of(channels[key]), channels[key].first_order
            t = np.linspace(0.0, 6.0 * first_order.T, 400)
            _, y = step(([model.gain], model.denominator[::-1]), T=t)
            reduced = first_order.K * (1.0 - np.exp(-t / first_order.T))
            read = partial(in_unit, unit=unit, angles=angles)
            y, reduced = STEP_RAD[angles] * y, STEP_RAD[angles] * reduced
            panel.plot(t, read(y), color=COLOURS[output], label=label)
            panel.plot(t, read(reduced), color=LIMIT_GREY, linestyle=_DASHES, label="first order")
            panel.set(xlabel="t [s]", ylabel=axis_label(output, unit, angles), xlim=(0.0, t[-1]))
            panel.legend(loc="lower right")
            panel_letter(panel, letter)
        return to_svg(drawn, name)


@drawn_once
def residual_panels(residuals: Mapping[ChannelName, ResidualTests], name: str) -> str:
    """Draw the correlation of each residual with itself and with the input, in the bounds of their tests."""
    tests = (
        ("residual with itself", {key: found.whiteness for key, found in residuals.items()}),
        ("residual with input", {key: found.input_correlation for key, found in residuals.items()}),
    )
    with figure(2, 2, height_in=3.3, gap_in=(0.5, 0.6)) as (drawn, axes):
        letters = iter("ABCD")
        for row, (title, found_in) in zip(axes, tests, strict=True):
            for panel, (key, (output, label, _)) in zip(row, WRITTEN.items(), strict=True):
                found = found_in[key]
                lags, bound = np.array(found.lags_s), np.array(judged(found).bound)
                panel.fill_between(lags, -bound, bound, color="#e3e3e3", linewidth=0.0)
                panel.plot(
                    lags,
                    np.array(found.correlation, dtype=float),
                    color=COLOURS[output],
                    linewidth=0.8,
                    marker="o",
                    markersize=1.5,
                )
                panel.axhline(0.0, color=LIMIT_GREY, linewidth=0.5)
                panel.set(xlabel="lag [s]", ylabel="correlation")
                panel.set_title(f"{label}: {title}", fontsize=7.5)
                panel_letter(panel, next(letters))
        return to_svg(drawn, name)


def simulated_from_rest(columns: Columns, start: int, output: str, model: Model, period_s: float) -> Array:
    """Simulate the model from rest on the recorded reference; nothing is fitted to make it agree."""
    rest = slice(max(0, start - round(_REST_S / period_s)), start) if start else slice(0, 1)
    u = columns["theta_A_ref"][start:] - columns["theta_A_ref"][rest].mean()
    return model.gain * simulate(model.poles.ravel(), period_s, u) + float(columns[output][rest].mean())


def _frequency_response(columns: Columns, start: int, output: str, period_s: float) -> tuple[Array, Complex]:
    """Estimate the response without a model (Welch), where input and output are coherent enough to tell."""
    from scipy.signal import csd, detrend

    u, y = detrend(columns["theta_A_ref"][start:]), detrend(columns[output][start:])
    length = min(u.size, round(_SEGMENT_S / period_s))

    def spectrum(a: Array, b: Array) -> tuple[Array, Complex]:
        f, density = csd(a, b, 1.0 / period_s, nperseg=length)
        return f, density

    (f, P_uu), (_, P_yy), (_, P_uy) = spectrum(u, u), spectrum(y, y), spectrum(u, y)
    coherence = np.abs(P_uy) ** 2 / np.maximum(np.abs(P_uu * P_yy), np.finfo(float).tiny)
    told = (f > 0.0) & (2.0 * np.pi * f < _OMEGA_MAX) & (coherence > _COHERENT)
    return 2.0 * np.pi * f[told], P_uy[told] / P_uu[told]


def _bode(top: Axes, bottom: Axes, omega: Array, response: Complex, **style: Any) -> None:
    top.plot(omega, np.abs(response), **style)
    bottom.plot(omega, np.degrees(np.unwrap(np.angle(response))), **style)
