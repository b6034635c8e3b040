"""Whether a dead time or a higher order would help a structure that leaves something out.

Both models are fitted by output error to the same samples, so that their fits and criteria compare. The other model
starts from the one that was found: behind each of a grid of dead times, or with another lag on a grid.
"""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from backend.identification.errors import IdentificationError
from backend.identification.fit import Fit, with_room
from backend.identification.linearisation import WHITE, Evaluation, Problem
from backend.identification.output_error import adapt, fit_output_error
from backend.identification.record import Record, Signal
from backend.identification.result import Hint, Model
from backend.identification.start import dead_times, ranked_starts
from backend.identification.structures import DEAD_TIME, MAX_LAGS, MAX_ORDER, Kind, Structure, structure

MIN_BIC_GAIN = 10.0
"""Difference of BIC that counts as very strong evidence."""
MOST_LEFT = 0.9
"""Share of the residuals that another model may leave over to be worth a hint, where they still follow the input."""
_STARTS_TRIED = 2
_LAGS = 8
_SHORTER = (1.0, 0.7, 0.4)


def find_hint(record: Record, model: Model) -> Hint | None:
    """Return the structure that explains the record much better, with figures; None where there is none."""
    shape, problem = structure(model.structure), Problem(record, structure(model.structure), WHITE)
    best: Hint | None = None
    for other, starts in _others(problem, shape, model.vector, with_dead_time=record.controller is None):
        try:
            hint = _compared(problem, model.vector, replace(problem, structure=other), starts)
        except (IdentificationError, np.linalg.LinAlgError):
            continue
        if hint is not None and (best is None or hint.BIC_gain > best.BIC_gain):
            best = hint
    return best


def _others(
    problem: Problem, shape: Structure, parameters: Signal, *, with_dead_time: bool
) -> Iterator[tuple[Structure, list[Signal]]]:
    """Yield the same structure with a dead time, and that of one order more, with starting values for each."""
    record = problem.record
    if with_dead_time and not shape.delayed:
        yield (
            structure(shape.name + DEAD_TIME),
            [
                np.concatenate((parameters[:1], _shortened(shape, parameters, share)[1:], [late * record.period_s]))
                for late in dead_times(record)
                for share in _SHORTER
            ],
        )
    higher = _one_order_more(shape)
    if higher is not None:
        poles, lags = shape.poles(parameters), np.geomspace(2.0 * record.period_s, record.duration_s / 10.0, _LAGS)
        tail = parameters[-1:] if shape.delayed else parameters[:0]
        starts = []
        for lag in lags:
            # The sum of lags stays about as it is: what the new one takes, the others give.
            share = max(0.3, 1.0 - lag / shape.sum_of_lags(parameters))
            descending = np.real(np.poly(np.append(poles / share, -1.0 / lag)))
            ascending = np.asarray(descending[::-1] / descending[-1])
            starts.append(np.concatenate((higher.from_denominator(float(parameters[0]), ascending), tail)))
        yield higher, starts


def _shortened(shape: Structure, parameters: Signal, share: float) -> Signal:
    """Lags of a share of what they are: the dead time takes the rest."""
    powers = share ** np.arange(shape.order + 1)
    return shape.from_denominator(float(parameters[0]), shape.denominator(parameters) * powers)


def _one_order_more(shape: Structure) -> Structure | None:
    """Return the structure with a lag more, None where there is none."""
    suffix = DEAD_TIME if shape.delayed else ""
    if shape.kind is Kind.LAGS:
        return structure(f"lags{shape.order + 1}{suffix}") if shape.order < MAX_LAGS else None
    return structure(f"order:{shape.order + 1}{suffix}") if shape.order < MAX_ORDER else None


def _compared(problem: Problem, parameters: Signal, other: Problem, starts: list[Signal]) -> Hint | None:
    """Fit the other structure and this one to the same samples; None where the other is not clearly better."""
    ranked = [start for _, start in ranked_starts(other, starts)][:_STARTS_TRIED]
    if not ranked:
        return None
    other = with_room(other, ranked)
    first = max(other.first, _room(problem, parameters))
    other, problem = replace(other, first=first), replace(problem, first=first)
    before = adapt(problem, parameters)
    after = min((fit_output_error(other, start) for start in ranked), key=lambda found: found.cost)
    count = problem.record.u.size - first
    more = other.structure.order + len(other.structure.names) - problem.structure.order - len(problem.structure.names)
    gain = 2.0 * count * float(np.log(before.cost / after.cost)) - more * float(np.log(count))
    spare = count - len(other.structure.names) - other.structure.order - 2
    ratio = ((before.cost / after.cost) ** 2 - 1.0) * spare / more
    tests = [Fit(found, None).input_correlation().passed for found in (before, after)]
    helps = after.cost < MOST_LEFT * before.cost or tests == [False, True]
    if not (gain > MIN_BIC_GAIN and helps):
        return None
    return Hint(
        structure=other.structure.name,
        dead_time=other.structure.delayed and not problem.structure.delayed,
        fit_percent_before=_fit_percent(before),
        fit_percent=_fit_percent(after),
        BIC_gain=gain,
        F=float(ratio),
        more_parameters=more,
        white=Fit(after, None).whiteness().passed,
        independent_of_input=tests[1],
    )


def _room(problem: Problem, parameters: Signal) -> int:
    """Return how many samples a dead time that the structure has already leaves out."""
    return with_room(problem, [parameters]).first


def _fit_percent(found: Evaluation) -> float:
    y = found.problem.record.y[found.problem.first :]
    return 100.0 * (1.0 - found.cost / float(np.linalg.norm(y - np.mean(y))))
