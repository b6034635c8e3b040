"""Figures of reports as SVG: the same input gives the same bytes."""

import io
import math
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import fields, is_dataclass
from functools import partial, wraps
from hashlib import sha256
from pathlib import Path
from typing import Any, ParamSpec

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter
from matplotlib.transforms import ScaledTranslation
from numpy.typing import NDArray

from backend.analysis import REST_TOLERANCES, SETTLING_BAND
from backend.identification import Model, Residuals, read_whiteness_test, simulate_response
from backend.models import ChannelModel, ChannelName, StepFigures
from backend.recording import Columns as ReaderColumns
from backend.units import AngleUnit, get_display_unit

# Drawing -------------------------------------------------------------------------------------------
# The style of all figures of the reports, and their export as SVG.


Array = NDArray[np.float64]

COLOURS = {
    "q": "#0072B2",
    "S": "#E69F00",
    "F_A": "#009E73",
    "F_B": "#CC79A7",
    "u_A": "#56B4E9",
    "u_B": "#D55E00",
}
"""Colour of each signal (Okabe-Ito), the same everywhere; its reference has the same colour, dashed."""

LIMIT_GREY = "#8c8c8c"
INK = "#222222"
WIDTH_IN = 6.7
"""Width of the text block of an A4 page [inch]."""

_STYLE = Path(__file__).with_name("report.mplstyle")
_BUCKETS = 900
_FEW_NAMED = 5
_SMALL, _NOTHING = 0.02, 1e-9
_PREFIXES = ("", "m", "µ", "n")


@contextmanager
def figure(
    rows: int, columns: int = 1, *, height_in: float, gap_in: tuple[float, float] = (0.24, 0.6), **layout: Any
) -> Iterator[tuple[Figure, Any]]:
    """Yield a figure of the text width and its axes, in the style of the reports.

    Margins and gaps below and between panels [inch] are fixed, because measuring all labels takes as long as drawing.
    """
    left, right, top, bottom = 0.58, 0.06, 0.22, 0.38
    height = (height_in - top - bottom - (rows - 1) * gap_in[0]) / rows
    width = (WIDTH_IN - left - right - (columns - 1) * gap_in[1]) / columns
    placing = {
        "left": left / WIDTH_IN,
        "right": 1.0 - right / WIDTH_IN,
        "top": 1.0 - top / height_in,
        "bottom": bottom / height_in,
        "hspace": gap_in[0] / height,
        "wspace": gap_in[1] / width,
    }
    with matplotlib.rc_context(fname=_STYLE):
        drawn = Figure(figsize=(WIDTH_IN, height_in))
        axes = drawn.subplots(rows, columns, gridspec_kw=placing, **layout)
        for panel in drawn.axes:
            label_transform = panel.transAxes + ScaledTranslation(-0.46, 0.0, drawn.dpi_scale_trans)
            panel.yaxis.set_label_coords(0.0, 0.5, transform=label_transform)
        yield drawn, axes


def to_svg(drawn: Figure, name: str) -> str:
    """Return the figure as an SVG element whose ids begin with ``name``.

    Several figures therefore fit on one page.
    """
    buffer = io.StringIO()
    with matplotlib.rc_context(fname=_STYLE):
        drawn.savefig(buffer, format="svg", metadata={"Date": None, "Creator": None})
    svg = buffer.getvalue()
    svg = svg[svg.index("<svg") :]
    svg = re.sub(r'\bid="', f'id="{name}-', svg)
    svg = re.sub(r'(href="#|url\(#)', rf"\g<1>{name}-", svg)
    return svg.strip()


def decimate(t: Array, y: Array) -> tuple[Array, Array]:
    """Reduce samples (N,) to what a page can show: minimum and maximum of each bucket."""
    if t.size <= 2 * _BUCKETS:
        return t, y
    edges = np.linspace(0, t.size, _BUCKETS + 1).astype(np.intp)
    widest = int(np.diff(edges).max())
    places = np.minimum(edges[:-1, None] + np.arange(widest), edges[1:, None] - 1)  # last one may repeat
    stretches, bare = y[places], np.isnan(y[places])
    lowest = np.where(bare, np.inf, stretches).argmin(axis=1)
    highest = np.where(bare, -np.inf, stretches).argmax(axis=1)
    both = np.sort(edges[:-1, None] + np.stack([lowest, highest], axis=1), axis=1)
    one = np.stack([both[:, 0] != both[:, 1], np.full(_BUCKETS, True)], axis=1)
    indices = np.concatenate([[0], both[one], [t.size - 1]])
    return t[indices], y[indices]


def panel_letter(axes: Axes, letter: str) -> None:
    """Put the letter of the panel above its upper left corner."""
    axes.set_title(letter, loc="left", fontweight="bold", pad=3)


def upper_legend(axes: Axes) -> None:
    """Put the legend, if any, in one line above the upper right corner."""
    named = len(axes.get_legend_handles_labels()[1])
    if named == 0:
        return
    apart, handle = (1.2, 1.8) if named <= _FEW_NAMED else (0.8, 0.9)
    axes.legend(
        loc="lower right",
        bbox_to_anchor=(1.0, 1.0),
        ncols=named,
        borderaxespad=0.1,
        columnspacing=apart,
        handlelength=handle,
    )


def limit_line(axes: Axes, value: float, label: str, *, above: bool = False) -> None:
    """Draw a bound in grey with its label at the left end, below it or ``above``."""
    axes.axhline(value, color=LIMIT_GREY, linewidth=0.7, linestyle=(0, (1, 1.5)))
    axes.annotate(
        label,
        (0.0, value),
        xycoords=("axes fraction", "data"),
        xytext=(3, 1.5 if above else -1.5),
        textcoords="offset points",
        ha="left",
        va="bottom" if above else "top",
        fontsize=6.5,
        color=LIMIT_GREY,
    )


def draw_error(axes: Axes, t: Array, error: Array, label: str, unit: str, *, colour: str, reach: float) -> None:
    """Draw an error over time on a scale from −``reach`` to ``reach``.

    A small error is drawn in m, µ or n of the unit, because tick labels in the whole unit would be too long for the
    axis.
    """
    power = 0
    while _NOTHING < reach * 10.0**power < _SMALL:
        power += 3
    axes.plot(*decimate(t, error * 10.0**power), color=colour, linewidth=0.8)
    axes.axhline(0.0, color=LIMIT_GREY, linewidth=0.6)
    largest = reach * 10.0**power if reach > _NOTHING else 1.0
    axes.set_ylim(-1.15 * largest, 1.15 * largest)
    axes.set_ylabel(f"{label} [{_PREFIXES[power // 3]}{unit}]")


def frequency_axis(axes: Axes) -> None:
    """Label a frequency axis [Hz] in plain numbers, at 1, 2 and 5 of each decade."""
    axes.xaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
    axes.xaxis.set_major_formatter(FuncFormatter(lambda f, _place: f"{f:g}"))
    axes.xaxis.set_minor_formatter(NullFormatter())


def in_unit(values: NDArray[np.float64], unit: str, angles: AngleUnit) -> NDArray[np.float64]:
    """Return values in SI units converted to the display unit."""
    return values * get_display_unit(unit, angles).factor


def axis_label(symbol: str, unit: str, angles: AngleUnit) -> str:
    """Return the label of an axis: the symbol and its display unit."""
    return f"{symbol} [{get_display_unit(unit, angles).unit}]"


# Cache ---------------------------------------------------------------------------------------------
# Cache of drawings: a page, its PDF and the verification of both draw the same figures of the same samples.
#
# Drawing takes nearly all of the time of a report.


_P = ParamSpec("_P")
_MOST = 64
"""Maximum number of cached drawings, each some hundred kilobytes."""

_drawings: dict[bytes, str] = {}


def cached_figure(draw: Callable[_P, str]) -> Callable[_P, str]:
    """Return ``draw`` with a cache; its result must depend on its arguments only."""
    called = f"{draw.__module__}.{draw.__qualname__}"

    @wraps(draw)
    def draw_cached(*args: _P.args, **named: _P.kwargs) -> str:
        digest = sha256()
        for part in _parts((called, args, named)):
            digest.update(part)
        of = digest.digest()
        drawing = _drawings.pop(of, None)
        if drawing is None:
            drawing = draw(*args, **named)
            if len(_drawings) >= _MOST:
                del _drawings[next(iter(_drawings))]
        _drawings[of] = drawing  # the most recently used one is last
        return drawing

    return draw_cached


def forget_drawings() -> None:
    """Clear the cache of drawings."""
    _drawings.clear()


def _parts(value: Any) -> Iterator[bytes | memoryview]:
    """Yield the bytes that identify a value."""
    if isinstance(value, np.ndarray):
        yield f"{value.dtype}{value.shape}".encode()
        yield np.ascontiguousarray(value).data.cast("B") if value.size else b""
    elif isinstance(value, str | int | float | complex | np.generic | slice | None):  # includes enumerations
        yield f"{type(value).__name__} {value!r}\0".encode()
    elif isinstance(value, Mapping):
        yield f"{len(value)} named\0".encode()
        for pair in value.items():
            yield from _parts(pair)
    elif isinstance(value, Sequence):
        yield f"{len(value)}\0".encode()
        for item in value:
            yield from _parts(item)
    elif is_dataclass(value):
        yield f"{type(value).__qualname__}\0".encode()
        for field in fields(value):
            yield from _parts(getattr(value, field.name))
    else:
        raise TypeError(f"a drawing is made of data: {type(value).__name__}")


# Identification figures ----------------------------------------------------------------------------
# Figures of an actuator identification: record and model, frequency and step responses, residual tests.


Complex = NDArray[np.complex128]

WRITTEN: dict[ChannelName, tuple[str, str, str]] = {"G_q": ("q", "$G_q$", "rad"), "G_S": ("S", "$G_S$", "N·m/rad")}
"""Output of each transfer function, its symbol, and the unit of the output."""

STEP_RAD = {AngleUnit.DEGREES: math.radians(10.0), AngleUnit.RADIANS: 1.0}
"""The step of the drawn response, a round number in the display unit; the models are linear in rad."""

_DASHES = (0, (4, 2))
_REST_S = 0.5
_SEGMENT_S = 8.0
_COHERENT = 0.9
_OMEGA_MAX = 60.0


def build_model(channel: ChannelModel) -> Model:
    """Return the transfer function that was stored."""
    return Model(channel.structure, channel.parameters)


@cached_figure
def record_panels(
    columns: ReaderColumns,
    start: int,
    models: Mapping[ChannelName, Model],
    period_s: float,
    name: str,
    angles: AngleUnit,
) -> str:
    """Draw excitation, both outputs with the simulation from rest, and tensions."""
    begin = max(0, start - round(2.0 / period_s))
    shown = {key: column[begin:] for key, column in columns.items()}
    t = shown["t"] - columns["t"][start]
    with figure(7, height_in=6.6, sharex=True, height_ratios=(3, 4, 3, 4, 3, 3, 3)) as (drawn, axes):
        axes[0].plot(*decimate(t, in_unit(shown["theta_A_ref"], "rad", angles)), color=INK, linewidth=0.8)
        axes[0].set_ylabel(axis_label(r"$\theta_{A,ref}$", "rad", angles))
        panels = ((axes[1], axes[2]), (axes[3], axes[4]))
        for (row, apart), (key, (output, label, unit)) in zip(panels, WRITTEN.items(), strict=True):
            simulated = simulated_from_rest(columns, start, output, models[key], period_s)
            read = partial(in_unit, unit=unit, angles=angles)
            since = slice(start - begin, None)
            row.plot(*decimate(t, read(shown[output])), color=COLOURS[output], label="measured")
            row.plot(*decimate(t[since], read(simulated)), color=INK, linewidth=0.7, linestyle=_DASHES, label=label)
            row.set_ylabel(axis_label(output, unit, angles))
            upper_legend(row)
            error, shown_in = read(shown[output][since] - simulated), get_display_unit(unit, angles).unit
            reach = float(np.abs(error).max(initial=0.0))
            draw_error(apart, t[since], error, f"$e_{output}$", shown_in, colour=COLOURS[output], reach=reach)
        for row, force in zip(axes[5:], ("F_A", "F_B"), strict=True):
            row.plot(*decimate(t, shown[force]), color=COLOURS[force], linewidth=0.8, label=f"${force}$")
            row.set_ylabel("Tension [N]")
            upper_legend(row)
        axes[6].set(xlabel="t from the start of the excitation [s]", xlim=(t[0], t[-1]))
        for row, letter in zip(axes, "ABCDEFG", strict=True):
            panel_letter(row, letter)
        return to_svg(drawn, name)


@cached_figure
def bode_panels(
    columns: ReaderColumns, start: int, channels: Mapping[ChannelName, ChannelModel], period_s: float, name: str
) -> str:
    """Draw magnitude and phase of models, first-order reductions and data."""
    omega = np.geomspace(0.1, _OMEGA_MAX, 300)
    with figure(2, 2, height_in=3.4, sharex=True) as (drawn, axes):
        for (top, bottom), (key, (output, label, unit)), letters in zip(
            axes.T, WRITTEN.items(), ("AC", "BD"), strict=True
        ):
            model, first_order = build_model(channels[key]), channels[key].first_order
            reduced: Complex = np.asarray(first_order.K / (1j * omega * first_order.T + 1.0), dtype=np.complex128)
            frequencies, response = _frequency_response(columns, start, output, period_s)
            dots = {"marker": "o", "markersize": 2.0, "linestyle": "none"}
            _bode(top, bottom, frequencies, response, color=COLOURS[output], label="data", **dots)
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


@cached_figure
def identification_step_panels(channels: Mapping[ChannelName, ChannelModel], name: str, angles: AngleUnit) -> str:
    """Draw step responses of the models and of their first-order reductions.

    The step of theta_A is ``STEP_RAD``.
    """
    from scipy.signal import step

    with figure(1, 2, height_in=2.1) as (drawn, axes):
        for panel, (key, (output, label, unit)), letter in zip(axes, WRITTEN.items(), "AB", strict=True):
            model, first_order = build_model(channels[key]), channels[key].first_order
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


@cached_figure
def residual_panels(residuals: Mapping[ChannelName, Residuals], name: str) -> str:
    """Draw auto- and cross-correlation of the residuals with the bounds of the tests."""
    tests = (
        ("residual autocorrelation", {key: found.whiteness for key, found in residuals.items()}),
        ("input–residual cross-correlation", {key: found.input_correlation for key, found in residuals.items()}),
    )
    with figure(2, 2, height_in=3.3, gap_in=(0.5, 0.6)) as (drawn, axes):
        letters = iter("ABCD")
        for row, (title, found_in) in zip(axes, tests, strict=True):
            for panel, (key, (output, label, _)) in zip(row, WRITTEN.items(), strict=True):
                found = found_in[key]
                lags, bound = np.array(found.lags_s), np.array(read_whiteness_test(found).bound)
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


def simulated_from_rest(columns: ReaderColumns, start: int, output: str, model: Model, period_s: float) -> Array:
    """Simulate the model from rest on the recorded reference; nothing is fitted."""
    rest = slice(max(0, start - round(_REST_S / period_s)), start) if start else slice(0, 1)
    u = columns["theta_A_ref"][start:] - columns["theta_A_ref"][rest].mean()
    return model.gain * simulate_response(model.poles.ravel(), period_s, u) + float(columns[output][rest].mean())


def _frequency_response(columns: ReaderColumns, start: int, output: str, period_s: float) -> tuple[Array, Complex]:
    """Estimate the frequency response (Welch) where the coherence is high enough."""
    from scipy.signal import csd, detrend

    u, y = detrend(columns["theta_A_ref"][start:]), detrend(columns[output][start:])
    length = min(u.size, round(_SEGMENT_S / period_s))

    def spectrum(a: Array, b: Array) -> tuple[Array, Complex]:
        f, density = csd(a, b, 1.0 / period_s, nperseg=length)
        return f, density

    (f, P_uu), (_, P_yy), (_, P_uy) = spectrum(u, u), spectrum(y, y), spectrum(u, y)
    coherence = np.abs(P_uy) ** 2 / np.maximum(np.abs(P_uu * P_yy), np.finfo(float).tiny)
    is_coherent = (f > 0.0) & (2.0 * np.pi * f < _OMEGA_MAX) & (coherence > _COHERENT)
    return 2.0 * np.pi * f[is_coherent], P_uy[is_coherent] / P_uu[is_coherent]


def _bode(top: Axes, bottom: Axes, omega: Array, response: Complex, **style: Any) -> None:
    top.plot(omega, np.abs(response), **style)
    bottom.plot(omega, np.degrees(np.unwrap(np.angle(response))), **style)


# Tracking figures ----------------------------------------------------------------------------------
# Figures of a tracking run: the six panels of figure 7 of the paper, tensions, and all steps on one scale.


Columns = Mapping[str, Array]

_UNITS = {"q": "rad", "S": "N·m/rad"}
_LABELS = {"F": "Tension [N]", "u": "Voltage [V]"}
_NAMES = {"q": "$q$", "S": "$S$", "F_A": "$F_A$", "F_B": "$F_B$", "u_A": "$u_A$", "u_B": "$u_B$"}


@cached_figure
def tracking_panels(
    columns: Columns,
    start_s: float,
    end_s: float,
    letters: str,
    name: str,
    u_max: float,
    angles: AngleUnit,
    paper_response: Columns | None = None,
) -> str:
    """Draw q, q − q_ref, S, S − S_ref, u_A and u_B between two times (figure 7).

    Figure 7 has q, S and u. ``paper_response`` has t, q and S under the paper's law, which are drawn behind.
    """
    part = _between(columns, start_s, end_s)
    theirs = _between(paper_response, start_s, end_s) if paper_response else None
    with figure(6, height_in=6.3, sharex=True, height_ratios=(5, 3, 5, 3, 3, 3)) as (drawn, axes):
        for (row, error), signal in zip((axes[:2], axes[2:4]), ("q", "S"), strict=True):
            if theirs is not None:
                line = decimate(theirs["t"], in_unit(theirs[signal], _UNITS[signal], angles))
                row.plot(*line, color=LIMIT_GREY, linewidth=0.9, label="paper's law, simulated")
            _plot_tracking(row, part, signal, angles)
            _error(error, part, signal, angles)
        for panel, signal in zip(axes[4:], ("u_A", "u_B"), strict=True):
            _voltage(panel, part, signal, u_max)
        for row, letter in zip(axes, letters, strict=True):
            panel_letter(row, letter)
        axes[-1].set_xlabel("t [s]")
        axes[-1].set_xlim(start_s, end_s)
        return to_svg(drawn, name)


@cached_figure
def tension_panel(columns: Columns, F_max: float, name: str) -> str:
    """Draw both tendon tensions over the whole run, with zero and the tension limit."""
    with figure(2, height_in=2.7, sharex=True, sharey=True) as (drawn, axes):
        for panel, signal, letter in zip(axes, ("F_A", "F_B"), "AB", strict=True):
            panel.plot(*decimate(columns["t"], columns[signal]), color=COLOURS[signal], label=_NAMES[signal])
            limit_line(panel, F_max, f"trip at {F_max:g} N")
            panel.axhline(0.0, color=LIMIT_GREY, linewidth=0.7)
            panel.set_ylabel(_LABELS["F"])
            upper_legend(panel)
            panel_letter(panel, letter)
        axes[1].set(xlabel="t [s]", xlim=(columns["t"][0], columns["t"][-1]))
        return to_svg(drawn, name)


@cached_figure
def tracking_step_panels(
    columns: Columns, steps: Sequence[StepFigures], lam: Mapping[str, float | None], name: str
) -> str:
    """Draw all steps of q and of S, scaled to 0 to 1, over the design response of λ.

    The panels below show the remaining error of each step, on the scale of the settling band.
    """
    with figure(2, 2, height_in=3.6, gap_in=(0.3, 0.2), sharex="col", sharey="row") as (drawn, axes):
        for column, signal in enumerate(("q", "S")):
            panel, left = axes[0][column], axes[1][column]
            longest = 0.0
            for step in (item for item in steps if item.signal == signal):
                part = _between(columns, step.start_s, step.end_s)
                if part["t"].size == 0:
                    continue
                t = part["t"] - step.start_s
                y = (part[signal] - step.before) / (step.after - step.before)
                panel.plot(*decimate(t, y), color=COLOURS[signal], linewidth=0.8, alpha=0.75)
                left.plot(*decimate(t, 100.0 * (y - 1.0)), color=COLOURS[signal], linewidth=0.8, alpha=0.75)
                longest = max(longest, float(t[-1]))
            _design(panel, left, lam[signal], longest)
            for bound in (-100.0 * SETTLING_BAND, 100.0 * SETTLING_BAND):
                left.axhline(bound, color=LIMIT_GREY, linewidth=0.7, linestyle=(0, (1, 1.5)))
            left.set(xlabel="time since the step [s]", xlim=(0.0, longest or 1.0), ylim=(-5.0, 5.0))
            panel.set_title(f"steps of {_NAMES[signal]}", fontsize=7.5)
            panel_letter(panel, "AB"[column])
            panel_letter(left, "CD"[column])
        axes[0][0].set_ylabel("fraction of the step")
        axes[1][0].set_ylabel("remaining error [%]")
        return to_svg(drawn, name)


def _plot_tracking(axes: Axes, part: Columns, signal: str, angles: AngleUnit) -> None:
    t, colour, unit = part["t"], COLOURS[signal], _UNITS[signal]
    axes.plot(*decimate(t, in_unit(part[signal], unit, angles)), color=colour, label=_NAMES[signal])
    axes.plot(
        *decimate(t, in_unit(part[f"{signal}_ref"], unit, angles)),
        color=colour,
        linewidth=0.8,
        linestyle=(0, (4, 2)),
        alpha=0.8,
        drawstyle="steps-post",
        label=f"{_NAMES[signal][:-1]}_{{ref}}$",
    )
    axes.set_ylabel(axis_label(signal, unit, angles))
    axes.margins(y=0.08)
    upper_legend(axes)


def _error(axes: Axes, part: Columns, signal: str, angles: AngleUnit) -> None:
    """Draw the error of a signal, on the scale of its error after the steps."""
    apart = part[signal] - part[f"{signal}_ref"]
    reading = get_display_unit(_UNITS[signal], angles)
    reach = reading.factor * largest_error(signal, apart, part[f"{signal}_ref"])
    scaled = apart * reading.factor
    draw_error(axes, part["t"], scaled, f"$e_{signal}$", reading.unit, colour=COLOURS[signal], reach=reach)


def largest_error(signal: str, error: Array, reference: Array) -> float:
    """Return the largest |error| (N,) outside the transients after reference steps.

    A transient lasts from a step of the reference, or from the first sample, until the error is for the first time
    below 2 % of the step or below the rest tolerance of the signal. Without a step all samples count. Returns 0 if none
    are left.
    """
    jumps = np.abs(np.diff(reference))
    finite = reference[np.isfinite(reference)]
    steps: list[int] = (np.flatnonzero(jumps > 0.02 * np.ptp(finite)) + 1).tolist() if finite.size else []
    sizes = [abs(reference[step] - reference[step - 1]) for step in steps]
    if error.size and abs(error[0]) > 0.0:  # it begins with a transient to its first reference
        steps, sizes = [0, *steps], [abs(error[0]), *sizes]
    known = np.isfinite(error)
    for start, end, size in zip(steps, [*steps, error.size][1:], sizes, strict=True):
        there = np.flatnonzero(np.abs(error[start:end]) <= max(0.02 * size, REST_TOLERANCES[signal]))
        known[start : start + there[0] if there.size else end] = False
    return float(np.abs(error[known]).max()) if known.any() else 0.0


def _voltage(axes: Axes, part: Columns, signal: str, u_max: float) -> None:
    axes.plot(*decimate(part["t"], part[signal]), color=COLOURS[signal], linewidth=0.8, label=_NAMES[signal])
    limit_line(axes, u_max, f"±{u_max:g} V")
    axes.axhline(-u_max, color=LIMIT_GREY, linewidth=0.7, linestyle=(0, (1, 1.5)))
    axes.set(ylabel=_LABELS["u"], ylim=(-1.25 * u_max, 1.25 * u_max))
    upper_legend(axes)


def _design(axes: Axes, left: Axes, lam: float | None, longest: float) -> None:
    """Draw 1/(λ s + 1)² and its remaining error, unless λ changed during the run."""
    if lam is None or longest == 0.0:
        return
    t = np.linspace(0.0, longest, 400)
    y = 1.0 - (1.0 + t / lam) * np.exp(-t / lam)
    dashed: dict[str, Any] = {"color": INK, "linewidth": 0.8, "linestyle": (0, (4, 2))}
    axes.plot(t, y, label=rf"$1/(\lambda s+1)^2$, $\lambda$ = {lam:g} s", **dashed)
    left.plot(t, 100.0 * (y - 1.0), **dashed)
    axes.legend(loc="lower right")


def _between(columns: Columns, start_s: float, end_s: float) -> dict[str, Array]:
    t = columns["t"]
    inside = slice(*np.searchsorted(t, [start_s - 1e-9, end_s - 1e-9]))
    return {name: column[inside] for name, column in columns.items()}
