"""Between the cascade's tuning and the command that carries it to the loop process."""

from collections.abc import Sequence
from dataclasses import astuple

import numpy as np

from backend.control import cascade, pid
from backend.errors import require_within
from backend.loop.set_tuning import EntryGains, MotorGains, SetTuning
from backend.tuning.gains import Knowledge, cascade_tuning, require_share, tuning_with
from backend.tuning.models import Lambdas, MotorModel, PointModel
from plant.parameters import PlantParameters


def tuning_for(
    parameters: PlantParameters,
    lambdas: Lambdas,
    points: Sequence[PointModel] = (),
    motor: MotorModel | None = None,
    interpolate: bool = False,
    u_plan: float = 0.0,
    k_ext: float = 0.0,
) -> SetTuning:
    """Command with the gains of ``backend.tuning.gains.cascade_tuning``. Raises TuningError."""
    tuning = cascade_tuning(parameters, lambdas, points, motor, interpolate)
    return SetTuning(
        lam_q=lambdas.lam_q,
        lam_S=lambdas.lam_S,
        motor_A=MotorGains(*tuning.motors.A),
        motor_B=MotorGains(*tuning.motors.B),
        entries=tuple(EntryGains(*map(float, row)) for row in tuning.schedule.entries),
        interpolate=interpolate,
        u_plan=u_plan,
        k_ext=k_ext,
    )


def tuning_of(command: SetTuning, known: Knowledge) -> cascade.CascadeTuning:
    """Tuning that a command carries. Raises ValueError for a bank without entries or gains that are no numbers."""
    if not command.entries:
        raise ValueError("a bank needs at least one entry: no gain was changed")
    rows = [astuple(entry) for entry in sorted(command.entries, key=lambda entry: entry.S_nominal)]
    table = np.array(rows, dtype=np.float64)
    inner = pid.MotorPairGains(
        *(pid.IPDGains(*map(float, astuple(motor))) for motor in (command.motor_A, command.motor_B))
    )
    if not (np.all(np.isfinite(table)) and np.all(np.isfinite(np.array(inner)))):
        raise ValueError("a gain is not a finite number: no gain was changed")
    require_within("u_plan", command.u_plan, 0.0, known.bounds.u_max, "V")
    require_share(command.k_ext)
    return tuning_with(known, inner, table, command.interpolate, command.u_plan, command.k_ext)
