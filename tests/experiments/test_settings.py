import itertools
import json
import math
from dataclasses import asdict

import pytest

from backend.experiments.plans import ActuatorIdentificationPlan, SequencePlan, TrackingPlan
from backend.experiments.settings import SettingError, describe, from_values
from backend.loop.program import Law, Segment, Shape
from backend.refusal import OutOfRangeError


def test_every_setting_says_unit_bounds_default_and_meaning() -> None:
    for plan in (TrackingPlan, ActuatorIdentificationPlan):
        for setting in describe(plan):
            assert setting.unit
            assert setting.symbol
            assert setting.meaning
            assert setting.minimum is not None
            assert setting.maximum is not None
            assert setting.minimum <= setting.default <= setting.maximum  # type: ignore[operator]  # numbers only here
            json.dumps(asdict(setting))


def test_words_of_a_command_line_become_numbers() -> None:
    plan = from_values(TrackingPlan, {"q_amplitude": "0.5", "S_low": 9})
    assert (plan.q_amplitude, plan.S_low, plan.S_high) == (0.5, 9.0, 14.0)
    assert from_values(ActuatorIdentificationPlan, {"bits": "9"}).bits == 9


@pytest.mark.parametrize(("name", "value"), [("q_amplitude", 1.6), ("q_amplitude", math.nan), ("S_low", "1e400")])
def test_a_number_out_of_bounds_is_refused_with_bounds_and_unit(name: str, value: object) -> None:
    with pytest.raises(OutOfRangeError) as refused:
        from_values(TrackingPlan, {name: value})
    setting = next(item for item in describe(TrackingPlan) if item.name == name)
    assert refused.value.quantity == name
    assert (refused.value.minimum, refused.value.maximum) == (setting.minimum, setting.maximum)
    assert refused.value.unit == setting.unit


@pytest.mark.parametrize("value", ["wide", True, None, [1.0]])
def test_what_is_no_number_is_refused_with_its_unit(value: object) -> None:
    with pytest.raises(SettingError, match="needs a number in rad") as refused:
        from_values(TrackingPlan, {"q_amplitude": value})
    assert (refused.value.quantity, refused.value.value, refused.value.unit) == ("q_amplitude", value, "rad")


def test_unknown_names_and_fractions_of_counts_are_refused() -> None:
    with pytest.raises(SettingError, match="unknown setting") as unknown:
        from_values(TrackingPlan, {"q_amplitud": 1.0})
    assert "q_amplitude" in unknown.value.legal
    with pytest.raises(SettingError, match="whole number"):
        from_values(ActuatorIdentificationPlan, {"bits": 7.5})


def test_settings_are_checked_against_each_other() -> None:
    with pytest.raises(OutOfRangeError, match="below S_high"):
        from_values(TrackingPlan, {"S_low": 12, "S_high": 11})
    with pytest.raises(OutOfRangeError, match="shorter chip"):
        ActuatorIdentificationPlan(chip_s=2.0, bits=12).program()


def test_tracking_program_holds_its_references_as_the_paper_does() -> None:
    plan = TrackingPlan()
    program, phases = plan.program(), plan.phases()
    assert program.law is Law.CASCADE
    assert [phase.name for phase in phases] == ["lead_in", "position", "stiffness", "both"]
    assert phases[0].start_s == 0.0
    assert phases[-1].end_s == program.duration_s
    assert all(a.end_s == b.start_s for a, b in itertools.pairwise(phases))

    start, by_phase = 0.0, {phase.name: [] for phase in phases}
    for segment in program.segments:
        phase = next(phase for phase in phases if phase.start_s <= start < phase.end_s)
        by_phase[phase.name].append(segment)
        start += segment.duration_s
    assert {segment.S_ref for segment in by_phase["position"]} == {10.0}
    assert {segment.q_ref for segment in by_phase["position"]} >= {math.pi / 3, -math.pi / 3}
    assert {segment.duration_s for segment in by_phase["position"]} == {8.0}
    assert {segment.q_ref for segment in by_phase["stiffness"]} == {0.0}
    assert {segment.S_ref for segment in by_phase["stiffness"]} == {8.0, 10.0, 14.0}
    assert {segment.duration_s for segment in by_phase["stiffness"]} == {6.0}
    for before, after in zip([by_phase["stiffness"][-1], *by_phase["both"]], by_phase["both"], strict=False):
        assert before.q_ref != after.q_ref
        assert before.S_ref != after.S_ref


def test_identification_program_is_the_default_experiment_of_the_method() -> None:
    program = ActuatorIdentificationPlan(tension_N=30.0).program()
    assert program.law is Law.FORCE_HOLD
    assert program.tension_N == 30.0
    assert program.segments == ()
    assert program.excitation is not None
    assert program.excitation.duration_s == pytest.approx(20.32)
    assert program.duration_s == pytest.approx(program.settle_s + 20.32)


def test_own_sequences_are_checked_segment_by_segment() -> None:
    good = Segment(2.0, 0.5, 10.0)
    assert SequencePlan((good, Segment(4.0, 0.8, 10.0, shape=Shape.SINE, period_s=2.0))).program().duration_s == 6.0
    with pytest.raises(OutOfRangeError) as refused:
        SequencePlan((good, Segment(2.0, 0.5, 20.0)))
    assert refused.value.quantity == "segments[2].S_ref"
    assert (refused.value.value, refused.value.maximum, refused.value.unit) == (20.0, 15.0, "N·m/rad")
    with pytest.raises(SettingError, match="at least one"):
        SequencePlan(())
    with pytest.raises(OutOfRangeError, match="3600"):
        SequencePlan((Segment(600.0, 0.0, 10.0),) * 7)
