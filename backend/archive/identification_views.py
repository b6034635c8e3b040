"""From stored identifications to what the interface shows of them; no record is changed here."""

from dataclasses import asdict

from backend.archive.views import message_of
from backend.models.document import UnreadableDocumentError
from backend.models.identification import ChannelName, Fitted, Pair, TableReading, grade_of
from backend.plain_text import as_line
from backend.schemas.experiment import SettingValue
from backend.schemas.identification import (
    ColumnNotRead,
    IdentificationView,
    ModelView,
    MotorEstimate,
    MotorView,
    SpringFitView,
    SpringTableReading,
    SpringTableView,
    SpringView,
)
from backend.storage.identifications import Identification
from backend.storage.runs import Run
from plant.parameters import SIDES


def identification_view(run: Run, estimate: Identification | None, progress: float) -> IdentificationView:
    """Return an identification run with its models, where it has any."""
    kind = run.kind.removesuffix("_identification")
    actuator = estimate if kind == "actuator" else None
    told, problem = _told(run)
    tension_N = told.get("tension_N")
    return IdentificationView(
        id=run.id,
        run=run.id,
        kind=kind,
        status=run.end_state,
        created=run.started_at,
        progress=progress,
        tension_N=tension_N if isinstance(tension_N, int | float) else None,
        S_nominal=None if actuator is None else actuator.actuator.model.S_nominal,
        settings=told,
        estimate=None if estimate is None else estimate.id,
        usable=estimate is not None and estimate.usable,
        G_q=None if actuator is None else _model_view(actuator, "G_q"),
        G_S=None if actuator is None else _model_view(actuator, "G_S"),
        motors=_motors(estimate) if estimate is not None and kind == "motor" else [],
        springs=_springs(estimate) if estimate is not None and kind == "spring" else [],
        message=problem or (message_of(run, None) if estimate is None else estimate.verdict),
    )


def spring_table_view(found: Identification) -> SpringTableView:
    """Return a spring that was identified from a table."""
    return SpringTableView(
        id=found.id,
        file=as_line(found.table.file),
        sha256=found.table.sha256,
        read=None if found.table.read is None else _reading(found.table.read),
        created=found.created_at,
        who=found.who,
        usable=found.usable,
        spring=_springs(found)[0],
        message=found.verdict,
    )


def _reading(read: TableReading) -> SpringTableReading:
    return SpringTableReading.model_validate(
        {
            **{name: read.layout[name] for name in SpringTableReading.model_fields if name in read.layout},
            "x_unit": read.x_unit,
            "F_unit": read.F_unit,
            "not_read": [ColumnNotRead(name=name, reason=reason) for name, reason in read.not_read.items()],
            "notes": list(read.notes),
        }
    )


def _told(run: Run) -> tuple[dict[str, SettingValue], str]:
    """Return plan and tuning by name; nothing, and why, where they cannot be read."""
    try:
        return dict(run.set_to.told()), ""
    except UnreadableDocumentError as error:
        return {}, str(error)


def _model_view(estimate: Identification, name: ChannelName) -> ModelView:
    channel = estimate.actuator.channel(name)
    model, quality = channel.model, channel.quality
    return ModelView(
        structure=model.structure,
        method=estimate.method if model.method is None else model.method,
        parameters=model.parameters,
        std_errors=model.std_errors,
        fit_percent=quality.fit_percent,
        gain_geometry=_needed(quality.gain_geometry, estimate, "gain_geometry"),
        K=model.first_order.K,
        T=model.first_order.T,
        K_std=model.first_order.K_std,
        T_std=model.first_order.T_std,
        grade=quality.grade,
        usable=quality.usable,
        verdict=quality.verdict,
    )


def _motors(estimate: Identification) -> list[MotorView]:
    views = []
    for side in SIDES:
        found = estimate.motors.side(side)
        model, quality = found.model, found.quality
        views.append(
            MotorView(
                side=side,
                u_c=_needed(model.parameters.u_c, estimate, "u_c"),
                u_c_std=_needed(model.std_errors.u_c, estimate, "std_errors.u_c"),
                fitted=_motor_estimate(model.parameters, estimate),
                std_errors=_motor_estimate(model.std_errors, estimate),
                rule_mean=_motor_estimate(model.rule_mean, estimate),
                rule_spread=_motor_estimate(model.rule_spread, estimate),
                before=_motor_estimate(model.before, estimate),
                rms_counts=_needed(quality.rms_counts, estimate, "rms_counts"),
                refused=[f"{item.voltage:g} V: {item.reason}" for item in quality.refused],
                grade=grade_of(found),
                verdict=quality.verdict,
            )
        )
    return views


def _motor_estimate(found: Fitted | Pair, estimate: Identification) -> MotorEstimate:
    return MotorEstimate(K_m=_needed(found.K_m, estimate, "K_m"), T_m=_needed(found.T_m, estimate, "T_m"))


def _needed(value: float | None, estimate: Identification, name: str) -> float:
    if value is None:
        raise UnreadableDocumentError(f"run {estimate.run_id}: the estimate {estimate.id} has no figure for {name}")
    return value


def _springs(estimate: Identification) -> list[SpringView]:
    return [
        SpringView(
            name=name,
            recommended=found.model.recommended,
            reason=found.model.reason,
            pairs=found.quality.pairs,
            hysteresis_N=found.quality.hysteresis_N,
            fits=[SpringFitView(**asdict(fit)) for fit in found.model.fits],
        )
        for name, found in estimate.springs.items()
    ]
