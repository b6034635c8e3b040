"""Invalid experiments are rejected before any motion, with line and bound."""

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import pytest

from backend.banks.tuning_settings import TuningSettings
from backend.experiments.parser import ExperimentError
from backend.services.library import OwnExperiments
from backend.storage.database import open_database
from plant.parameters import load_parameters
from tests.experiments.composing.written import WOBBLE, with_parts

LEAD_IN = "{do: step, q_ref: 0.0, S_ref: 10.0, duration_s: 6.0}"
NESTED = "{do: repeat, times: 1000, parts: [" * 3 + "{do: hold, duration_s: 1}" + "]}" * 3
DEEP = "{do: repeat, times: 1, parts: [" * 30 + "{do: hold, duration_s: 1}" + "]}" * 30
EMPTY = "{do: repeat, times: 1000, parts: [" * 3 + "]}" * 3
SWING = "{do: sine, q_amplitude: 0.25, period_s: 1, duration_s: 1}"
AWAY = "{do: sine, q_amplitude: -0.4, period_s: 4, duration_s: 1}"
TUNINGS = "{do: repeat, times: 1000, parts: [{do: repeat, times: 1000, parts: [{do: tuning, b: 0.5}]}]}"

LEARN = "{do: learn, duration_s: 2}"
FELT = "{{do: until_contact, contact_N: {}, parts: [{{do: hold, duration_s: 2}}]}}"
STIFFER = "{do: step, S_ref: 12, duration_s: 1}"
TWICE = f"{{do: until_contact, contact_N: 2, parts: [{FELT.format(2)}]}}"


@pytest.fixture(scope="module")
def own(tmp_path_factory: pytest.TempPathFactory) -> Iterator[OwnExperiments]:
    database = open_database(tmp_path_factory.mktemp("own"))
    yield OwnExperiments(database)
    database.close()


def refusal(own: OwnExperiments, text: str) -> ExperimentError:
    with pytest.raises(ExperimentError) as refused:
        own.check(text, load_parameters("lab"), TuningSettings())
    return refused.value


def test_what_is_refused_below_would_be_taken_but_for_one_thing(own: OwnExperiments) -> None:
    checked = own.check(with_parts(LEAD_IN, "{do: hold, duration_s: 1}"), load_parameters("lab"), TuningSettings())
    assert (checked.duration_s, checked.segments) == (7.0, 2)


@pytest.mark.parametrize(
    ("part", "told"),
    [
        (
            "{do: step, q_ref: 1.5, duration_s: 1}",
            "phases 1, parts 2, q_ref: position reference: 1.5\u202frad is outside",
        ),
        ("{do: step, S_ref: 16, duration_s: 1}", "stiffness reference: 16 N·m/rad is outside 8 to 15 N·m/rad"),
        ("{do: sine, q_amplitude: 1.45, period_s: 1, duration_s: 1}", "1.45\u202frad is outside"),
        ("{do: sine, S_amplitude: 3, period_s: 1, duration_s: 1}", "3 N·m/rad is outside -2 to 2 N·m/rad"),
        (
            "{do: sine, q_amplitude: 0.1, q_ref: 0.1, period_s: 1, duration_s: 1}",
            "q_amplitude: amplitude and reference both define the crest: remove one of them",
        ),
        ("{do: sine, q_ref: 1.5, period_s: 1, duration_s: 1}", "q_ref: position reference: 1.5\u202frad is outside"),
        ("{do: ramp, q_ref: 0.1, duration_s: 1, F_push: 31}", "31 N is outside -30 to 30 N"),
        ("{do: hold, duration_s: -1}", "duration_s: time: -1 s is outside 0.01 to 600 s"),
        ("{do: hold, duration_s: 601}", "601 s is outside 0.01 to 600 s"),
        ("{do: hold}", "duration_s: it is missing"),
        ("{do: hold, duration_s: 1, q_ref: 1}", "q_ref: this key is not allowed here"),
        ("{do: dance, duration_s: 1}", "'dance' is not a kind of part; choose one of hold, step"),
        ("{duration_s: 1}", "a part needs `do`, which names its kind"),
        ("{do: hold, duration_s: .nan}", "'.nan' is not an expression"),
        ("{do: hold, duration_s: 1e999}", "is not supported"),
        ("{do: hold, duration_s: unknown}", "'unknown' is not known here; choose one of pi"),
        ("{do: hold, duration_s: 1 / 0}", "has no value"),
        ("{do: hold, duration_s: 2 ** 1e9}", "has no value"),
        ("{do: hold, duration_s: \"__import__('os').system('true')\"}", "is not supported; supported are + - * / % **"),
        ("{do: hold, duration_s: 'pi.real'}", "is not supported"),
        ("{do: hold, duration_s: '[1][0]'}", "is not supported"),
        ("{do: hold, duration_s: \"'1'\"}", "which is not a finite number"),
        ("{do: tuning, lam_q: 0.1}", "no motion follows this change of the tuning"),
        ("{do: learn}", "no motion follows this calibration"),
        ("{do: learn, duration_s: 1}", "duration of the calibration at rest: 1 s is outside 2 to 600 s"),
        (FELT.format(1.5), "the bias of the external force is not calibrated before this part"),
        (
            f"{{do: repeat, times: 1, parts: [{LEARN}, {FELT.format(0.5)}]}}",
            "contact threshold (0 for none): 0.5 N is outside 1 to 30 N",
        ),
        (
            f"{{do: repeat, times: 1, parts: [{LEARN}, {FELT.format(31)}]}}",
            "contact threshold: 31 N is outside 0 to 30 N",
        ),
        (
            f"{{do: repeat, times: 1, parts: [{LEARN}, {STIFFER}, {FELT.format(1.5)}]}}",
            "at 12 N·m/rad the bias of the external force is not calibrated, only at 10",
        ),
        (
            f"{{do: repeat, times: 1, parts: [{LEARN}, {FELT.replace('{do: hold', '{do: learn').format(2)}]}}",
            "cannot contain a part `do: learn`",
        ),
        (
            f"{{do: repeat, times: 1, parts: [{LEARN}, {TWICE}]}}",
            "parts that a contact ends cannot contain such parts again",
        ),
        ("{do: repeat, times: 1000000000, parts: [{do: hold, duration_s: 1}]}", "1·10⁹ is outside 1 to 1000"),
        ("{do: repeat, times: 2.5, parts: [{do: hold, duration_s: 1}]}", "2.5 is not a whole number"),
        (NESTED, "exceeds 1000, including repetitions"),
        (EMPTY, "it is empty: add at least one item"),
        (TUNINGS, "changes of the tuning are the maximum"),
        (DEEP, "it is nested deeper than 40 times"),
        (
            "{do: repeat, times: 100, parts: [{do: hold, duration_s: 60}]}",
            "total duration up to this part: 3606 s is more",
        ),
        ("{do: prbs, q_amplitude: 0.1, chip_s: 0.1, bits: 13}", "bits: 13 is outside 4 to 12"),
        ("{do: multisine, q_amplitude: 0.1, period_s: 0.2, lines: 20}", "highest frequency: 100 Hz is more than 50 Hz"),
        ("{do: sweep, q_amplitude: 0.1, from_Hz: 0, to_Hz: 1, duration_s: 5}", "from_Hz: 0 Hz is outside"),
        ("{do: push, F_push: 31, duration_s: 1}", "push: 31 N is outside -30 to 30 N"),
        ("{do: load, load_A: -0.1, duration_s: 1}", "-0.1 N·m is outside 0 to 0.5 N·m"),
        ("{do: choose, by: nothing, of: {a: []}}", "'nothing' is not a setting with choices"),
        ("&loop {do: hold, duration_s: 1}", "anchors and aliases are not supported"),
        ("*loop", "anchors and aliases are not supported"),
        ("!!python/object:os.system {do: hold}", "the tag tag:yaml.org,2002:python/object:os.system is not supported"),
        (
            "{do: repeat, index: pi, times: 2, parts: [{do: hold, duration_s: 1}]}",
            "'pi' is already in use",
        ),
        ("{do: hold, duration_s: 1, duration_s: 2}", "duration_s: the key is given twice"),
        ("{do: hold, duration_s: yes}", "'yes' is not known here"),
        ("{do: hold, duration_s: 123456789012345678901}", "has too many digits for a whole number"),
    ],
)
def test_a_part_that_cannot_be_played_is_refused_with_its_line(own: OwnExperiments, part: str, told: str) -> None:
    refused = refusal(own, with_parts(LEAD_IN, part))
    assert told in str(refused)
    assert str(refused).startswith("line 9: ")
    assert refused.line == 9


@pytest.mark.parametrize(
    ("old", "new", "line", "told"),
    [
        ("min_tension_N", "least_tension", 18, "'least_tension' is not a metric that this experiment measures (steps)"),
        ("above: 4.0", "above: 4.0, below: 5.0", 18, "a criterion needs exactly one bound: below or above"),
        ("above: 4.0", "above: F_least", 18, "'F_least' is not known here; choose one of depth, u_max"),
        ("measures: [steps]", "measures: [songs]", 16, "it should be 'steps', 'compliance'"),
        ("name: swing", "name: lead_in", 11, "another phase has this name"),
        ("name: wobble", "name: tracking", 2, "'tracking' is the name of a ready-made experiment"),
        ("name: wobble", "name: 2nd try", 2, "a name has letters, digits and _"),
        ("format: 1", "format: 2", 1, "2 is not a known format: this version of Sinew reads format 1"),
        (
            "name: depth",
            "name: lam_q",
            5,
            "'lam_q' is already the name of a tuning setting, of the seed or of another setting",
        ),
        ("default: 0.2", "default: 0.9", 5, "0.9\u202frad is outside 0.01 to 0.5\u202frad"),
        ("name: depth", "name: u_max", 5, "'u_max' is already the name"),
        ("name: depth,", "name: depth, kind: integer,", 5, "the default 0.2 is not a whole number"),
        ("maximum: 0.5}", "}", 5, "depth needs a minimum and a maximum"),
        ("title: Wobble", "title: Wobble\nlaw: magic", 4, "'magic' is not a control law; choose one of cascade"),
        ("title: Wobble", "title: [Wobble", 4, "it is neither YAML nor JSON"),
        ("title: Wobble", "titel: Wobble", 3, "this key is not allowed here"),
    ],
)
def test_keys_outside_the_parts_are_checked_too(own: OwnExperiments, old: str, new: str, line: int, told: str) -> None:
    assert old in WOBBLE
    refused = refusal(own, WOBBLE.replace(old, new, 1))
    assert told in str(refused)
    assert refused.line == line


def test_a_lambda_that_is_not_safe_is_refused_in_its_line(own: OwnExperiments) -> None:
    text = with_parts(LEAD_IN, "{do: tuning, lam_q: 0.1}", "{do: hold, duration_s: 5}")
    refused = refusal(own, text)
    assert refused.line == 9
    assert "λ_q: 0.1 s is outside" in str(refused)
    assert "sensitivity peak" in str(refused)


@pytest.mark.parametrize(
    "part", ["{do: step, q_ref: 0.9, duration_s: 1}", SWING, "{do: ramp, q_ref: -0.84, duration_s: 1}"]
)
def test_a_reference_that_this_plant_does_not_reach_is_refused_in_its_line(own: OwnExperiments, part: str) -> None:
    lab = load_parameters("lab")
    short = replace(lab, geometry=replace(lab.geometry, q_max=1.0))
    text = with_parts(LEAD_IN, "{do: step, q_ref: -0.6, duration_s: 2}", part)
    assert own.check(text, lab, TuningSettings()).segments == 3
    with pytest.raises(ExperimentError, match=r"position reference: .*\srad is outside -0.83 to 0.83\srad") as refused:
        own.check(text, short, TuningSettings())
    assert refused.value.line == 10


def test_where_a_sine_ends_counts_for_what_swings_around_it(own: OwnExperiments) -> None:
    lab = load_parameters("lab")
    short = replace(lab, geometry=replace(lab.geometry, q_max=1.0))
    text = with_parts(LEAD_IN, AWAY, "{do: sine, q_amplitude: 0.6, period_s: 4, duration_s: 4}")
    with pytest.raises(ExperimentError, match=r"-1\srad is outside -0.83 to 0.83\srad") as refused:
        own.check(text, short, TuningSettings())
    assert refused.value.line == 10


def test_a_bank_that_is_not_there_is_refused_in_its_line(own: OwnExperiments) -> None:
    refused = refusal(own, with_parts(LEAD_IN, "{do: tuning, bank: 77}", "{do: hold, duration_s: 5}"))
    assert refused.line == 9
    assert "77" in str(refused)


@pytest.mark.parametrize("text", ["", "[]", "17", "just words", "x" * 100_001, "\x00", "- a\n- b", "a: &x [*x]"])
def test_what_is_no_experiment_at_all_is_refused_in_a_sentence(own: OwnExperiments, text: str) -> None:
    assert str(refusal(own, text))


def test_a_violated_rule_is_named(own: OwnExperiments) -> None:
    rules = "rules:\n  - {that: depth>0.3, remedy: swing further}\n"
    refused = refusal(own, WOBBLE.replace("phases:", f"{rules}phases:", 1))
    assert refused.line == 7
    assert "depth>0.3 is not satisfied (depth is 0.2): swing further" in str(refused)


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
def test_nothing_oscillates_around_what_is_not_known(own: OwnExperiments, part: str) -> None:
    told = str(refusal(own, with_parts(part, LEAD_IN)))
    assert told == "line 8: phases 1, parts 1: the centre of the oscillation is not defined: begin with a step"
    crest = "{do: sine, q_ref: 0.1, S_ref: 10, period_s: 1, duration_s: 1}"
    assert own.check(with_parts(crest, LEAD_IN), load_parameters("lab"), TuningSettings()).segments == 2
    assert "the centre of the oscillation is not defined" in str(refusal(own, with_parts(crest, part, LEAD_IN)))


@pytest.mark.parametrize("measure", ["compliance", "disturbance", "pushes"])
def test_a_measure_from_rest_rejects_a_push_during_a_motion(own: OwnExperiments, measure: str) -> None:
    parts, more = (LEAD_IN, "{do: step, q_ref: 0.1, duration_s: 1, F_push: 2}"), f"measures: [steps, {measure}]\n"
    told = str(refusal(own, with_parts(*parts, more=more)))
    assert told == f"line 9: phases 1, parts 2, F_push: {measure} measures pushes from rest: use a part `do: push`"
    assert own.check(with_parts(*parts), load_parameters("lab"), TuningSettings()).segments == 2
