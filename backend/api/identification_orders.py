"""From what is asked for to plans of identification, and what these would do to the rig."""

from dataclasses import asdict

from backend.api.schemas.experiment import Metric
from backend.api.schemas.identification import (
    ActuatorRequest,
    IdentificationRequest,
    MotorRequest,
    Prediction,
    SpringRequest,
)
from backend.experiments.identification_plans import MotorIdentificationPlan, SpringIdentificationPlan
from backend.experiments.plans import ActuatorIdentificationPlan, IdentificationPlan
from backend.experiments.prediction import predict
from backend.experiments.settings import from_values
from backend.experiments.unloaded_prediction import PredictedRun, predict_motor, predict_spring
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


def prediction_of(request: IdentificationRequest, parameters: PlantParameters, lam_motor: float) -> Prediction:
    """Tell what a run would do; of several runs, the least motion and tension and the largest voltage."""
    match request:
        case MotorRequest():
            return _prediction(predict_motor(_motor_plan(request), parameters), u_peak_V=request.u_high)
        case SpringRequest():
            return _prediction(predict_spring(_spring_plan(request), parameters), u_peak_V=None)
        case ActuatorRequest():
            return _actuator_prediction(_actuator_plans(request), parameters, lam_motor)


def _motor_plan(request: MotorRequest) -> MotorIdentificationPlan:
    return from_values(MotorIdentificationPlan, request.model_dump(exclude={"kind"}))


def _spring_plan(request: SpringRequest) -> SpringIdentificationPlan:
    return from_values(SpringIdentificationPlan, request.model_dump(exclude={"kind"}))


def _actuator_plans(request: ActuatorRequest) -> tuple[ActuatorIdentificationPlan, ...]:
    values = request.model_dump(exclude={"kind", "tensions_N", "tension_N"})
    tensions = request.tensions_N or [request.tension_N]
    return tuple(from_values(ActuatorIdentificationPlan, {**values, "tension_N": tension}) for tension in tensions)


def _actuator_prediction(
    plans: tuple[ActuatorIdentificationPlan, ...], parameters: PlantParameters, lam_motor: float
) -> Prediction:
    predicted = [predict(plan, parameters, lam_motor) for plan in plans]
    # A run that fails for voltage or slack names that; among good ones the least motion counts.
    worst = min(predicted, key=lambda item: (item.good, item.q_counts))
    u_peak, F_min = max(item.u_peak_V for item in predicted), min(item.F_min_N for item in predicted)
    return Prediction(
        duration_s=sum(plan.program().duration_s for plan in plans),
        figures=[
            Metric(name="q_counts", label="Joint motion, peak to peak", value=worst.q_counts, unit="encoder counts"),
            Metric(name="u_peak_V", label=f"Peak voltage, of {parameters.motor.u_max:g} V", value=u_peak, unit="V"),
            Metric(name="F_min_N", label="Least tension", value=F_min, unit="N"),
        ],
        q_counts=worst.q_counts,
        u_peak_V=u_peak,
        F_min_N=F_min,
        enough_motion=worst.good,
        message=worst.message,
    )


def _prediction(run: PredictedRun, u_peak_V: float | None) -> Prediction:
    return Prediction(
        duration_s=run.duration_s,
        figures=[Metric(**asdict(figure)) for figure in run.figures],
        q_counts=None,
        u_peak_V=u_peak_V,
        F_min_N=None,
        enough_motion=run.good,
        message=run.message,
    )
