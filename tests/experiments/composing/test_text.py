"""Parsing and serialization of experiments, with the lines of their parts."""

import json
from contextlib import suppress

import pytest
from hypothesis import given
from hypothesis import strategies as st

from backend.experiments import parser
from backend.experiments.library import READY_NAMES, load_ready_text
from backend.experiments.parser import (
    MAX_CHARACTERS,
    ExperimentError,
    build_experiment,
    find_line,
    format_path,
    parse_canonical,
    parse_experiment,
    to_canonical_text,
)
from backend.experiments.schema import EXPERIMENT, Experiment, Hold, Section, Step
from backend.plain_text import escape_line

SMALL = """\
# a comment
format: 1
name: small
title: Small
phases:
  - name: only
    title: Only
    parts:
      - do: hold
        duration_s: 2.0
      - {do: step,
         q_ref: 0.1, duration_s: 1e1}
"""


def of(*parts: Hold | Step, title: str = "Small") -> Experiment:
    return Experiment(
        format=1, name="small", title=title, phases=(Section(name="only", title="Only", parts=tuple(parts)),)
    )


EXPECTED = of(Hold(do="hold", duration_s=2.0), Step(do="step", q_ref=0.1, duration_s=10.0))


def test_each_part_is_read_with_its_line() -> None:
    experiment, lines = parse_experiment(SMALL)
    assert experiment == EXPECTED
    assert lines["format",] == 2
    assert lines["phases", 0, "parts", 0] == 9
    assert lines["phases", 0, "parts", 0, "duration_s"] == 10
    assert lines["phases", 0, "parts", 1, "do"] == 11
    assert lines["phases", 0, "parts", 1, "q_ref"] == 12


def test_a_place_that_has_no_line_has_that_of_what_it_lies_in() -> None:
    _, lines = parse_experiment(SMALL)
    assert find_line(("phases", 0, "parts", 1, "S_ref"), lines) == 11
    assert find_line(("phases", 0, "parts", 7), lines) == 8
    assert find_line(("phases", 0), {}) is None
    assert format_path(("phases", 0, "parts", 1, "q_ref")) == "phases 1, parts 2, q_ref"
    assert format_path(()) == "experiment"


def test_json_is_read_as_yaml_is() -> None:
    document = EXPERIMENT.dump_python(EXPECTED, mode="json")
    for text in (json.dumps(document), json.dumps(document, indent=2)):
        assert parse_experiment(text)[0] == EXPECTED
    assert build_experiment(document, {}) == EXPECTED


@pytest.mark.parametrize("line_end", ["\n", "\r\n"])
def test_line_ends_of_other_machines_count_alike(line_end: str) -> None:
    _, lines = parse_experiment(SMALL.replace("\n", line_end))
    assert lines["phases", 0, "parts", 1, "q_ref"] == 12


@pytest.mark.parametrize("word", ["no", "yes", "on", "off", "1:30", "0x1f", "1_000", "2001-01-01", "12", "true", "~"])
def test_words_that_look_like_something_else_stay_words(word: str) -> None:
    experiment = of(Hold(do="hold", duration_s=1.0), title=word)
    assert parse_canonical(to_canonical_text(experiment)) == experiment
    assert parse_experiment(json.dumps(json.loads(to_canonical_text(experiment))))[0] == experiment


@pytest.mark.parametrize("word", ["no", "on", "1:30", "0x1f", "1_000", "2001-01-01"])
def test_a_plain_word_is_no_number_and_no_truth(word: str) -> None:
    assert parse_experiment(SMALL.replace("title: Small", f"title: {word}"))[0].title == word


@given(
    st.text(st.characters(codec="utf-8", exclude_categories=("Cc", "Cf", "Cn", "Cs")), min_size=1, max_size=100).filter(
        lambda title: escape_line(title) == title and title.strip() != ""
    )
)
def test_a_title_is_the_same_in_the_text_stored_with_a_run(title: str) -> None:
    experiment = of(Hold(do="hold", duration_s=1.0), title=title)
    assert parse_canonical(to_canonical_text(experiment)) == experiment


@pytest.mark.parametrize("line", ["", "[]", "{", "[" * 100_000, '{"format": 1}'])
def test_what_is_no_such_text_is_refused_in_a_sentence(line: str) -> None:
    with pytest.raises(ExperimentError):
        parse_canonical(line)


@pytest.mark.parametrize("value", ["!!int abc", "!!float abc", "!!int '5'", "!!str 5", "! 5"])
def test_no_tag_is_taken(value: str) -> None:
    with pytest.raises(ExperimentError, match=r"the tag .* is not taken") as refused:
        parse_experiment(SMALL.replace("duration_s: 2.0", f"duration_s: {value}"))
    assert refused.value.line == 10


def test_equal_experiments_have_equal_texts() -> None:
    other = parse_experiment(SMALL.replace("1e1", "10.0").replace("# a comment", "# another"))[0]
    assert to_canonical_text(other) == to_canonical_text(EXPECTED)
    assert to_canonical_text(of(Hold(do="hold", duration_s=3.0))) != to_canonical_text(EXPECTED)
    assert "\n" not in to_canonical_text(EXPECTED)


@pytest.mark.parametrize(
    ("old", "new", "line", "told"),
    [
        ("duration_s: 2.0", "duration_s: &a 2.0", 10, "anchors and aliases are not taken"),
        ("duration_s: 2.0", "duration_s: *a", 10, "anchors and aliases are not taken"),
        ("duration_s: 2.0", "duration_s: !!python/name:os.system x", 10, "is not taken"),
        ("duration_s: 2.0", "duration_s: !mine 2", 10, "is not taken"),
        ("duration_s: 2.0", "duration_s: !!timestamp 2001-01-01", 10, "is not taken"),
        ("duration_s: 2.0", "duration_s: !!binary aGk=", 10, "is not taken"),
        ("duration_s: 2.0", "duration_s: !!set {a}", 10, "is not taken"),
        ("duration_s: 2.0", "duration_s: 1e400", 10, "is not taken"),
        ("duration_s: 2.0", "duration_s: -1e400", 10, "is not taken"),
        ("duration_s: 2.0", "duration_s: 1234567890123456789", 10, "is not a number that can be meant"),
        ("duration_s: 2.0", "duration_s: 2.0\n        do: hold", 11, "phases 1, parts 1, do: it is said twice"),
        ("duration_s: 2.0", "duration_s: true", 10, "duration_s"),
        ("duration_s: 2.0", "duration_s: null", 10, "duration_s"),
        ("duration_s: 2.0", "duration_s: [2.0]", 10, "duration_s"),
        ("duration_s: 2.0", "duration_s: {a: 2.0}", 10, "duration_s"),
        ("duration_s: 2.0", "duration_s: " + "1+" * 100 + "1", 10, "duration_s"),
        ("duration_s: 2.0", "2: 2.0", 10, "the key 2 is not a text"),
        ("do: hold", "do: [", 11, "it is neither YAML nor JSON"),
        ("do: hold", "do: fly", 9, "'fly' is no motion; there are hold, step, ramp"),
        ("name: small", "name: small\nname: other", 4, "name: it is said twice"),
        ("format: 1", "format: 2", 2, "2 is not known: this Sinew reads format 1"),
        ("format: 1", "format: one", 2, "'one' is not known"),
        ("title: Small", f"title: {'x' * 101}", 4, "title"),
        ("title: Small", "title: Small\n---\nname: other", 5, "it is neither YAML nor JSON"),
    ],
)
def test_an_unsupported_construct_is_rejected_with_its_line(old: str, new: str, line: int, told: str) -> None:
    assert SMALL.count(old) == 1
    with pytest.raises(ExperimentError) as refused:
        parse_experiment(SMALL.replace(old, new))
    assert told in str(refused.value)
    assert refused.value.line == line
    assert str(refused.value).startswith(f"line {line}: ")


@pytest.mark.parametrize("least", [MAX_CHARACTERS + 1, 1_000_000])
def test_a_text_that_is_too_long_is_not_parsed(least: int, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delattr(parser, "_Loader")
    with pytest.raises(ExperimentError, match=f"it has {least} characters, at most {MAX_CHARACTERS} are taken"):
        parse_experiment(SMALL + "#" * (least - len(SMALL)))


def test_the_longest_text_that_is_taken_is_read() -> None:
    assert parse_experiment(SMALL + "#" * (MAX_CHARACTERS - len(SMALL)))[0] == EXPECTED


@pytest.mark.parametrize("nest", ["[", "{a: ", "- ", "? "])
@pytest.mark.parametrize("deep", [42, 200, 20_000])
def test_a_text_that_is_nested_too_deep_is_refused(nest: str, deep: int) -> None:
    closing = {"[": "]", "{a: ": "}"}.get(nest, "")
    with pytest.raises(ExperimentError):
        parse_experiment(nest * deep + "1" + closing * deep)


@given(st.text(max_size=300))
def test_any_text_is_refused_in_a_sentence(text: str) -> None:
    with pytest.raises(ExperimentError) as refused:
        parse_experiment(text)
    assert str(refused.value)


@given(st.sampled_from(READY_NAMES), st.integers(0, 2000), st.text(max_size=4))
def test_a_slip_of_the_hand_is_an_experiment_or_refused(name: str, at: int, typed: str) -> None:
    text = load_ready_text(name)
    with suppress(ExperimentError):
        assert isinstance(parse_experiment(text[:at] + typed + text[at + len(typed) :])[0], Experiment)
