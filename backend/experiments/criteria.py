"""Pass or fail of the tracking experiment: criterion, bound, figure."""

from dataclasses import dataclass

from backend.experiments.metrics import Overall, TrackingMetrics


@dataclass(frozen=True)
class Bounds:
    """What a parameter set promises: overshoot [%], stiffness deviation under q steps [N·m/rad], tension [N]."""

    overshoot_percent: float
    deviation_S: float
    min_tension_N: float


BOUNDS_IDEAL = Bounds(overshoot_percent=1.0, deviation_S=0.1, min_tension_N=5.0)
BOUNDS_LAB = Bounds(overshoot_percent=2.0, deviation_S=0.2, min_tension_N=4.0)


@dataclass(frozen=True)
class Criterion:
    """One criterion. ``relation`` is "<" or ">"; ``passed`` is None when the run gives no figure to judge by."""

    name: str
    title: str
    relation: str
    bound: float
    figure: float | None
    unit: str
    passed: bool | None


def bounds_for(parameters: str) -> Bounds:
    """Return the bounds of a parameter set by name; anything but ``ideal`` is judged as a real bench, like ``lab``."""
    return BOUNDS_IDEAL if parameters == "ideal" else BOUNDS_LAB


def tracking_criteria(metrics: TrackingMetrics, bounds: Bounds) -> tuple[Criterion, ...]:
    """Judge a tracking run. An incomplete run can fail a criterion but not pass one."""
    overall: Overall = metrics.overall
    rows = (
        ("overshoot_q", "Overshoot of q", "<", bounds.overshoot_percent, overall.overshoot_q_percent, "%"),
        ("overshoot_S", "Overshoot of S", "<", bounds.overshoot_percent, overall.overshoot_S_percent, "%"),
        ("deviation_S", "Stiffness deviation during q steps", "<", bounds.deviation_S, overall.deviation_S, "N·m/rad"),
        ("min_tension", "Smallest tendon tension", ">", bounds.min_tension_N, overall.min_tension_N, "N"),
    )
    return tuple(judge(*row, complete=metrics.complete) for row in rows)


def judge(
    name: str, title: str, relation: str, bound: float, figure: float | None, unit: str, complete: bool
) -> Criterion:
    """Judge one figure; what an incomplete run has not failed yet is not judged."""
    held = figure is not None and (figure < bound if relation == "<" else figure > bound)
    unknown = figure is None or (held and not complete)
    return Criterion(name, title, relation, bound, figure, unit, None if unknown else held)
