"""Upgrades documents of earlier versions to the current form. Pure.

Migrations and imports use it. Each function returns its document unchanged if that has the current form already, or no
known form.
"""

import json
import math
from collections.abc import Mapping
from dataclasses import fields
from typing import Any

from backend.identification import Grade, critical_deviation, judge_motor, spread_percent
from backend.models.document import DocumentCodec, UnreadableDocumentError, replace_non_finite
from backend.models.identification import (
    ACTUATOR_QUALITY,
    CHANNELS,
    MOTOR_MODELS,
    MOTOR_QUALITIES,
    MotorResult,
    MotorsResult,
)
from backend.models.run import (
    ACTIVE_TUNING,
    CRITERIA,
    LAMBDA,
    METRICS,
    SETTINGS,
    StoredLoopSettings,
    complete_motion,
)
from backend.units import mark_quantities
from plant import SIDES

NO_STORED_REASON = "evaluated by an older version, which stored no reason; evaluate the run again to obtain one"
SEQUENCE, SEGMENTS = "sequence", "segments"
"""Names of a sequence, a former kind of experiment, and of its only setting."""

_SEGMENT_FIELDS = ("duration_s", "q_ref", "S_ref", "F_push", "period_s")
_LOOP_FIELDS = tuple(item.name for item in fields(StoredLoopSettings))
_EARLIER_TUNING_DEFAULTS: dict[str, Any] = {
    "b": 0.0,
    "bank": 0,
    "interpolate": False,
    "motion": LAMBDA,
    "u_plan": 8.5,
    "k_ext": 0.0,
}
"""Values of the parts of a tuning that earlier versions did not store."""


def upgrade_record(kind: str, document: Mapping[str, Any]) -> dict[str, Any]:
    """Return a record of a kind with its documents in the current form."""
    match kind:
        case "run":
            changed = {
                "settings": upgrade_run_settings(document["settings"]),
                **_mark_texts(document, "end_detail", "evaluation_problem"),
            }
        case "result":
            changed = {
                "metrics": upgrade_metrics(document["metrics"]),
                "criteria": upgrade_criteria(document["criteria"]),
            }
        case "identification":
            changed = {
                "quality": upgrade_quality(document["kind"], document["model"], document["quality"]),
                **_mark_texts(document, "verdict"),
            }
        case _:
            changed = {}
    return {**document, **changed}


def mark_text(text: str, _kind: str = "") -> str:
    """Return a text of the service with its quantities marked.

    Texts have these marks since version 0.2.
    """
    return mark_quantities(text)


def mark_event(text: str, kind: str) -> str:
    """Return the text of an event with its quantities marked.

    Notes are texts of persons and stay unchanged, except for those of the service about walls.
    """
    return text if kind == "note" and not text.startswith("wall ") else mark_quantities(text)


def _mark_texts(document: Mapping[str, Any], *texts: str) -> dict[str, str]:
    return {name: mark_quantities(document[name]) for name in texts if isinstance(document.get(name), str)}


def upgrade_run_settings(document: Any) -> Any:
    """Return the settings of a run in the current form.

    In earlier forms a session had its tuning next to the mode instead of in ``loop``, ``u_plan`` implied the motion,
    and a sequence had a list of segments instead of an experiment.
    """
    if not isinstance(document, Mapping):
        return document
    loop, rest = document.get("loop"), document
    if loop is None and "mode" in document:
        loop = {name: document[name] for name in _LOOP_FIELDS if name in document}
        rest = {name: part for name, part in document.items() if name not in _LOOP_FIELDS}
    if not isinstance(loop, Mapping):
        return document
    return _return_if_readable(SETTINGS, {**_replace_sequence(rest), "loop": complete_motion(loop)}, document)


def convert_sequence(segments: object) -> dict[str, Any] | None:
    """Return the experiment with the same references at each tick as a sequence.

    The result is None for an invalid sequence. A sequence is a JSON text: a list of segments with ``duration_s``,
    ``q_ref``, ``S_ref`` and, unless they have their defaults, ``F_push``, ``shape`` and ``period_s``.
    """
    try:
        parsed = json.loads(segments) if isinstance(segments, str) else None
        parts = [_convert_segment(segment) for segment in parsed] if isinstance(parsed, list) else []
    except (ValueError, RecursionError, OverflowError):
        return None
    phase = {"name": SEQUENCE, "title": "Own sequence", "parts": parts}
    return {"format": 1, "name": SEQUENCE, "title": "Own sequence", "phases": [phase]} if parts else None


def _convert_segment(segment: Any) -> dict[str, Any]:
    """Return a segment as a part of an experiment. Raises ValueError, OverflowError."""
    if not isinstance(segment, Mapping) or not {*_SEGMENT_FIELDS[:3]} <= set(segment) <= {*_SEGMENT_FIELDS, "shape"}:
        raise ValueError
    shape = segment.get("shape", "step")
    numbers = {name: segment[name] for name in _SEGMENT_FIELDS if name in segment}
    if shape not in ("step", "ramp", "sine") or not all(map(_is_finite_number, numbers.values())):
        raise ValueError
    if shape == "sine":
        numbers = {"duration_s": numbers["duration_s"], "period_s": 1.0, **numbers}
    else:
        numbers.pop("period_s", None)
    return {"do": shape, **{name: number for name, number in numbers.items() if name != "F_push" or number != 0.0}}


def _is_finite_number(number: Any) -> bool:
    return isinstance(number, int | float) and not isinstance(number, bool) and math.isfinite(number)


def _replace_sequence(document: Mapping[str, Any]) -> Mapping[str, Any]:
    """Return the settings of a run with a sequence replaced by an experiment."""
    plan, declared = document.get("plan"), document.get("declared")
    if not isinstance(plan, Mapping) or set(plan) != {SEGMENTS}:
        return document
    experiment = convert_sequence(plan[SEGMENTS])
    if experiment is None:
        return document
    text = json.dumps(experiment, ensure_ascii=False, separators=(",", ":"))
    document = {**document, "plan": {"experiment": text}}
    if isinstance(declared, list):
        others = [one for one in declared if not isinstance(one, Mapping) or one.get("name") != SEGMENTS]
        document = {**document, "declared": others}
    return document


def upgrade_metrics(document: Any) -> Any:
    """Return metrics that have a reason each, and definitions, 0 without a version."""
    if not isinstance(document, Mapping) or not isinstance(document.get("figures"), list):
        return document
    figures = [_add_reason(item, "value") for item in document["figures"]]
    return _return_if_readable(METRICS, {"definitions": 0, **document, "figures": figures}, document)


def upgrade_criteria(document: Any) -> Any:
    """Return criteria that each have a reason."""
    if not isinstance(document, list):
        return document
    return _return_if_readable(CRITERIA, [_add_reason(item, "passed") for item in document], document)


def upgrade_quality(kind: str, model: Any, quality: Any) -> Any:
    """Return the quality of an identified model with bounds and grades.

    In earlier forms a residual test of an actuator had the 99 % band of one lag instead of the bound of the whole test,
    and a motor had no grade; the grade is computed from its model.
    """
    if not isinstance(quality, Mapping):
        return quality
    match kind:
        case "actuator":
            channels = {name: _add_bounds(quality[name]) for name in CHANNELS if name in quality}
            return _return_if_readable(ACTUATOR_QUALITY, {**quality, **channels}, quality)
        case "motor":
            return _add_grades(model, quality)
        case _:
            return quality


def upgrade_tuning(document: Any) -> Any:
    """Return the stored active tuning with all parts.

    In earlier forms a ``bank`` of null meant geometric gains.
    """
    if not isinstance(document, Mapping):
        return document
    stored = {name: part for name, part in complete_motion(document).items() if part is not None}
    return _return_if_readable(ACTIVE_TUNING, {**_EARLIER_TUNING_DEFAULTS, **stored}, document)


def _return_if_readable(codec: DocumentCodec[Any], upgraded: Any, document: Any) -> Any:
    """Return the upgraded document if it can be read, else the original one."""
    if upgraded == document:
        return document
    try:
        codec.read(upgraded, "")
    except UnreadableDocumentError:
        return document
    return upgraded


def _add_reason(item: Any, measured: str) -> Any:
    """Return a metric or criterion with a reason, its quantities marked.

    It was not measured if the entry ``measured`` is None.
    """
    if not isinstance(item, Mapping):
        return item
    if "reason" in item:
        return {**item, **_mark_texts(item, "reason")}
    return {**item, "reason": NO_STORED_REASON if item.get(measured) is None else ""}


def _add_bounds(channel: Any) -> Any:
    residuals = channel.get("residuals") if isinstance(channel, Mapping) else None
    if not isinstance(residuals, Mapping):
        return channel
    tests = {name: _add_bound(test) for name, test in residuals.items()}
    return {**channel, "residuals": tests}


def _add_bound(test: Any) -> Any:
    """Return a residual test with its bound, computed from the band of one lag."""
    if not isinstance(test, Mapping) or test.get("bound") is not None or not isinstance(test.get("band"), list):
        return test
    band = test["band"]
    try:
        critical, single = critical_deviation(len(band)), critical_deviation(1)
        bound = [None if value is None else value * critical / single for value in band]
    except (ArithmeticError, TypeError):
        return test
    return replace_non_finite({name: part for name, part in test.items() if name != "band"} | {"bound": bound})


def _add_grades(model: Any, quality: Mapping[str, Any]) -> Mapping[str, Any]:
    sides: dict[str, Any] = {side: quality[side] for side in SIDES if isinstance(quality.get(side), Mapping)}
    ungraded = {side: part for side, part in sides.items() if part.get("grade") is None}
    if not ungraded:
        return quality
    # the codec needs a grade to read the rest
    readable = {**quality, **{side: {**part, "grade": Grade.UNUSABLE} for side, part in ungraded.items()}}
    try:
        result = MotorsResult(MOTOR_MODELS.read(model, ""), MOTOR_QUALITIES.read(readable, ""))
    except UnreadableDocumentError:
        return quality
    return {
        **quality,
        **{side: {**ungraded[side], "grade": _judge_motor(result.side(side))} for side in SIDES if side in ungraded},
    }


def _judge_motor(motor: MotorResult) -> str:
    fit, std = motor.model.parameters, motor.model.std_errors
    K_m, T_m, std_K_m, std_T_m, counts = (
        math.nan if value is None else value for value in (fit.K_m, fit.T_m, std.K_m, std.T_m, motor.quality.rms_counts)
    )
    spread = spread_percent(K_m, T_m, std_K_m, std_T_m) if K_m and T_m else math.nan
    return judge_motor(K_m, T_m, spread, counts, 0.0).value
