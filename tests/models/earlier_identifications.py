"""Identifications of the last version without document versions, and older parts."""

import json
from typing import Any

from backend.storage.database import Database
from tests.models.earlier import AT, put, put_run

REDUCED = {"K": 0.05, "T": 0.35, "K_std": 1e-4, "T_std": None}
TEST = {"lags_s": [0.001, 0.002], "correlation": [0.01, 0.3], "bound": [0.1, 0.1], "passed": False}
BAND = {"lags_s": [0.001, 0.002], "correlation": [0.01, 0.3], "band": [0.1, 0.1], "passed": False}
MODEL: dict[str, Any] = {
    "structure": "lags4",
    "parameters": {"K": 0.05, "tau": 0.0875},
    "std_errors": {"K": 1e-4, "tau": 1e-3},
    "covariance": [[1e-8, 0.0], [0.0, None]],
    "noise": [],
    "method": "output error",
    "first_order": REDUCED,
}
QUALITY: dict[str, Any] = {
    "fit_percent": 97.5,
    "fit_all_percent": 97.0,
    "gain_geometry": 0.05,
    "gain_error_percent": 0.0,
    "y_resolution": None,
    "residuals": {"whiteness": TEST, "input_correlation": TEST, "std": 1.0, "AIC": 1.0, "BIC": 2.0, "FPE": None},
    "frequency": {
        "omega": [1.0],
        "magnitude": [0.05],
        "phase_deg": [-20.0],
        "coherence": [0.9],
        "worst_gain_percent": None,
        "worst_phase_deg": None,
        "trusted_lines": 0,
    },
    "usable": True,
    "grade": "usable",
    "verdict": "Usable for tuning: it fits.",
    "candidates": [
        {
            "structure": "lags4",
            "parameters": {"K": 0.05, "tau": 0.0875},
            "K": 0.05,
            "T": 0.35,
            "fit_percent": None,
            "BIC": 2.0,
            "grade": "usable",
            "problem": "",
        },
        {"structure": "third", "problem": "not converged"},
    ],
    "arx": {"problem": "no model"},
}
ACTUATOR: dict[str, Any] = {
    "data": {"input": "theta_A_ref", "outputs": ["q", "S"], "first_sample": 0, "samples": 2, "period_s": 0.001},
    "options": {"tension_N": 20.0, "estimator": "default"},
    "model": {"S_nominal": 10.5, "q_nominal": 0.47, "G_q": MODEL, "G_S": MODEL},
    "quality": {"motion_counts": 56.0, "G_q": QUALITY, "G_S": QUALITY},
}
FITTED = {"K_m": 2.88, "T_m": 0.22, "u_c": 0.07}
PAIR = {"K_m": 2.8, "T_m": 0.22}
MOTOR = {
    "parameters": FITTED,
    "std_errors": FITTED,
    "coulomb": True,
    "rule": [{"voltage": 2.0, **PAIR}],
    "rule_mean": PAIR,
    "rule_spread": PAIR,
    "before": PAIR,
}
MOTOR_QUALITY = {
    "rms_counts": 1.5,
    "grade": "usable",
    "verdict": "Usable.",
    "refused": [{"voltage": 9.0, "reason": "it saturates"}],
    "steps": [{"voltage": 2.0, "t": [0.0, 0.1], "measured": [0.0, 0.1], "model": [0.0, 0.1]}],
}
MOTORS: dict[str, Any] = {
    "data": {},
    "options": {},
    "model": {"A": MOTOR, "B": MOTOR},
    "quality": {"A": MOTOR_QUALITY, "B": MOTOR_QUALITY},
}
SPRING = {
    "recommended": 2,
    "reason": "order 2: simplest",
    "fits": [
        {
            "order": 2,
            "k": [-2.5, 331.0, 8543.0],
            "std_errors": [0.01, 0.8, 1.0],
            "rms_N": 0.05,
            "max_N": 0.1,
            "cross_validation_N": 0.05,
            "rising": True,
        }
    ],
}
SPRING_QUALITY = {
    "pairs": 2,
    "hysteresis_N": None,
    "x": [0.01, 0.02],
    "F": [2.0, 6.0],
    "rising": [True, False],
    "errors": {"2": [0.0, 0.1]},
    "curve": {"x": [0.01, 0.02], "2": [2.0, 6.0]},
}
SPRINGS: dict[str, Any] = {
    "data": {},
    "options": {},
    "model": {"A": {**SPRING, "before": [-2.4, 330.0]}, "B": {**SPRING, "before": []}},
    "quality": {"A": SPRING_QUALITY, "B": SPRING_QUALITY},
}
TABLE: dict[str, Any] = {
    "data": {"file": "spring.csv", "sha256": "ab", "points": 2},
    "options": {},
    "model": {"table": SPRING},
    "quality": {"table": SPRING_QUALITY},
}


def put_identification(database: Database, run: int | None, kind: str, documents: dict[str, Any]) -> None:
    """Insert a completed run and its identification; a spring table has no run."""
    if run is not None:
        put_run(database, run, f"{kind}_identification", {"plan": {"tension_N": 20.0}})
    put(
        database,
        "identification",
        run_id=run,
        kind=kind,
        method="output error",
        usable=True,
        verdict="Usable.",
        who="Ana",
        software="0.9.0",
        created_at=AT,
        **{name: json.dumps(document) for name, document in documents.items()},
    )
