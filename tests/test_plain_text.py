"""A control character or half a character in a text is refused alike on every path that a text comes by."""

import json
from collections.abc import Callable
from typing import Any

import pytest

from backend.experiments.banks.bank_building import require_name
from backend.experiments.banks.bank_consistency import BankError
from backend.experiments.banks.bank_files import read_file
from backend.experiments.composing import text
from backend.experiments.composing.refused import ExperimentError
from backend.exports.strict_json import read_strict
from backend.plain_text import PlainTextError, require_plain, require_plain_texts
from backend.refusal import RefusalError
from backend.web_server.bodies import _require_writable

PARTS = [{"name": "a", "title": "A", "parts": [{"do": "hold", "duration_s": 1}]}]
REFUSED = ("\0", "\x07", "\x08", "\x0b", "\x0c", "\x1b", "\x7f", "\x85", "\x9b", "\ud800", "\udfff", "\ude00\ud83d")
TAKEN = ("", "\t", "\n", "\r\n", "\xa0", "λ_q′", "漢", "😀", "\u202f")


def experiment(title: str) -> dict[str, Any]:
    return {"format": 1, "name": "a", "title": title, "description": "", "phases": PARTS}


def as_yaml(title: str) -> str:
    escaped = "".join(f"\\U{ord(letter):08x}" for letter in title)
    return f'format: 1\nname: a\ntitle: "x{escaped}y"\ndescription: ""\nphases: {json.dumps(PARTS)}\n'


PATHS: dict[str, tuple[type[Exception], Callable[[str], object]]] = {
    "a text": (PlainTextError, require_plain),
    "a key": (PlainTextError, lambda words: require_plain_texts([{"a": {words: 1}}])),
    "a request": (RefusalError, lambda words: _require_writable(json.dumps({"note": words}).encode())),
    "YAML": (ExperimentError, lambda words: text.read(as_yaml(words))),
    "JSON as a text": (ExperimentError, lambda words: text.read(json.dumps(experiment(f"x{words}y")))),
    "a stored experiment": (ExperimentError, lambda words: text.of_canonical(json.dumps(experiment(f"x{words}y")))),
    "an import": (ValueError, lambda words: read_strict(json.dumps({"run": [{"note": words}]}))),
    "an experiment in an import": (
        ValueError,
        lambda words: read_strict(json.dumps({"plan": {"experiment": json.dumps(experiment(words))}})),
    ),
    "a bank file": (BankError, lambda words: read_file(json.dumps({"name": words}))),
    "the name of a bank": (BankError, lambda words: require_name(f"x{words}y")),
}


@pytest.mark.parametrize("path", PATHS)
@pytest.mark.parametrize("words", REFUSED, ids=ascii)
def test_what_is_no_plain_text_is_refused(path: str, words: str) -> None:
    kind, take = PATHS[path]
    with pytest.raises(kind) as refused:
        take(words)
    if "\ud800" not in words or path != "a request":  # its JSON itself is refused
        assert any(f"U+{ord(letter):04X}" in str(refused.value) for letter in words) or "JSON" in str(refused.value)


@pytest.mark.parametrize("path", PATHS)
@pytest.mark.parametrize("words", TAKEN, ids=ascii)
def test_lines_and_letters_of_any_language_are_taken(path: str, words: str) -> None:
    PATHS[path][1](words)


def test_json_may_write_a_character_as_a_pair_of_escapes() -> None:
    written = json.dumps(experiment("😀"))
    assert "\\ud83d\\ude00" in written
    assert text.read(written)[0].title == "😀"


def test_an_escape_beyond_all_characters_is_refused() -> None:
    with pytest.raises(ExperimentError):
        text.read('title: "\\Uffffffff"')


def test_a_refusal_says_where_the_character_stands() -> None:
    with pytest.raises(ExperimentError) as refused:
        text.read(as_yaml("\0"))
    assert refused.value.line == 3
    assert refused.value.path == ("title",)
