"""Each push of the joint on its own: how far joint and stiffness give way, for how long, and what was to be expected.

Pushes may be steps, ramps or impulses. Expected is what the closed loop answers with the gains in use, and beside it
what the stiffness alone would give: r_j F/S, as far as the joint gives way where its loop is open. Pure.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from backend.experiments.results.in_force import InForce, NotPredictedError
from backend.experiments.results.metrics import NoSamplesError, figure
from backend.experiments.results.rest import AT_REST
from backend.experiments.results.whole import Columns, Whole, whole
from backend.experiments.results.windows import timed, undisturbed_from
from backend.realtime.program import Program, Shape
from backend.tuning.simulation import INPUTS, OUTPUTS, answered, sampled_loop
from plant.interface import T_s

Array = NDArray[np.float64]

IMPULSE_S = 0.05
"""A push that is over within this time [s] is called an impulse: the joint's own swing takes as long."""

REST_S = 0.1
"""Deviations count from the mean over so long [s] before the push."""


class Window(NamedTuple):
    """A push: its samples, how it is called, and the sample up to which nothing else acts."""

    pushed: slice
    shape: str
    until: int


@dataclass(frozen=True)
class Push:
    """One push, measured. Deviations are of q [rad] and S [N·m/rad] from before it.

    ``F`` [N]: its largest force, ``impulse`` [N·s], ``S`` [N·m/rad] at which it came. ``back_s``: from its end until
    the joint stays within AT_REST of its reference, None where it did not, and ``reason`` says so. ``static``: r_j F/S.
    ``expected`` (n,) is the deviation that was predicted over the window, None where ``unpredicted`` says why not.
    """

    window: Window
    F: float
    impulse: float
    S: float
    peak_q: float
    peak_S: float
    back_s: float | None
    reason: str
    static: float
    expected: Array | None
    unpredicted: str

    @property
    def expected_peak(self) -> float | None:
        """Largest deviation that was predicted [rad]."""
        return None if self.expected is None else float(np.abs(self.expected).max())

    @property
    def off_percent(self) -> float | None:
        """Measured over predicted peak, less one [%]."""
        peak = self.expected_peak
        return None if not peak else 100.0 * (self.peak_q / peak - 1.0)


@dataclass(frozen=True, kw_only=True)
class PushFigures(Whole):
    """Figures over all pushes. ``reasons`` tells by name which could not be measured and why."""

    pushed_peak_q: float = figure("rad", "Largest deviation of q", "max |q − q before the push|, of all pushes")
    pushed_peak_S: float = figure("N·m/rad", "Largest deviation of S", "max |S − S before the push|, of all pushes")
    pushed_back_s: float | None = figure(
        "s", "Back after a push", f"longest time from a push's end until |q − q_ref| stays below {AT_REST['q']} rad"
    )
    pushed_off_percent: float | None = figure(
        "%", "Peaks off their prediction", "largest |measured/predicted − 1| of the peaks of q, gains in use"
    )
    pushed_static_ratio: float | None = figure(
        "1", "Largest share of the static deviation", "largest peak of q over r_j F/S, impulses left out"
    )
    reasons: Mapping[str, str] = field(default_factory=dict)


def push_figures(columns: Columns, program: Program, in_force: InForce) -> PushFigures:
    """Measure one run; ``columns`` holds q, S, their references, F_push, tensions, voltages, a sample a millisecond.

    Raises NoSamplesError when the run ended before the first push was over.
    """
    found = pushes_seen(columns, program, in_force)
    if not found:
        raise NoSamplesError(
            "the run ended before the pushes were over" if push_windows(program) else "nothing pushes the joint"
        )
    back = [one.back_s for one in found]
    off = [one.off_percent for one in found]
    ratios = [one.peak_q / one.static for one in found if one.window.shape != "impulse"]
    reasons = {
        "pushed_back_s": next((one.reason for one in found if one.reason), ""),
        "pushed_off_percent": next((one.unpredicted for one in found if one.unpredicted), ""),
        "pushed_static_ratio": "" if ratios else "there were impulses alone",
    }
    return PushFigures(
        **whole(columns),
        pushed_peak_q=max(one.peak_q for one in found),
        pushed_peak_S=max(one.peak_S for one in found),
        pushed_back_s=_largest(back),
        pushed_off_percent=_largest([None if one is None else abs(one) for one in off]),
        pushed_static_ratio=max(ratios, default=None),
        reasons={name: reason for name, reason in reasons.items() if reason},
    )


def push_windows(program: Program) -> tuple[Window, ...]:
    """Return the pushes of a program, each from where the force begins to where it is none again."""
    found: list[Window] = []
    begun, shapes, before = -1, set[Shape](), 0.0
    stretches = [*timed(program)]
    for start, end, segment in stretches:
        acts = segment.F_push != 0.0 or (segment.shape is Shape.RAMP and before != 0.0)
        if begun >= 0 and not acts:
            found.append(_window(program, slice(begun, start), shapes))
            begun, shapes = -1, set[Shape]()
        if acts:
            begun = start if begun < 0 else begun
            shapes.add(segment.shape)
        before = segment.F_push
        if begun >= 0 and end == stretches[-1][1]:
            found.append(_window(program, slice(begun, end), shapes))
    return tuple(found)


def _window(program: Program, pushed: slice, shapes: set[Shape]) -> Window:
    short = (pushed.stop - pushed.start) * T_s <= IMPULSE_S + 1e-9
    shape = "impulse" if short else "ramp" if Shape.RAMP in shapes else "step"
    return Window(pushed, shape, max(undisturbed_from(program, pushed.stop), pushed.stop))


def pushes_seen(columns: Columns, program: Program, in_force: InForce) -> tuple[Push, ...]:
    """Measure each push that was over before the run was."""
    size = columns["q"].size
    answers: dict[tuple[object, ...], Array] = {}
    windows = [one for one in push_windows(program) if one.pushed.stop <= size]
    return tuple(_seen(columns, one, in_force, answers) for one in windows)


def _seen(columns: Columns, window: Window, in_force: InForce, answers: dict[tuple[object, ...], Array]) -> Push:
    start, stop = window.pushed.start, window.pushed.stop
    seen = slice(start, min(window.until, columns["q"].size))
    before = slice(max(start - round(REST_S / T_s), 0), max(start, 1))
    # A sample shows the push of the tick before it: what acts from a sample on stands in the next one.
    force = np.append(columns["F_push"][start + 1 : seen.stop], 0.0)
    S = float(columns["S_ref"][start])
    q, S_seen = (columns[name][seen] - columns[name][before].mean() for name in ("q", "S"))
    off = np.abs(columns["q"] - columns["q_ref"])[stop : seen.stop]
    back_s, reason = _back(off, stop)
    F = float(force[np.argmax(np.abs(force))])
    r_j = in_force.parameters.geometry.r_j
    try:
        expected, why = _expected(in_force, start, S, r_j * force, answers), ""
    except NotPredictedError as error:
        expected, why = None, str(error)
    static = r_j * abs(F) / S
    return Push(
        window, F, float(force[: stop - start].sum() * T_s), S, float(np.abs(q).max()), float(np.abs(S_seen).max()),
        back_s, reason, static, expected, why,
    )  # fmt: skip


def _back(off: Array, stop: int) -> tuple[float | None, str]:
    """Return how long it took until the joint stayed where it belongs, or why that is not known."""
    if off.size == 0:
        return None, f"nothing was held after the push that ended at {stop * T_s:g} s"
    away = np.flatnonzero(~(off <= AT_REST["q"]))
    if away.size and away[-1] == off.size - 1:
        return None, (
            f"after the push that ended at {stop * T_s:g} s the joint was still {off[-1]:.3g} rad off when "
            f"something moved again after {off.size * T_s:g} s"
        )
    return (0.0 if away.size == 0 else float(away[-1] + 1) * T_s), ""


def _expected(in_force: InForce, start: int, S: float, tau: Array, answers: dict[tuple[object, ...], Array]) -> Array:
    """Return the deviation of q [rad] that a torque (n,) [N·m] from the sample ``start`` on should give."""
    from scipy.signal import fftconvolve

    choice = in_force.choice_at(start)
    acts = [tau]
    if choice.k_ext > 0.0 and in_force.position_loop:
        acts += answered(in_force.gains_at(start).rejection, tau, S)
    known = answers.get((choice, S))
    if known is None or known.shape[1] < tau.size:
        known = answers[(choice, S)] = _impulse_responses(in_force, start, S, tau.size, len(acts))
    return np.asarray(sum(fftconvolve(act, answer)[: tau.size] for act, answer in zip(acts, known, strict=True)))


def _impulse_responses(in_force: InForce, start: int, S: float, size: int, count: int) -> Array:
    """Return what q becomes (count, size) of an impulse of the torque, and of what a rejection adds."""
    closed = sampled_loop(in_force.parameters, in_force.gains_at(start), S, position_loop=in_force.position_loop).closed
    found = np.empty((count, size))
    for place, act in enumerate((INPUTS.tau_ext, INPUTS.q_e, INPUTS.q_off)[:count]):
        w = np.zeros((size, len(INPUTS)))
        w[0, act] = 1.0
        found[place] = closed.played(w)[:, OUTPUTS.q]
    return found


def _largest(values: list[float | None]) -> float | None:
    """Return the largest, None where one of them is not known."""
    known = [value for value in values if value is not None]
    return max(known) if len(known) == len(values) else None
