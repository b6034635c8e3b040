"""The JSON schema of an experiment accepts the same documents as the parser."""

from typing import Any

import pytest
import yaml
from jsonschema_rs import Draft202012Validator

from backend.experiments.library import READY_NAMES, load_ready_experiment, load_ready_text
from backend.experiments.parser import ExperimentError, build_experiment
from backend.experiments.schema import EXPERIMENT, build_json_schema

VALIDATOR = Draft202012Validator(build_json_schema())


def document(name: str = "compliance") -> dict[str, Any]:
    written: dict[str, Any] = EXPERIMENT.dump_python(load_ready_experiment(name)[0], mode="json", exclude_defaults=True)
    return written


@pytest.mark.parametrize("name", READY_NAMES)
def test_the_ready_made_ones_are_taken(name: str) -> None:
    for taken in (document(name), yaml.safe_load(load_ready_text(name))):
        assert [error.message for error in VALIDATOR.iter_errors(taken)] == []


@pytest.mark.parametrize(
    "change",
    [
        {"format": 2},
        {"format": "1"},
        {"name": "2nd try"},
        {"name": "x" * 41},
        {"name": 3},
        {"title": ""},
        {"title": "x" * 101},
        {"description": "x" * 1001},
        {"phases": []},
        {"phases": "none"},
        {"phases": [{"name": "a", "title": "A", "parts": []}]},
        {"phases": [{"name": "a", "title": "A", "parts": [{"do": "fly", "duration_s": 1}]}]},
        {"phases": [{"name": "a", "title": "A", "parts": [{"do": "hold"}]}]},
        {"phases": [{"name": "a", "title": "A", "parts": [{"do": "hold", "duration_s": "1+" * 100 + "1"}]}]},
        {"phases": [{"name": "a", "title": "A", "parts": [{"do": "repeat", "times": 2, "parts": []}]}]},
        {
            "phases": [
                {"name": "a", "title": "A", "parts": [{"do": "push", "F_push": 1, "duration_s": 1, "shape": "x"}]}
            ]
        },
        {"measures": ["songs"]},
        {"criteria": [{"figure": "min tension"}]},
        {"settings": [{"name": "a", "symbol": "a", "meaning": "a", "default": 1, "kind": "colour"}]},
        {"colour": "red"},
    ],
)
def test_what_is_no_experiment_is_refused_by_schema_and_reader_alike(change: dict[str, Any]) -> None:
    wrong = document() | change
    assert not VALIDATOR.is_valid(wrong)
    with pytest.raises(ExperimentError):
        build_experiment(wrong, {})


@pytest.mark.parametrize("lacking", ["format", "name", "title", "phases"])
def test_what_lacks_a_part_is_refused_by_schema_and_reader_alike(lacking: str) -> None:
    wrong = {name: value for name, value in ({"format": 1} | document()).items() if name != lacking}
    assert not VALIDATOR.is_valid(wrong)
    with pytest.raises(ExperimentError):
        build_experiment(wrong, {})
