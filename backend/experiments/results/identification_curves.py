"""What can be drawn of a stored identification: responses of its models, residual tests, errors. Pure."""

from dataclasses import asdict

import numpy as np
from numpy.typing import NDArray

from backend.identification.models import CorrelationTest, Model
from backend.identification.validation import RESIDUAL_LEVEL, judged
from backend.models.document import Document
from backend.models.identification import (
    CHANNELS,
    Candidate,
    Channel,
    ChannelName,
    FailedCandidate,
    FrequencyEstimate,
    MotorFound,
    ResidualTest,
    SpringQuality,
)
from backend.storage.identifications import Identification
from plant.parameters import SIDES, Side

OMEGA = np.geomspace(0.1, 60.0, 160)
"""Where the models' frequency responses are drawn [rad/s]."""

_STEP_POINTS = 200


def curves_of(found: Identification) -> Document:
    """Return the curves of one identification by kind: ``channels``, ``motors``, ``springs``."""
    curves: Document = {"channels": [], "motors": [], "springs": []}
    match found.kind:
        case "actuator":
            curves["channels"] = [_channel(name, found.actuator.channel(name)) for name in CHANNELS]
        case "motor":
            curves["motors"] = [_motor(side, found.motors.side(side)) for side in SIDES]
        case "spring":
            curves["springs"] = [_spring(name, spring.quality) for name, spring in found.springs.items()]
        case _:
            raise ValueError(f"identification {found.id} is of unknown kind {found.kind!r}: it has no curves")
    return curves


def _motor(side: Side, found: MotorFound) -> Document:
    return {"side": side, "steps": [asdict(step) for step in found.quality.steps]}


def _channel(name: ChannelName, channel: Channel) -> Document:
    from scipy.signal import step

    model, quality = channel.model, channel.quality
    found = Model(model.structure, model.parameters)
    K, T = model.first_order.K, model.first_order.T
    t = np.linspace(0.0, 6.0 * T, _STEP_POINTS)
    _, y = step(([found.gain], found.denominator[::-1]), T=t)
    return {
        "name": name,
        "model": _bode(found.response(OMEGA)),
        "first_order": _bode(np.asarray(K / (1j * OMEGA * T + 1.0), dtype=np.complex128)),
        "measured": _measured(quality.frequency),
        "step_t": t.tolist(),
        "step_model": y.tolist(),
        "step_first_order": (K * (1.0 - np.exp(-t / T))).tolist(),
        "whiteness": _correlation(quality.residuals.whiteness),
        "input_correlation": _correlation(quality.residuals.input_correlation),
        "candidates": [_candidate(item) for item in quality.candidates],
    }


def _bode(response: NDArray[np.complex128]) -> Document:
    phase = np.degrees(np.unwrap(np.angle(response)))
    return {"omega": OMEGA.tolist(), "magnitude": np.abs(response).tolist(), "phase_deg": phase.tolist()}


def _measured(frequency: FrequencyEstimate | None) -> Document | None:
    """Return the lines drawn of the estimate without a model; none of a run made before it was kept."""
    if frequency is None:
        return None
    shown = [line for line, omega in enumerate(frequency.omega) if OMEGA[0] <= omega <= OMEGA[-1]]
    columns = {name: getattr(frequency, name) for name in ("omega", "magnitude", "phase_deg", "coherence")}
    return {name: [column[line] for line in shown] for name, column in columns.items()}


def _correlation(test: ResidualTest | CorrelationTest) -> Document:
    found = judged(test)
    outcome = {"bound": list(found.bound), "statistic": found.statistic, "critical": found.critical}
    return {
        "lags_s": list(test.lags_s),
        "correlation": list(test.correlation),
        **outcome,
        "level": RESIDUAL_LEVEL,
        "passed": found.passed,
    }


def _candidate(item: Candidate | FailedCandidate) -> Document:
    figures = {name: getattr(item, name, None) for name in ("K", "T", "fit_percent", "BIC")}
    grade = item.grade if isinstance(item, Candidate) else ""
    return {"structure": item.structure, "grade": grade, "problem": item.problem, **figures}


def _spring(name: str, quality: SpringQuality) -> Document:
    orders = [
        {"order": int(order), "errors": list(errors), "force": list(quality.curve[order])}
        for order, errors in quality.errors.items()
    ]
    pairs = {"x": list(quality.x), "F": list(quality.F), "rising": list(quality.rising)}
    return {"name": name, **pairs, "curve_x": list(quality.curve_x), "orders": orders}
