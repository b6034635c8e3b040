"""What the identifications of a series came to, each kind in tables of its own."""

from collections.abc import Iterator, Sequence

from backend.analysis.identification import MOTOR_B, load_friction_of
from backend.models.identification import CHANNELS, grade_of
from backend.reports.document import Column, Paragraph, Section, Table, share, shown
from backend.reports.source import Source
from backend.storage.identifications import Identification
from backend.storage.runs import RunKind
from plant.parameters import SIDES

_RUN, _GRADE = Column("Run"), Column("Grade", number=False)
_UNITS = {"G_q": "", "G_S": "N·m/rad²"}


def identifications_section(sources: Sequence[Source]) -> tuple[Section, ...]:
    """Return one section of all identifications among the runs; none where there is none."""
    found = [source.identification for source in sources if source.identification is not None]
    if not found:
        return ()
    by_kind = {kind: [one for one in found if one.kind == kind] for kind in ("motor", "spring", "actuator")}
    tables = [*_motors(by_kind["motor"]), *_springs(by_kind["spring"]), *_actuators(by_kind["actuator"])]
    friction = _friction([source for source in sources if source.run.kind == RunKind.ACTUATOR_IDENTIFICATION])
    verdicts = (Paragraph(f"Run {one.run_id}: {one.verdict}") for one in found)
    return (Section("Identifications", (*tables, *friction, *verdicts)),)


def _motors(found: Sequence[Identification]) -> Iterator[Table]:
    for side in SIDES:
        rows = []
        for one in found:
            motor = one.motors.side(side)
            model, std = motor.model.parameters, motor.model.std_errors
            figures = ((model.K_m, std.K_m), (model.T_m, std.T_m), (model.u_c, std.u_c))
            rows.append((str(one.run_id), *(_with_error(*figure) for figure in figures), str(grade_of(motor))))
        if rows:
            columns = (_RUN, Column("K_m", "rad/(V·s)"), Column("T_m", "s"), Column("u_c", "V"), _GRADE)
            yield Table(f"Motor {side}: least squares over all steps, ± standard error.", columns, tuple(rows))


def _springs(found: Sequence[Identification]) -> Iterator[Table]:
    for side in SIDES:
        rows = []
        for one in found:
            model = one.springs[side].model
            fit = next(fit for fit in model.fits if fit.order == model.recommended)
            k = ", ".join(_with_error(*pair) for pair in zip(fit.k, fit.std_errors, strict=True))
            rows.append((str(one.run_id), str(fit.order), k, shown(fit.rms_N)))
        if rows:
            columns = (_RUN, Column("Order"), Column("k_0, k_1, …", "N/m^i", wide=True), Column("RMS", "N"))
            yield Table(f"Spring {side}: the recommended polynomial, ± standard error.", columns, tuple(rows))


def _actuators(found: Sequence[Identification]) -> Iterator[Table]:
    for name in CHANNELS:
        rows = []
        for one in found:
            channel = one.actuator.channel(name)
            model, quality = channel.model.first_order, channel.quality
            gain = quality.gain_geometry
            off = None if gain is None else 100.0 * (model.K / gain - 1.0)
            figures = _with_error(model.K, model.K_std), _with_error(model.T, model.T_std)
            known = shown(off, 2), share(quality.fit_percent)
            rows.append((str(one.run_id), shown(one.actuator.model.S_nominal, 4), *figures, *known, str(quality.grade)))
        if rows:
            columns = (
                _RUN,
                Column("S", "N·m/rad"),
                Column("K", _UNITS[name]),
                Column("T", "s"),
                Column("K off geometry", "%"),
                Column("fit", "%"),
                _GRADE,
            )
            caption = f"{name}: gain and sum of lags, ± standard error; fit on data that was not used."
            yield Table(caption, columns, tuple(rows))


def _friction(sources: Sequence[Source]) -> tuple[Paragraph, ...]:
    """Return what actuator identifications say together of the friction over the load; nothing without any."""
    if not sources:
        return ()
    found = load_friction_of([(source.run, source.columns) for source in sources])
    return (Paragraph(". ".join((found.sentence, *found.left_out, f"{MOTOR_B[0].upper()}{MOTOR_B[1:]}")) + "."),)


def _with_error(value: float | None, std: float | None) -> str:
    return f"{shown(value, 4)} ± {shown(std, 2)}"
