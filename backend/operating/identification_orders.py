"""From what is asked for to plans of identification, and what these would do to the rig."""

from dataclasses import asdict, dataclass
from typing import Any

from backend.errors import OutOfRangeError
from backend.experiments.forecast import Start, forecast
from backend.experiments.plans import (
    ActuatorIdentificationPlan,
    IdentificationPlan,
    MotorIdentificationPlan,
    SpringIdentificationPlan,
)
from backend.experiments.prediction import PredictedRun, predict, predict_motor, predict_spring
from backend.models.settings import from_values
from backend.schemas.experiment import Metric
from backend.schemas.identification import (
    ActuatorRequest,
    IdentificationRequest,
    MotorRequest,
    PathPoint,
    Prediction,
    SpringRequest,
)
from plant.parameters import PlantParameters


def plans_of(request: IdentificationRequest) -> tuple[IdentificationPlan, ...]:
    """Return the plans that are asked for, several where tensions are listed. Raises SettingError, OutOfRangeError."""
    match request:
        case MotorRequest():
            return (_motor_plan(request),)
        case SpringRequest():
            return (_spring_plan(request),)
        case ActuatorRequest():
            return _actuator_plans(request)


def prediction_of(
    request: IdentificationRequest, parameters: PlantParameters, lam_motor: float, start: Start
) -> Prediction:
    """Tell what a run would do from ``start``; of several runs, the whole way and the largest figures."""
    plans = plans_of(request)
    told = forecast(plans, parameters, start, lam_motor)
    worth = _worth(request, plans, parameters, lam_motor)
    try:
        told.require_within_range(parameters)
        problem = worth.problem
        within_range = True
    except OutOfRangeError as error:
        problem, within_range = str(error), False
    return Prediction(
        duration_s=told.duration_s,
        q_start=told.q_start,
        q_low=told.q_low,
        q_high=told.q_high,
        F_low=told.F_low,
        F_high=told.F_high,
        path=[PathPoint(q=q, S=S) for q, S in zip(told.q_path.tolist(), told.S_path.tolist(), strict=True)],
        within_range=within_range,
        figures=worth.figures,
        q_counts=worth.q_counts,
        u_peak_V=worth.u_peak_V,
        F_min_N=worth.F_min_N,
        enough_motion=not problem,
        message=problem or f"{told.message}; {worth.message}",
    )


@dataclass(frozen=True)
class _Worth:
    """What the run is for: its figures, what it shows, and what ``problem`` makes it not worth starting."""

    figures: list[Metric]
    message: str
    problem: str
    q_counts: float | None = None
    u_peak_V: float | None = None
    F_min_N: float | None = None


def _worth(
    request: IdentificationRequest,
    plans: tuple[IdentificationPlan, ...],
    parameters: PlantParameters,
    lam_motor: float,
) -> _Worth:
    match request:
        case MotorRequest():
            run = predict_motor(_motor_plan(request), parameters)
            return _Worth(_metrics(run), run.message, "" if run.good else run.message, u_peak_V=request.u_high)
        case SpringRequest():
            run = predict_spring(_spring_plan(request), parameters)
            return _Worth(_metrics(run), run.message, "" if run.good else run.message)
        case ActuatorRequest():
            excited = [plan for plan in plans if isinstance(plan, ActuatorIdentificationPlan)]
            return _actuator_worth(excited, parameters, lam_motor)


def _motor_plan(request: MotorRequest) -> MotorIdentificationPlan:
    return from_values(MotorIdentificationPlan, request.model_dump(exclude={"kind"}))


def _spring_plan(request: SpringRequest) -> SpringIdentificationPlan:
    return from_values(SpringIdentificationPlan, request.model_dump(exclude={"kind"}))


def _actuator_plans(request: ActuatorRequest) -> tuple[ActuatorIdentificationPlan, ...]:
    values = request.model_dump(exclude={"kind", "tensions_N", "tension_N"})
    if request.tensions_N is None:
        return (from_values(ActuatorIdentificationPlan, {**values, "tension_N": request.tension_N}),)
    return tuple(_one_of_several(values, place, tension) for place, tension in enumerate(request.tensions_N))


def _one_of_several(values: dict[str, Any], place: int, tension_N: float) -> ActuatorIdentificationPlan:
    try:
        return from_values(ActuatorIdentificationPlan, {**values, "tension_N": tension_N})
    except OutOfRangeError as error:
        if error.quantity != "tension_N":
            raise
        raise OutOfRangeError(
            error.quantity,
            error.value,
            error.minimum,
            error.maximum,
            error.unit,
            error.remedy,
            words=f"tension {place + 1}",
            path=("tensions_N", place),
        ) from None


def _actuator_worth(plans: list[ActuatorIdentificationPlan], parameters: PlantParameters, lam_motor: float) -> _Worth:
    predicted = [predict(plan, parameters, lam_motor) for plan in plans]
    # A run that fails for voltage or slack names that; among good ones the least motion counts.
    worst = min(predicted, key=lambda item: (item.good, item.q_counts))
    u_peak, F_min = max(item.u_peak_V for item in predicted), min(item.F_min_N for item in predicted)
    counts = "By the excitation alone, peak to peak"
    return _Worth(
        figures=[
            Metric(name="q_counts", label=counts, value=worst.q_counts, unit="encoder counts"),
            Metric(name="u_peak_V", label=f"Peak voltage, of {parameters.motor.u_max:g} V", value=u_peak, unit="V"),
        ],
        message=worst.message,
        problem=worst.problem,
        q_counts=worst.q_counts,
        u_peak_V=u_peak,
        F_min_N=F_min,
    )


def _metrics(run: PredictedRun) -> list[Metric]:
    return [Metric(**asdict(figure)) for figure in run.figures]
