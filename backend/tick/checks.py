"""Fault detection in the tick: each check says what it has found, as a number. The first one found counts."""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from backend.controllers import plausibility
from backend.controllers.limits import bounds_for
from backend.controllers.plausibility import Limits, Tendons, limits_for
from plant.compiled import compiled
from plant.interface import Measurement, MotorCommand, T_s
from plant.parameters import PlantParameters

SLACK_MAX_S = 0.1
"""How long a tendon may be slack while the loops are closed [s]."""

NOTHING, NO_NUMBER, TRIPPED, OUT_OF_BOUNDS, INCREDIBLE, SLACK, MISSED = range(7)
"""What may be found."""


class Watched(NamedTuple):
    """What the checks know of a plant.

    ``F_slack``, ``F_max`` [N], ``q_trip`` [rad]; ``missed_max``: so many deadlines in a row are too many.
    """

    limits: Limits
    tendons: Tendons
    F_slack: float
    F_max: float
    q_trip: float
    missed_max: int


class State(NamedTuple):
    """What the checks remember: how long a tendon has been slack [s], and of the readings.

    ``memory`` is of ``plausibility.look``; ``past``: the reading before the newest, where one has been ``seen``.
    """

    slack_s: float
    seen: bool
    past: Measurement
    newest: Measurement
    memory: NDArray[np.float64]


class Found(NamedTuple):
    """What was found, and where readings cannot be true the words of ``plausibility.Verdict``."""

    what: int
    doubt: int
    which: int
    still: int
    excess: float


CLEAR = Found(NOTHING, plausibility.CREDIBLE, 0, -1, 0.0)


@compiled
def check(
    watched: Watched,
    state: State,
    raw: Measurement,
    m: Measurement,
    command: MotorCommand,
    zeroed: bool,
    taut_wanted: bool,
    missed: int,
) -> tuple[Found, State]:
    """Look at a measurement, and return the first fault found.

    ``raw`` is as read; in ``m`` the motor encoders have their zeros, which are known where ``zeroed``. ``command`` is
    what was written last. ``taut_wanted``: the mode keeps tendons under tension; ``missed``: deadlines missed since
    the last tick.
    """
    if not math.isfinite(m.q + m.theta_A + m.theta_B + m.F_A + m.F_B):
        return Found(NO_NUMBER, 0, 0, -1, 0.0), state
    if m.safety_trip != 0.0:
        return Found(TRIPPED, 0, 0, -1, 0.0), state
    doubt, which, still, excess = plausibility.CREDIBLE, 0, -1, 0.0
    if state.seen:
        doubt, which, still, excess = plausibility.look(
            watched.limits, watched.tendons, state.memory, raw, m, command, zeroed, 1 + missed
        )
    else:
        plausibility.remember(state.memory, raw)
    slack = taut_wanted and min(m.F_A, m.F_B) < watched.F_slack
    slack_s = state.slack_s + T_s if slack else 0.0
    after = State(slack_s, True, state.newest, raw, state.memory)
    out_of_bounds = max(m.F_A, m.F_B) > watched.F_max or abs(m.q) > watched.q_trip
    what = NOTHING
    if out_of_bounds and doubt != plausibility.JUMPED:
        what = OUT_OF_BOUNDS
    elif doubt != plausibility.CREDIBLE:
        what = INCREDIBLE
    elif slack_s > SLACK_MAX_S:
        what = SLACK
    elif missed >= watched.missed_max:
        what = MISSED
    return Found(what, doubt, which, still, excess), after


def watched_for(parameters: PlantParameters, missed_max: int) -> Watched:
    """Return what the checks know of a parameter set."""
    bounds = bounds_for(parameters)
    tendons = plausibility.tendons_for(parameters)
    return Watched(limits_for(parameters), tendons, bounds.F_slack, bounds.F_max, bounds.q_trip, missed_max)
