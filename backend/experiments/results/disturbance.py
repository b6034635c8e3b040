"""Metrics of pushes in closed loop: how far joint and stiffness give way, and how soon the joint is back. Pure."""

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from backend.experiments.results.metrics import NoSamplesError, figure
from backend.experiments.results.rest import AT_REST
from backend.experiments.results.whole import Columns, Whole, whole
from backend.experiments.results.windows import pushes, undisturbed_from
from backend.realtime.program import Program
from plant.interface import T_s


@dataclass(frozen=True, kw_only=True)
class DisturbanceFigures(Whole):
    """Figures over all pushes. ``reasons`` tells by name which could not be measured and why."""

    push_deviation_q: float = figure("rad", "Joint deviation under pushes", "max |q − q_ref| while the joint is pushed")
    push_deviation_S: float = figure(
        "N·m/rad", "Stiffness deviation under pushes", "max |S − S_ref| while the joint is pushed"
    )
    push_back_s: float | None = figure(
        "s",
        "Back after a push",
        f"longest time from the end of a push until |q − q_ref| stays below {AT_REST['q']} rad",
    )
    reasons: Mapping[str, str] = field(default_factory=dict)


def disturbance_figures(columns: Columns, program: Program) -> DisturbanceFigures:
    """Measure one run. ``columns`` holds q, S, their references, tensions and voltages, one sample a millisecond.

    Raises NoSamplesError when the run ended before the last push was over.
    """
    pushed = pushes(program)
    if not pushed or columns["q"].size < pushed[-1].stop:
        raise NoSamplesError("the run ended before the pushes were over" if pushed else "nothing pushes the joint")
    off_q, off_S = (np.abs(columns[name] - columns[f"{name}_ref"]) for name in ("q", "S"))
    times: list[float] = []
    reasons: dict[str, str] = {}
    for push in pushed:
        after = off_q[push.stop : min(undisturbed_from(program, push.stop), off_q.size)]
        if after.size == 0:
            reasons["push_back_s"] = f"nothing was held after the push that ended at {push.stop * T_s:g} s"
            continue
        away = np.flatnonzero(~(after <= AT_REST["q"]))
        if away.size and away[-1] == after.size - 1:
            reasons["push_back_s"] = (
                f"after the push that ended at {push.stop * T_s:g} s the joint was still {after[-1]:.3g} rad off when "
                f"something moved again after {after.size * T_s:g} s"
            )
            continue
        times.append(0.0 if away.size == 0 else float(away[-1] + 1) * T_s)
    under = np.concatenate([np.arange(push.start, push.stop) for push in pushed])
    return DisturbanceFigures(
        **whole(columns),
        push_deviation_q=float(off_q[under].max()),
        push_deviation_S=float(off_S[under].max()),
        push_back_s=None if reasons or not times else max(times),
        reasons=reasons,
    )
