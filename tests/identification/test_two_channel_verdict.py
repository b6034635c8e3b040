"""Verdicts on the entries of a two-channel model, and on the model."""

from dataclasses import replace
from typing import Any

import pytest

from backend.identification import FirstOrder, Grade, RelativeGain
from backend.identification.models import Verdict
from backend.identification.records import RestAtLimit
from backend.identification.two_channel_models import EntryEstimate
from backend.identification.two_channel_verdict import EntryData, judge_entry, judge_model

DIRECT = EntryData(
    input="q_c",
    output="q",
    is_direct=True,
    gain=0.9,
    gain_std=0.009,
    wald=1e4,
    wald_bound=6.6,
    first_order=FirstOrder(0.9, 0.3, 0.009, 0.003),
    motion_percent=99.0,
    gain_std_percent=1.0,
    relative_errors={"a1": 1.0, "a2": 5.0},
    fit=98.0,
    misfit=1.0,
    is_white=True,
    is_independent=True,
    rounding=False,
    has_known_sensor=True,
    counts=500.0,
    wrap=None,
    at_limit=None,
    is_fed_back=False,
)
COUPLING = replace(DIRECT, input="S_c", is_direct=False, gain=0.02, gain_std=0.0002, motion_percent=5.0)
ZERO = replace(COUPLING, wald=3.0, first_order=None)
UNEXPLAINED = {"is_white": False, "is_independent": False}


@pytest.mark.parametrize(("entry", "code"), [(DIRECT, "entry_described"), (COUPLING, "entry_described")])
def test_a_good_entry_is_usable_with_gain_and_fit(entry: EntryData, code: str) -> None:
    verdict = judge_entry(entry)
    assert verdict.grade is Grade.USABLE
    assert [reason.code for reason in verdict.reasons] == ["fit_on_validation_data", code]
    assert verdict.reasons[1].values["motion_percent"] == entry.motion_percent


CASES: list[tuple[EntryData, dict[str, Any], Grade, str]] = [
    (DIRECT, {"wald": 6.5}, Grade.UNUSABLE, "entry_not_distinguishable_from_zero"),
    (DIRECT, {"first_order": None}, Grade.UNUSABLE, "parameter_undetermined"),
    (DIRECT, {"first_order": FirstOrder(0.9, 0.3, 0.05, 0.003)}, Grade.CAUTION, "parameter_uncertain"),
    (DIRECT, {"first_order": FirstOrder(0.9, 0.3, 0.009, 0.05)}, Grade.UNUSABLE, "parameter_uncertain"),
    (DIRECT, {"first_order": FirstOrder(0.9, 0.3, 0.009, float("nan"))}, Grade.UNUSABLE, "parameter_undetermined"),
    (DIRECT, {"relative_errors": {"a2": 20.0}}, Grade.CAUTION, "structure_parameter_uncertain"),
    (DIRECT, {"relative_errors": {"a2": float("nan")}}, Grade.UNUSABLE, "structure_parameter_undetermined"),
    (DIRECT, {"fit": float("nan")}, Grade.UNUSABLE, "too_little_motion_for_validation"),
    (DIRECT, {"fit": 70.0, "misfit": 30.0}, Grade.CAUTION, "fit_too_low"),
    (DIRECT, {"fit": 40.0, "misfit": 60.0}, Grade.UNUSABLE, "fit_too_low"),
    (DIRECT, {"counts": 19.0}, Grade.UNUSABLE, "too_little_motion"),
    (DIRECT, {"wrap": 6.28}, Grade.UNUSABLE, "output_wraps"),
    (DIRECT, {"is_fed_back": True, "misfit": 5.0}, Grade.CAUTION, "noise_fed_back_to_input"),
    (DIRECT, {**UNEXPLAINED, "misfit": 5.0}, Grade.CAUTION, "motion_unexplained"),
    (DIRECT, {**UNEXPLAINED, "misfit": 25.0, "fit": 85.0}, Grade.UNUSABLE, "motion_unexplained"),
    (DIRECT, {**UNEXPLAINED, "has_known_sensor": False}, Grade.CAUTION, "residuals_follow_input"),
    (DIRECT, {"is_white": False, "has_known_sensor": False}, Grade.CAUTION, "residuals_not_white"),
    (
        DIRECT,
        {**UNEXPLAINED, "at_limit": RestAtLimit(0.5, 10.0, 5.0, abrupt=True)},
        Grade.UNUSABLE,
        "output_stops_at_limit",
    ),
    (
        DIRECT,
        {**UNEXPLAINED, "at_limit": RestAtLimit(0.5, 10.0, 5.0, abrupt=False)},
        Grade.CAUTION,
        "output_rests_at_limit",
    ),
    (COUPLING, {"gain_std_percent": 5.0}, Grade.CAUTION, "coupling_uncertain"),
    (COUPLING, {"gain_std_percent": 11.0}, Grade.UNUSABLE, "coupling_uncertain"),
    (COUPLING, {"gain_std_percent": float("nan")}, Grade.UNUSABLE, "parameter_undetermined"),
    (ZERO, {}, Grade.USABLE, "entry_not_distinguishable_from_zero"),
]


@pytest.mark.parametrize(("entry", "changes", "grade", "code"), CASES)
def test_each_defect_has_its_grade_and_reason(
    entry: EntryData, changes: dict[str, Any], grade: Grade, code: str
) -> None:
    verdict = judge_entry(replace(entry, **changes))
    assert (verdict.grade, verdict.reasons[0].code) == (grade, code)


@pytest.mark.parametrize(
    "changes",
    [
        {"gain": 1e-9, "gain_std": 0.1},  # a coupling needs no static gain
        {"relative_errors": {"a1": 50.0}},  # the denominator is judged with the direct entry
        {**UNEXPLAINED, "rounding": True},
        {**UNEXPLAINED, "misfit": 0.005},
    ],
)
def test_what_does_not_matter_for_a_coupling_is_accepted(changes: dict[str, Any]) -> None:
    assert judge_entry(replace(COUPLING, **changes)).grade is Grade.USABLE


def test_a_zero_coupling_is_named_with_every_grade() -> None:
    verdict = judge_entry(replace(ZERO, gain_std_percent=5.0))
    assert verdict.grade is Grade.CAUTION
    assert [one.code for one in verdict.reasons] == ["coupling_uncertain", "entry_not_distinguishable_from_zero"]


def estimate(entry: EntryData) -> EntryEstimate:
    return EntryEstimate(
        input=entry.input,
        output=entry.output,
        gain=entry.gain,
        gain_std=entry.gain_std,
        numerator=(entry.gain,),
        numerator_std=(entry.gain_std,),
        denominator=(1.0, 0.3),
        wald=entry.wald,
        wald_bound=entry.wald_bound,
        is_zero=entry.is_zero,
        first_order=entry.first_order,
        motion_percent=entry.motion_percent,
        verdict=judge_entry(entry),
    )


def judge(value: float, std: float, *entries: EntryData) -> Verdict:
    return judge_model([estimate(entry) for entry in entries], RelativeGain(value, std))


def test_the_model_has_the_worst_grade_with_its_reasons() -> None:
    good = judge(1.0, 0.01, DIRECT, ZERO)
    assert good.grade is Grade.USABLE
    assert {reason.values["channel"] for reason in good.reasons} == {"q from q_c", "q from S_c"}
    bad = judge(1.0, 0.01, DIRECT, replace(COUPLING, gain_std_percent=5.0))
    assert bad.grade is Grade.CAUTION
    (reason,) = bad.reasons
    assert getattr(reason.values["reason"], "code", "") == "coupling_uncertain"


@pytest.mark.parametrize(
    ("value", "std", "grade", "code"),
    [
        (-0.3, 0.1, Grade.UNUSABLE, "pairing_interacts"),
        (0.49, 0.001, Grade.UNUSABLE, "pairing_interacts"),
        (float("nan"), 0.1, Grade.UNUSABLE, "pairing_interacts"),
        (0.6, 0.04, Grade.CAUTION, "pairing_uncertain"),
        (1.0, float("nan"), Grade.CAUTION, "pairing_uncertain"),
    ],
)
def test_a_pairing_that_interacts_too_much_is_reported(value: float, std: float, grade: Grade, code: str) -> None:
    verdict = judge(value, std, DIRECT, ZERO)
    assert (verdict.grade, verdict.reasons[-1].code) == (grade, code)
