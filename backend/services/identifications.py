"""Stored identifications and spring tables, as the interface shows them."""

import logging
from collections.abc import Callable

from backend.analysis import build_curves, compute_trend, validate_on_run
from backend.models import ChannelName, MotorConstants, MotorFit, TableReading, UnreadableDocumentError
from backend.plain_text import escape_line
from backend.schemas import (
    ColumnNotRead,
    IdentificationCurves,
    IdentificationView,
    ModelView,
    MotorEstimate,
    MotorView,
    SettingValue,
    SpringTableReading,
    SpringTableView,
    SpringView,
    Trend,
    ValidationView,
)
from backend.services import record_messages
from backend.services.banks import TuningContext
from backend.services.runs import build_run_message
from backend.storage import (
    Database,
    Identification,
    NewIdentification,
    Run,
    RunKind,
    UnknownRecordError,
    identifications,
    results,
    runs,
)
from backend.workers import WorkerProcess
from plant import SIDES

# Views ---------------------------------------------------------------------------------------------


def build_identification_view(run: Run, estimate: Identification | None, progress: float) -> IdentificationView:
    """Return an identification run with its models, if it has any."""
    kind = run.kind.removesuffix("_identification")
    actuator = estimate if kind == "actuator" else None
    values, problem = _read_settings(run)
    tension_N = values.get("tension_N")
    return IdentificationView(
        id=run.id,
        run=run.id,
        kind=kind,
        status=run.end_state,
        created=run.started_at,
        progress=progress,
        tension_N=tension_N if isinstance(tension_N, int | float) else None,
        S_nominal=None if actuator is None else actuator.actuator.model.S_nominal,
        settings=values,
        estimate=None if estimate is None else estimate.id,
        usable=estimate is not None and estimate.usable,
        G_q=None if actuator is None else _build_model_view(actuator, "G_q"),
        G_S=None if actuator is None else _build_model_view(actuator, "G_S"),
        motors=_build_motor_views(estimate) if estimate is not None and kind == "motor" else [],
        springs=_build_spring_views(estimate) if estimate is not None and kind == "spring" else [],
        message=problem or (build_run_message(run, None) if estimate is None else estimate.verdict),
    )


def build_spring_table_view(found: Identification) -> SpringTableView:
    """Return a spring that was identified from an imported table."""
    return SpringTableView(
        id=found.id,
        file=escape_line(found.table.file),
        sha256=found.table.sha256,
        read=None if found.table.read is None else _build_reading_view(found.table.read),
        created=found.created_at,
        who=found.who,
        usable=found.usable,
        spring=_build_spring_views(found)[0],
        message=found.verdict,
    )


def _build_reading_view(read: TableReading) -> SpringTableReading:
    return SpringTableReading.model_validate(
        {
            **{name: read.layout[name] for name in SpringTableReading.model_fields if name in read.layout},
            "x_unit": read.x_unit,
            "F_unit": read.F_unit,
            "not_read": [ColumnNotRead(name=name, reason=reason) for name, reason in read.not_read.items()],
            "notes": list(read.notes),
        }
    )


def _read_settings(run: Run) -> tuple[dict[str, SettingValue], str]:
    """Return plan and tuning by name, or an empty dict and the reason."""
    try:
        return dict(run.set_to.get_values()), ""
    except UnreadableDocumentError as error:
        return {}, str(error)


def _build_model_view(estimate: Identification, name: ChannelName) -> ModelView:
    channel = estimate.actuator.channel(name)
    model, quality = channel.model, channel.quality
    return ModelView(
        structure=model.structure,
        method=estimate.method if model.method is None else model.method,
        parameters=model.parameters,
        std_errors=model.std_errors,
        fit_percent=quality.fit_percent,
        gain_geometry=_require_value(quality.gain_geometry, estimate, "gain_geometry"),
        K=model.first_order.K,
        T=model.first_order.T,
        K_std=model.first_order.K_std,
        T_std=model.first_order.T_std,
        grade=quality.grade,
        usable=quality.usable,
        verdict=quality.verdict,
    )


def _build_motor_views(estimate: Identification) -> list[MotorView]:
    views = []
    for side in SIDES:
        found = estimate.motors.side(side)
        model, quality = found.model, found.quality
        views.append(
            MotorView(
                side=side,
                u_c=_require_value(model.parameters.u_c, estimate, "u_c"),
                u_c_std=_require_value(model.std_errors.u_c, estimate, "std_errors.u_c"),
                fitted=_build_motor_estimate(model.parameters, estimate),
                std_errors=_build_motor_estimate(model.std_errors, estimate),
                rule_mean=_build_motor_estimate(model.rule_mean, estimate),
                rule_spread=_build_motor_estimate(model.rule_spread, estimate),
                before=_build_motor_estimate(model.before, estimate),
                rms_counts=_require_value(quality.rms_counts, estimate, "rms_counts"),
                refused=[
                    record_messages.step_not_used(voltage=item.voltage, reason=item.reason) for item in quality.refused
                ],
                grade=quality.grade,
                verdict=quality.verdict,
            )
        )
    return views


def _build_motor_estimate(found: MotorFit | MotorConstants, estimate: Identification) -> MotorEstimate:
    return MotorEstimate(K_m=_require_value(found.K_m, estimate, "K_m"), T_m=_require_value(found.T_m, estimate, "T_m"))


def _require_value(value: float | None, estimate: Identification, name: str) -> float:
    if value is None:
        raise UnreadableDocumentError(
            record_messages.estimate_without_value(run=estimate.run_id, estimate=estimate.id, name=name)
        )
    return value


def _build_spring_views(estimate: Identification) -> list[SpringView]:
    return [
        SpringView(
            name=name,
            recommended=found.model.recommended,
            reason=found.model.reason,
            pairs=found.quality.pairs,
            hysteresis_N=found.quality.hysteresis_N,
            fits=list(found.model.fits),
        )
        for name, found in estimate.springs.items()
    ]


# Stored identifications ----------------------------------------------------------------------------


_log = logging.getLogger(__name__)

IDENTIFICATION_KINDS = (RunKind.ACTUATOR_IDENTIFICATION, RunKind.MOTOR_IDENTIFICATION, RunKind.SPRING_IDENTIFICATION)


class StoredIdentifications:
    """Reads and writes identifications; long computations run in the worker process.

    Methods that are not coroutines wait for the database: the event loop calls them in a thread. ``progress`` returns
    the progress of a run, from 0 to 1.
    """

    def __init__(
        self,
        database: Database,
        progress: Callable[[Run], float],
        worker: WorkerProcess,
        tuning: Callable[[], TuningContext],
    ) -> None:
        self._database = database
        self._progress = progress
        self._worker = worker
        self._tuning = tuning

    async def validate(self, run_id: int, of: int) -> ValidationView:
        """Compare a model with the recording of another run ``of``.

        Raises UnknownRecordError, NotComparableError.
        """
        return ValidationView.model_validate(await self._worker.run(validate_on_run, self._database, run_id, of))

    async def compute_trend(self) -> Trend:
        """Return identified gains and time constants versus S, with their predictions."""
        tuning = self._tuning()
        computed = self._worker.run(compute_trend, self._database, tuning.parameters, tuning.lambdas.lam_motor)
        return Trend.model_validate(await computed)

    def list_identifications(self) -> list[IdentificationView]:
        """Return all identification runs, newest first."""
        with self._database.reading() as session:
            estimates = {estimate.run_id: estimate for estimate in reversed(identifications.find(session))}
            found = runs.find(session, kinds=IDENTIFICATION_KINDS, limit=500)
            return [self._build_view(run, estimates.get(run.id)) for run in found]

    def _build_view(self, run: Run, estimate: Identification | None) -> IdentificationView:
        """Return a run for the list; an unreadable one has the reason as its message."""
        try:
            return build_identification_view(run, estimate, self._progress(run))
        except UnreadableDocumentError as error:
            view = build_identification_view(run, None, self._progress(run))
            return view.model_copy(update={"message": str(error)})

    def load_identification(self, run_id: int) -> IdentificationView:
        """Return one identification run. Raises UnknownRecordError."""
        with self._database.reading() as session:
            run = runs.get(session, run_id)
            if run.kind not in IDENTIFICATION_KINDS:
                raise UnknownRecordError(record_messages.run_is_not_an_identification(run=run_id, kind=run.kind))
            estimates = identifications.find(session, run_id=run_id)
            result = results.newest(session, run_id)
        view = build_identification_view(run, estimates[0] if estimates else None, self._progress(run))
        problem = "" if result is None else result.metrics.problem
        return view.model_copy(update={"message": problem}) if problem else view

    def build_curves(self, run_id: int) -> IdentificationCurves:
        """Return the curves of the newest estimate of a run. Raises UnknownRecordError."""
        with self._database.reading() as session:
            found = identifications.of_run(session, run_id)
        return IdentificationCurves.model_validate(build_curves(found))

    def list_spring_tables(self) -> list[SpringTableView]:
        """Return springs identified from tables, newest first."""
        with self._database.reading() as session:
            found = identifications.find(session, kind="spring")
        views = []
        for table in found:
            try:
                views += [build_spring_table_view(table)] if table.run_id is None else []
            except UnreadableDocumentError as error:  # the list shows the readable ones
                _log.warning("The list of spring tables omits an unreadable one: %s", error)
        return views

    def load_spring_table(self, number: int) -> SpringTableView:
        """Return a spring identified from a table. Raises UnknownRecordError."""
        return build_spring_table_view(self._load_spring_table(number))

    def build_spring_table_curves(self, number: int) -> IdentificationCurves:
        """Return the curves of a spring from a table. Raises UnknownRecordError."""
        return IdentificationCurves.model_validate(build_curves(self._load_spring_table(number)))

    def add_spring_table(self, new: NewIdentification) -> SpringTableView:
        """Store a spring that was identified from a measured table."""
        with self._database.session() as session:
            stored = identifications.add(session, new)
        return build_spring_table_view(stored)

    def _load_spring_table(self, number: int) -> Identification:
        with self._database.reading() as session:
            found = identifications.get(session, number)
        if found.kind != "spring" or found.run_id is not None:
            raise UnknownRecordError(record_messages.identification_not_from_table(identification=number))
        return found
