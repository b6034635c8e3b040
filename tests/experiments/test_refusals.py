"""Invalid experiments are rejected before any motion, with line and bound."""

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import pytest

from backend.banks.tuning_settings import TuningSettings
from backend.experiments import messages
from backend.experiments.parser import ExperimentError
from backend.realtime.program import MAX_TUNINGS
from backend.services.library import OwnExperiments
from backend.storage.database import open_database
from plant.parameters import load_parameters
from tests.experiments.composing.written import WOBBLE, with_parts
from tests.reasons import Reason, TextWith
from tests.refusals import check_reason, refused_because

LEAD_IN = "{do: step, q_ref: 0.0, S_ref: 10.0, duration_s: 6.0}"
NESTED = "{do: repeat, times: 1000, parts: [" * 3 + "{do: hold, duration_s: 1}" + "]}" * 3
DEEP = "{do: repeat, times: 1, parts: [" * 30 + "{do: hold, duration_s: 1}" + "]}" * 30
EMPTY = "{do: repeat, times: 1000, parts: [" * 3 + "]}" * 3
BOUNDS_OF_SHORT = {"minimum": pytest.approx(-0.83, abs=0.005), "maximum": pytest.approx(0.83, abs=0.005)}
SWING = "{do: sine, q_amplitude: 0.25, period_s: 1, duration_s: 1}"
AWAY = "{do: sine, q_amplitude: -0.4, period_s: 4, duration_s: 1}"
TUNINGS = "{do: repeat, times: 1000, parts: [{do: repeat, times: 1000, parts: [{do: tuning, b: 0.5}]}]}"

LEARN = "{do: learn, duration_s: 2}"
FELT = "{{do: until_contact, contact_N: {}, parts: [{{do: hold, duration_s: 2}}]}}"
STIFFER = "{do: step, S_ref: 12, duration_s: 1}"
SECOND = ("phases", 0, "parts", 1)
TWICE = f"{{do: until_contact, contact_N: 2, parts: [{FELT.format(2)}]}}"


@pytest.fixture(scope="module")
def own(tmp_path_factory: pytest.TempPathFactory) -> Iterator[OwnExperiments]:
    database = open_database(tmp_path_factory.mktemp("own"))
    yield OwnExperiments(database)
    database.close()


def refusal(own: OwnExperiments, text: str) -> ExperimentError:
    with pytest.raises(ExperimentError) as caught:
        own.check(text, load_parameters("lab"), TuningSettings())
    return caught.value


def test_the_base_experiment_of_the_rejection_tests_is_valid(own: OwnExperiments) -> None:
    checked = own.check(with_parts(LEAD_IN, "{do: hold, duration_s: 1}"), load_parameters("lab"), TuningSettings())
    assert (checked.duration_s, checked.segments) == (7.0, 2)


@pytest.mark.parametrize(
    ("part", "code", "values"),
    [
        (
            "{do: step, q_ref: 1.5, duration_s: 1}",
            "out_of_range",
            {"quantity": "q_ref", "value": 1.5, "path": (*SECOND, "q_ref")},
        ),
        (
            "{do: step, S_ref: 16, duration_s: 1}",
            "out_of_range",
            {"quantity": "S_ref", "value": 16.0, "minimum": 8.0, "maximum": 15.0, "unit": "N·m/rad"},
        ),
        (
            "{do: sine, q_amplitude: 1.45, period_s: 1, duration_s: 1}",
            "out_of_range",
            {"quantity": "q_amplitude", "value": 1.45, "unit": "rad"},
        ),
        (
            "{do: sine, S_amplitude: 11, period_s: 1, duration_s: 1}",
            "out_of_range",
            {"quantity": "S_amplitude", "value": 11.0, "minimum": -9.9999, "maximum": 9.9999, "unit": "N·m/rad"},
        ),
        ("{do: sine, q_amplitude: 0.1, q_ref: 0.1, period_s: 1, duration_s: 1}", "crest_defined_twice", {}),
        (
            "{do: sine, q_ref: 1.5, period_s: 1, duration_s: 1}",
            "out_of_range",
            {"quantity": "q_ref", "value": 1.5, "label": "position reference", "unit": "rad"},
        ),
        (
            "{do: ramp, q_ref: 0.1, duration_s: 1, F_push: 31}",
            "out_of_range",
            {"quantity": "F_push", "value": 31.0, "minimum": -30.0, "maximum": 30.0, "unit": "N"},
        ),
        (
            "{do: hold, duration_s: -1}",
            "out_of_range",
            {"label": "time", "value": -1.0, "minimum": 0.01, "maximum": 600.0, "path": (*SECOND, "duration_s")},
        ),
        ("{do: hold, duration_s: 601}", "out_of_range", {"value": 601.0, "minimum": 0.01, "maximum": 600.0}),
        ("{do: hold}", "key_missing", {}),
        ("{do: hold, duration_s: 1, q_ref: 1}", "unknown_key", {}),
        ("{do: dance, duration_s: 1}", "unknown_part", {"name": "dance"}),
        ("{duration_s: 1}", "part_without_do", {}),
        ("{do: hold, duration_s: .nan}", "not_an_expression", {"expression": ".nan"}),
        ("{do: hold, duration_s: 1e999}", "unsupported_scalar", {"value": "1e999"}),
        ("{do: hold, duration_s: unknown}", "unknown_name", {"name": "unknown", "known": "pi"}),
        ("{do: hold, duration_s: 1 / 0}", "no_value", {"expression": "1 / 0"}),
        ("{do: hold, duration_s: 2 ** 1e9}", "no_value", {"expression": "2 ** 1e9"}),
        (
            "{do: hold, duration_s: \"__import__('os').system('true')\"}",
            "unsupported_operation",
            {"operation": "__import__('os').system('true')"},
        ),
        ("{do: hold, duration_s: 'pi.real'}", "unsupported_operation", {"operation": "pi.real"}),
        ("{do: hold, duration_s: '[1][0]'}", "unsupported_operation", {"operation": "[1][0]"}),
        ("{do: hold, duration_s: \"'1'\"}", "not_a_finite_number", {"value": "1"}),
        ("{do: tuning, lam_q: 0.1}", "no_motion_after_tuning", {}),
        ("{do: learn}", "no_motion_after_calibration", {}),
        (
            "{do: learn, duration_s: 1}",
            "out_of_range",
            {"label": messages.duration_of_calibration(), "value": 1.0, "minimum": 2.0, "maximum": 600.0},
        ),
        (FELT.format(1.5), "bias_not_calibrated", {}),
        (
            f"{{do: repeat, times: 1, parts: [{LEARN}, {FELT.format(0.5)}]}}",
            "out_of_range",
            {"label": messages.contact_threshold_or_none(), "value": 0.5, "minimum": 1.0, "maximum": 30.0},
        ),
        (
            f"{{do: repeat, times: 1, parts: [{LEARN}, {FELT.format(31)}]}}",
            "out_of_range",
            {"label": messages.contact_threshold(), "value": 31.0, "minimum": 0.0, "maximum": 30.0, "unit": "N"},
        ),
        (
            f"{{do: repeat, times: 1, parts: [{LEARN}, {STIFFER}, {FELT.format(1.5)}]}}",
            "bias_not_calibrated_at",
            {"S": 12.0, "calibrated_S": (10.0,)},
        ),
        (
            f"{{do: repeat, times: 1, parts: [{LEARN}, {FELT.replace('{do: hold', '{do: learn').format(2)}]}}",
            "calibration_within_contact",
            {},
        ),
        (f"{{do: repeat, times: 1, parts: [{LEARN}, {TWICE}]}}", "contact_within_contact", {}),
        (
            "{do: repeat, times: 1000000000, parts: [{do: hold, duration_s: 1}]}",
            "out_of_range",
            {"quantity": "times", "value": 1e9, "minimum": 1, "maximum": 1000},
        ),
        ("{do: repeat, times: 2.5, parts: [{do: hold, duration_s: 1}]}", "not_a_whole_number", {"value": 2.5}),
        (NESTED, "too_many_segments", {"maximum": 1000}),
        (EMPTY, "list_is_empty", {}),
        (TUNINGS, "too_many_tunings", {"maximum": MAX_TUNINGS}),
        (DEEP, "text_nested_too_deep", {"maximum": 40}),
        (
            "{do: repeat, times: 100, parts: [{do: hold, duration_s: 60}]}",
            "out_of_range",
            {"label": messages.duration_up_to_part(), "value": 3606.0, "maximum": 3600.0},
        ),
        (
            "{do: prbs, q_amplitude: 0.1, chip_s: 0.1, bits: 13}",
            "out_of_range",
            {"quantity": "bits", "value": 13.0, "minimum": 4, "maximum": 12},
        ),
        (
            "{do: multisine, q_amplitude: 0.1, period_s: 0.2, lines: 20}",
            "out_of_range",
            {"label": messages.highest_frequency(), "value": pytest.approx(100.0), "maximum": 50.0, "unit": "Hz"},
        ),
        (
            "{do: sweep, q_amplitude: 0.1, from_Hz: 0, to_Hz: 1, duration_s: 5}",
            "out_of_range",
            {"quantity": "from_Hz", "value": 0.0, "unit": "Hz"},
        ),
        (
            "{do: push, F_push: 31, duration_s: 1}",
            "out_of_range",
            {"label": "push", "value": 31.0, "minimum": -30.0, "maximum": 30.0, "unit": "N"},
        ),
        (
            "{do: load, load_A: -0.1, duration_s: 1}",
            "out_of_range",
            {"quantity": "load_A", "value": -0.1, "minimum": 0.0, "maximum": 0.5, "unit": "N·m"},
        ),
        ("{do: choose, by: nothing, of: {a: []}}", "setting_without_choices", {"name": "nothing"}),
        ("&loop {do: hold, duration_s: 1}", "anchor_or_alias", {}),
        ("*loop", "anchor_or_alias", {}),
        (
            "!!python/object:os.system {do: hold}",
            "unsupported_tag",
            {"tag": "tag:yaml.org,2002:python/object:os.system"},
        ),
        ("{do: repeat, index: pi, times: 2, parts: [{do: hold, duration_s: 1}]}", "index_name_taken", {"name": "pi"}),
        ("{do: hold, duration_s: 1, duration_s: 2}", "key_given_twice", {}),
        ("{do: hold, duration_s: yes}", "unknown_name", {"name": "yes"}),
        ("{do: hold, duration_s: 123456789012345678901}", "too_many_digits", {"number": "123456789012345678901"}),
    ],
)
def test_an_invalid_part_is_rejected_with_its_line(
    own: OwnExperiments, part: str, code: str, values: dict[str, object]
) -> None:
    error = refusal(own, with_parts(LEAD_IN, part))
    check_reason(error, code, **values)
    assert error.line == 9


@pytest.mark.parametrize(
    ("part", "key"),
    [
        ("{do: step, q_ref: 1.5, duration_s: 1}", "q_ref"),
        ("{do: sine, q_amplitude: 0.1, q_ref: 0.1, period_s: 1, duration_s: 1}", "q_amplitude"),
        ("{do: hold}", "duration_s"),
        ("{do: hold, duration_s: 1, q_ref: 1}", "q_ref"),
        ("{do: hold, duration_s: 1, duration_s: 2}", "duration_s"),
    ],
)
def test_a_rejection_names_the_invalid_key(own: OwnExperiments, part: str, key: str) -> None:
    assert refusal(own, with_parts(LEAD_IN, part)).path == (*SECOND, key)


@pytest.mark.parametrize(
    ("old", "new", "line", "code", "values"),
    [
        ("measures: [steps]", "measures: [songs]", 16, "invalid_value", {"error_type": "enum"}),
        ("name: swing", "name: lead_in", 11, "phase_name_taken", {}),
        ("name: wobble", "name: 2nd try", 2, "invalid_name", {}),
        ("format: 1", "format: 2", 1, "unknown_format", {"value": 2, "known": 1}),
        ("name: depth", "name: lam_q", 5, "setting_name_taken", {"name": "lam_q"}),
        ("default: 0.2", "default: 0.9", 5, "invalid_default", {"name": "depth", "default": 0.9}),
        ("name: depth", "name: u_max", 5, "setting_name_taken", {"name": "u_max"}),
        ("name: depth,", "name: depth, kind: integer,", 5, "default_not_whole", {"default": 0.2}),
        ("maximum: 0.5}", "}", 5, "setting_without_bounds", {"name": "depth"}),
        ("title: Wobble", "title: Wobble\nlaw: magic", 4, "unknown_law", {"law": "magic"}),
        ("title: Wobble", "title: [Wobble", 4, "not_yaml_or_json", {}),
        ("title: Wobble", "titel: Wobble", 3, "unknown_key", {}),
    ],
)
def test_keys_outside_the_parts_are_checked(
    own: OwnExperiments, old: str, new: str, line: int, code: str, values: dict[str, object]
) -> None:
    assert old in WOBBLE
    error = refusal(own, WOBBLE.replace(old, new, 1))
    check_reason(error, code, **values)
    assert error.line == line


@pytest.mark.parametrize(
    ("old", "new", "line", "code", "values"),
    [
        ("min_tension_N", "least_tension", 18, "metric_not_measured", {"metric": "least_tension", "measures": "steps"}),
        ("above: 4.0", "above: 4.0, below: 5.0", 18, "not_exactly_one_bound", {}),
        ("above: 4.0", "above: F_least", 18, "unknown_name", {"name": "F_least", "known": TextWith("^depth, u_max,")}),
        ("measures: [steps]", "measures: [songs]", 16, "invalid_value", {"reason": TextWith("'steps', 'compliance'")}),
        ("name: wobble", "name: tracking", 2, "name_of_ready_made_experiment", {"name": "tracking"}),
    ],
)
def test_criteria_measures_and_referenced_names_are_checked(
    own: OwnExperiments, old: str, new: str, line: int, code: str, values: dict[str, object]
) -> None:
    error = refusal(own, WOBBLE.replace(old, new, 1))
    check_reason(error, code, **values)
    assert error.line == line


def test_an_unsafe_lambda_is_rejected_with_its_line(own: OwnExperiments) -> None:
    text = with_parts(LEAD_IN, "{do: tuning, lam_q: 0.1}", "{do: hold, duration_s: 5}")
    error = refusal(own, text)
    check_reason(error, "out_of_range", label="λ_q", value=0.1, unit="s", remedy=Reason("remedy_for_lambda"))
    assert error.line == 9


@pytest.mark.parametrize(
    "part", ["{do: step, q_ref: 0.9, duration_s: 1}", SWING, "{do: ramp, q_ref: -0.84, duration_s: 1}"]
)
def test_a_reference_beyond_the_range_of_the_plant_is_rejected_with_its_line(own: OwnExperiments, part: str) -> None:
    lab = load_parameters("lab")
    short = replace(lab, geometry=replace(lab.geometry, q_max=1.0))
    text = with_parts(LEAD_IN, "{do: step, q_ref: -0.6, duration_s: 2}", part)
    assert own.check(text, lab, TuningSettings()).segments == 3
    with refused_because(ExperimentError, "out_of_range", quantity="q_ref", **BOUNDS_OF_SHORT) as caught:
        own.check(text, short, TuningSettings())
    assert caught.value.line == 10


def test_an_oscillation_after_a_sine_is_checked_around_the_end_of_the_sine(own: OwnExperiments) -> None:
    lab = load_parameters("lab")
    short = replace(lab, geometry=replace(lab.geometry, q_max=1.0))
    text = with_parts(LEAD_IN, AWAY, "{do: sine, q_amplitude: 0.6, period_s: 4, duration_s: 4}")
    value = pytest.approx(-1.0)
    with refused_because(ExperimentError, "out_of_range", quantity="q_ref", value=value, **BOUNDS_OF_SHORT) as caught:
        own.check(text, short, TuningSettings())
    assert caught.value.line == 10


def test_an_unknown_bank_is_rejected_with_its_line(own: OwnExperiments) -> None:
    error = refusal(own, with_parts(LEAD_IN, "{do: tuning, bank: 77}", "{do: hold, duration_s: 5}"))
    assert error.line == 9
    assert "77" in str(error)


@pytest.mark.parametrize("text", ["", "[]", "17", "just words", "x" * 100_001, "\x00", "- a\n- b", "a: &x [*x]"])
def test_a_text_that_is_not_an_experiment_is_rejected_with_a_message(own: OwnExperiments, text: str) -> None:
    assert str(refusal(own, text))


def test_a_rejection_names_the_violated_rule(own: OwnExperiments) -> None:
    rules = "rules:\n  - {that: depth>0.3, remedy: swing further}\n"
    error = refusal(own, WOBBLE.replace("phases:", f"{rules}phases:", 1))
    broken = {
        "rule": "depth>0.3",
        "values": messages.value_of_setting(name="depth", value=0.2),
        "remedy": "swing further",
    }
    check_reason(error, "rule_not_satisfied", **broken)
    assert error.line == 7


def test_a_rejected_experiment_is_not_stored(own: OwnExperiments, tmp_path: Path) -> None:
    with pytest.raises(ExperimentError):
        own.check_and_store(
            with_parts("{do: hold, duration_s: -1}"), "A. Operator", load_parameters("lab"), TuningSettings()
        )
    assert own.list_own() == []


@pytest.mark.parametrize(
    "part",
    [
        "{do: sine, q_ref: 0.1, period_s: 1, duration_s: 1}",
        "{do: sine, q_amplitude: 0.1, S_ref: 10, period_s: 1, duration_s: 1}",
        "{do: multisine, q_amplitude: 0.1, period_s: 2, lines: 4}",
    ],
)
def test_an_oscillation_without_a_known_centre_is_rejected(own: OwnExperiments, part: str) -> None:
    error = refusal(own, with_parts(part, LEAD_IN))
    check_reason(error, "no_centre")
    assert (error.line, error.path) == (8, ("phases", 0, "parts", 0))
    crest = "{do: sine, q_ref: 0.1, S_ref: 10, period_s: 1, duration_s: 1}"
    assert own.check(with_parts(crest, LEAD_IN), load_parameters("lab"), TuningSettings()).segments == 2
    check_reason(refusal(own, with_parts(crest, part, LEAD_IN)), "no_centre")


@pytest.mark.parametrize("measure", ["compliance", "disturbance", "pushes"])
def test_a_measure_from_rest_rejects_a_push_during_a_motion(own: OwnExperiments, measure: str) -> None:
    parts, more = (LEAD_IN, "{do: step, q_ref: 0.1, duration_s: 1, F_push: 2}"), f"measures: [steps, {measure}]\n"
    error = refusal(own, with_parts(*parts, more=more))
    check_reason(error, "push_during_motion", measure=measure)
    assert (error.line, error.path) == (9, (*SECOND, "F_push"))
    assert own.check(with_parts(*parts), load_parameters("lab"), TuningSettings()).segments == 2
