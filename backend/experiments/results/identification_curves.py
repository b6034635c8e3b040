"""What can be drawn of a stored identification: responses of its models, residual tests, errors. Pure."""

from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.signal import step

from backend.identification.residuals import LEVEL, judged
from backend.identification.result import Model
from backend.storage.identifications import Identification
from plant.parameter_sections import SIDES

Document = dict[str, Any]

CHANNELS = ("G_q", "G_S")
OMEGA = np.geomspace(0.1, 60.0, 160)
"""Where the models' frequency responses are drawn [rad/s]."""

_STEP_POINTS = 200


def curves_of(found: Identification) -> Document:
    """Return the curves of one identification by kind: ``channels``, ``motors``, ``springs``."""
    curves: Document = {"channels": [], "motors": [], "springs": []}
    match found.kind:
        case "actuator":
            curves["channels"] = [_channel(name, found.model[name], found.quality[name]) for name in CHANNELS]
        case "motor":
            curves["motors"] = [{"side": side, "steps": found.quality[side]["steps"]} for side in SIDES]
        case "spring":
            curves["springs"] = [_spring(name, quality) for name, quality in found.quality.items()]
        case _:
            raise ValueError(f"identification {found.id} is of unknown kind {found.kind!r}: it has no curves")
    return curves


def _channel(name: str, model: Document, quality: Document) -> Document:
    found = Model(model["structure"], dict(model["parameters"]))
    K, T = model["first_order"]["K"], model["first_order"]["T"]
    t = np.linspace(0.0, 6.0 * T, _STEP_POINTS)
    _, y = step(([found.gain], found.denominator[::-1]), T=t)
    residuals = quality["residuals"]
    return {
        "name": name,
        "model": _bode(found.response(OMEGA)),
        "first_order": _bode(K / (1j * OMEGA * T + 1.0)),
        "measured": _measured(quality.get("frequency")),
        "step_t": t.tolist(),
        "step_model": y.tolist(),
        "step_first_order": (K * (1.0 - np.exp(-t / T))).tolist(),
        "whiteness": _correlation(residuals["whiteness"]),
        "input_correlation": _correlation(residuals["input_correlation"]),
        "candidates": [_candidate(item) for item in quality.get("candidates", ())],
    }


def _bode(response: NDArray[np.complex128]) -> Document:
    phase = np.degrees(np.unwrap(np.angle(response)))
    return {"omega": OMEGA.tolist(), "magnitude": np.abs(response).tolist(), "phase_deg": phase.tolist()}


def _measured(frequency: Document | None) -> Document | None:
    """Return the lines drawn of the estimate without a model; none of a run made before it was kept."""
    if frequency is None:
        return None
    shown = [line for line, omega in enumerate(frequency["omega"]) if OMEGA[0] <= omega <= OMEGA[-1]]
    return {
        name: [frequency[name][line] for line in shown] for name in ("omega", "magnitude", "phase_deg", "coherence")
    }


def _correlation(test: Document) -> Document:
    found = judged(test)
    outcome = {"bound": list(found.bound), "statistic": found.statistic, "critical": found.critical}
    return {
        "lags_s": test["lags_s"],
        "correlation": test["correlation"],
        **outcome,
        "level": LEVEL,
        "passed": found.passed,
    }


def _candidate(item: Document) -> Document:
    named = ("K", "T", "fit_percent", "BIC")
    words = {name: item.get(name) or "" for name in ("structure", "grade", "problem")}
    return {**words, **{name: item.get(name) for name in named}}


def _spring(name: str, quality: Document) -> Document:
    curve = quality["curve"]
    orders = [
        {"order": int(order), "errors": errors, "force": curve[order]} for order, errors in quality["errors"].items()
    ]
    pairs = {key: quality[key] for key in ("x", "F", "rising")}
    return {"name": name, **pairs, "curve_x": curve["x"], "orders": orders}
