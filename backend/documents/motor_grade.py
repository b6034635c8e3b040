"""The grade of an identified motor, of early documents too, which were stored without one. Pure."""

import math

from backend.documents.motor import MotorFound
from backend.identification.models import Grade
from backend.identification.motor import judge_motor, spread_percent


def grade_of(found: MotorFound) -> Grade:
    """Return the grade as it is stored; where it was stored without, what its figures say."""
    if found.quality.grade is not None:
        return found.quality.grade
    fitted, std = found.model.parameters, found.model.std_errors
    K_m, T_m, std_K_m, std_T_m, counts = (
        math.nan if value is None else value
        for value in (fitted.K_m, fitted.T_m, std.K_m, std.T_m, found.quality.rms_counts)
    )
    return judge_motor(K_m, T_m, spread_percent(K_m, T_m, std_K_m, std_T_m), counts, 0.0)
