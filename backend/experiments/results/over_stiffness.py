"""Identified gains and lags over S beside what geometry, springs and motor loops predict. Nothing is stored."""

from collections.abc import Sequence

import numpy as np

from backend.control.decoupler import bounds_for
from backend.experiments.results.load_friction import document_of, load_friction_of_newest
from backend.models.document import Document, UnreadableDocumentError
from backend.models.identification import Channel, ChannelName
from backend.storage import identifications, runs
from backend.storage.database import Database
from backend.storage.identifications import Identification
from backend.storage.runs import Run
from backend.tuning.gains import PointModel, TuningError, motor_loops
from backend.tuning.robustness import one_motor_point
from plant.parameters import ParameterError, PlantParameters, parameters_of

_CURVE_POINTS = 13


def trend_of(database: Database, parameters: PlantParameters, lam_motor: float) -> Document:
    """Return the newest estimate of each actuator identification by stiffness, and the curves of what is in force."""
    with database.reading() as session:
        newest: dict[int, Identification] = {}
        for found in identifications.find(session, kind="actuator"):
            if found.run_id is not None:
                newest.setdefault(found.run_id, found)
        made = [(found, runs.get(session, number)) for number, found in newest.items()]
    friction = load_friction_of_newest(database, [run for _, run in made])
    rows, left_out = [], []
    for found, run in made:
        try:
            rows.append(_row(found, run))
        except (UnreadableDocumentError, ParameterError, TuningError, ValueError) as error:
            left_out.append(f"run {run.id}: {error}")
    bounds = bounds_for(parameters)
    S = np.linspace(bounds.S_min, bounds.S_max, _CURVE_POINTS)
    return {
        "rows": sorted(rows, key=lambda row: float(row["S"])),
        "predicted": _curves(S.tolist(), [predicted(parameters, lam_motor, at) for at in S.tolist()]),
        "left_out": left_out,
        "friction": document_of(friction),
    }


def predicted(parameters: PlantParameters, lam_motor: float, S: float) -> PointModel:
    """Return gains and sums of lags from one motor reference that are to be expected at stiffness S [N·m/rad]."""
    return one_motor_point(parameters, motor_loops(parameters, lam_motor), S)


def _row(found: Identification, run: Run) -> Document:
    lam_motor = run.set_to.loop.lam_motor
    if lam_motor is None:
        raise ValueError("λ of the motor loops was not kept with it, so that no lag can be predicted")
    S = found.actuator.model.S_nominal
    point = predicted(parameters_of(run.parameters_name, run.parameters), lam_motor, S)
    return {
        "run": run.id,
        "S": S,
        "G_q": _channel(found, "G_q", point.K_q, point.T_q),
        "G_S": _channel(found, "G_S", point.K_S, point.T_S),
    }


def _channel(found: Identification, name: ChannelName, K: float, T: float) -> Document:
    channel: Channel = found.actuator.channel(name)
    model = channel.model.first_order
    gain, lag = _against(model.K, model.K_std, K), _against(model.T, model.T_std, T)
    return {"K": gain, "T": lag, "grade": channel.quality.grade}


def _against(identified: float, std: float | None, predicted: float) -> Document:
    off = 100.0 * (identified / predicted - 1.0)
    return {"identified": identified, "std": std, "predicted": predicted, "off_percent": off}


def _curves(S: Sequence[float], points: Sequence[PointModel]) -> Document:
    return {"S": list(S), **{name: [getattr(at, name) for at in points] for name in ("K_q", "T_q", "K_S", "T_S")}}
