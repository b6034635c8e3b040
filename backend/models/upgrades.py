"""Rewrites documents of earlier versions into the present form. Pure.

For the migration and for imports. Each function returns the document that it was given where that has the present form,
or cannot be read in any.
"""

import json
import math
from collections.abc import Mapping
from dataclasses import fields
from typing import Any

from backend.identification import Grade, critical_deviation, judge_motor, spread_percent
from backend.models.document import DocumentCodec, UnreadableDocumentError, replace_non_finite
from backend.models.identification import (
    CHANNELS,
    MOTOR_MODELS,
    MOTOR_QUALITIES,
    QUALITY,
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
from plant import SIDES

NO_STORED_REASON = "evaluated by an older version, which kept no reason; evaluate the run again to have one"
SEQUENCE, SEGMENTS = "sequence", "segments"
"""What an own sequence of references was called, and its one setting."""

_OF_SEGMENT = ("duration_s", "q_ref", "S_ref", "F_push", "period_s")
_LOOP = tuple(item.name for item in fields(StoredLoopSettings))
_BEFORE_KEPT: dict[str, Any] = {
    "b": 0.0,
    "bank": 0,
    "interpolate": False,
    "motion": LAMBDA,
    "u_plan": 8.5,
    "k_ext": 0.0,
}
"""What was in force of these parts of a tuning before they were kept."""


def upgrade_record(kind: str, document: Mapping[str, Any]) -> dict[str, Any]:
    """Return a record of a kind with its documents in the present form."""
    match kind:
        case "run":
            changed = {"settings": upgrade_run_settings(document["settings"])}
        case "result":
            changed = {
                "metrics": upgrade_metrics(document["metrics"]),
                "criteria": upgrade_criteria(document["criteria"]),
            }
        case "identification":
            changed = {"quality": upgrade_quality(document["kind"], document["model"], document["quality"])}
        case _:
            changed = {}
    return {**document, **changed}


def upgrade_run_settings(document: Any) -> Any:
    """Return the settings of a run with its tuning, and the motion, in ``loop``, and with its plan as it is written.

    A session had its tuning beside the mode, ``u_plan`` alone said how references are followed, and a sequence had a
    list of segments for an experiment.
    """
    if not isinstance(document, Mapping):
        return document
    loop, rest = document.get("loop"), document
    if loop is None and "mode" in document:
        loop = {name: document[name] for name in _LOOP if name in document}
        rest = {name: part for name, part in document.items() if name not in _LOOP}
    if not isinstance(loop, Mapping):
        return document
    return _readable(SETTINGS, {**_with_experiment(rest), "loop": complete_motion(loop)}, document)


def convert_sequence(segments: object) -> dict[str, Any] | None:
    """Return the experiment that plays what a sequence did, tick by tick; None for what was no sequence.

    A sequence is a text in JSON: a list of segments with ``duration_s``, ``q_ref``, ``S_ref`` and, where they are not
    the default, ``F_push``, ``shape`` and ``period_s``.
    """
    try:
        listed = json.loads(segments) if isinstance(segments, str) else None
        parts = [_part_of_sequence(one) for one in listed] if isinstance(listed, list) else []
    except (ValueError, RecursionError, OverflowError):
        return None
    section = {"name": SEQUENCE, "title": "Own sequence", "parts": parts}
    return {"format": 1, "name": SEQUENCE, "title": "Own sequence", "phases": [section]} if parts else None


def _part_of_sequence(segment: Any) -> dict[str, Any]:
    """Return the part that a segment is. Raises ValueError, OverflowError."""
    if not isinstance(segment, Mapping) or not {*_OF_SEGMENT[:3]} <= set(segment) <= {*_OF_SEGMENT, "shape"}:
        raise ValueError
    shape = segment.get("shape", "step")
    numbers = {name: segment[name] for name in _OF_SEGMENT if name in segment}
    if shape not in ("step", "ramp", "sine") or not all(map(_is_finite, numbers.values())):
        raise ValueError
    if shape == "sine":
        numbers = {"duration_s": numbers["duration_s"], "period_s": 1.0, **numbers}
    else:
        numbers.pop("period_s", None)
    return {"do": shape, **{name: number for name, number in numbers.items() if name != "F_push" or number != 0.0}}


def _is_finite(number: Any) -> bool:
    return isinstance(number, int | float) and not isinstance(number, bool) and math.isfinite(number)


def _with_experiment(document: Mapping[str, Any]) -> Mapping[str, Any]:
    """Return the settings of a run of a sequence with an experiment in its place."""
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
    """Return metrics with a reason for each figure, and definitions 0 for none."""
    if not isinstance(document, Mapping) or not isinstance(document.get("figures"), list):
        return document
    figures = [_with_reason(item, "value") for item in document["figures"]]
    return _readable(METRICS, {"definitions": 0, **document, "figures": figures}, document)


def upgrade_criteria(document: Any) -> Any:
    """Return criteria with a reason for each."""
    if not isinstance(document, list):
        return document
    return _readable(CRITERIA, [_with_reason(item, "passed") for item in document], document)


def upgrade_quality(kind: str, model: Any, quality: Any) -> Any:
    """Return the quality of an identified model with bounds and grades.

    Residual tests of an actuator kept the 99 % band of one lag in place of the bound of the whole test, and motors no
    grade: it is what their figures say. The models themselves have had one form only.
    """
    if not isinstance(quality, Mapping):
        return quality
    match kind:
        case "actuator":
            channels = {name: _with_bounds(quality[name]) for name in CHANNELS if name in quality}
            return _readable(QUALITY, {**quality, **channels}, quality)
        case "motor":
            return _with_grades(model, quality)
        case _:
            return quality


def upgrade_tuning(document: Any) -> Any:
    """Return a kept tuning with all parts, those that were not kept as they were.

    A ``bank`` of null stood for gains from geometry.
    """
    if not isinstance(document, Mapping):
        return document
    kept = {name: part for name, part in complete_motion(document).items() if part is not None}
    return _readable(ACTIVE_TUNING, {**_BEFORE_KEPT, **kept}, document)


def _readable(codec: DocumentCodec[Any], upgraded: Any, document: Any) -> Any:
    if upgraded == document:
        return document
    try:
        codec.read(upgraded, "")
    except UnreadableDocumentError:
        return document
    return upgraded


def _with_reason(item: Any, measured: str) -> Any:
    if not isinstance(item, Mapping) or "reason" in item:
        return item
    return {**item, "reason": NO_STORED_REASON if item.get(measured) is None else ""}


def _with_bounds(channel: Any) -> Any:
    residuals = channel.get("residuals") if isinstance(channel, Mapping) else None
    if not isinstance(residuals, Mapping):
        return channel
    tests = {name: _with_bound(test) for name, test in residuals.items()}
    return {**channel, "residuals": tests}


def _with_bound(test: Any) -> Any:
    if not isinstance(test, Mapping) or test.get("bound") is not None or not isinstance(test.get("band"), list):
        return test
    band = test["band"]
    try:
        critical, alone = critical_deviation(len(band)), critical_deviation(1)
        bound = [None if one is None else one * critical / alone for one in band]
    except (ArithmeticError, TypeError):
        return test
    return replace_non_finite({name: part for name, part in test.items() if name != "band"} | {"bound": bound})


def _with_grades(model: Any, quality: Mapping[str, Any]) -> Mapping[str, Any]:
    sides: dict[str, Any] = {side: quality[side] for side in SIDES if isinstance(quality.get(side), Mapping)}
    without = {side: part for side, part in sides.items() if part.get("grade") is None}
    if not without:
        return quality
    read = {**quality, **{side: {**part, "grade": Grade.UNUSABLE} for side, part in without.items()}}
    try:
        found = MotorsResult(MOTOR_MODELS.read(model, ""), MOTOR_QUALITIES.read(read, ""))
    except UnreadableDocumentError:
        return quality
    return {
        **quality,
        **{side: {**without[side], "grade": _grade(found.side(side))} for side in SIDES if side in without},
    }


def _grade(found: MotorResult) -> str:
    fitted, std = found.model.parameters, found.model.std_errors
    K_m, T_m, std_K_m, std_T_m, counts = (
        math.nan if value is None else value
        for value in (fitted.K_m, fitted.T_m, std.K_m, std.T_m, found.quality.rms_counts)
    )
    spread = spread_percent(K_m, T_m, std_K_m, std_T_m) if K_m and T_m else math.nan
    return judge_motor(K_m, T_m, spread, counts, 0.0).value
