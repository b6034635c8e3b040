"""Every path for texts rejects the same characters; output escapes them."""

import csv
import json
from collections.abc import Callable
from typing import Any

import pytest

from backend.banks.builder import BankError, parse_bank_file, require_name
from backend.errors import RequestRejectedError
from backend.experiments import parser
from backend.experiments.parser import ExperimentError
from backend.exports.base import read_strict
from backend.plain_text import (
    STORED_CONTEXT,
    PlainTextError,
    check_plain_text,
    check_plain_texts,
    check_single_line,
    escape_json_for_csv,
    escape_line,
    escape_lines,
    format_csv_cell,
    format_csv_comment,
    format_json,
    make_file_name,
)
from backend.schemas.identification import SpringTableRequest
from backend.schemas.preferences import ChartLayout
from backend.schemas.session import NameRequest, SignIn
from backend.schemas.tuning import BankFile, BankRequest
from backend.server.security import require_valid_body
from backend.storage.identifications import UnfitDocumentError, require_lines
from backend.studies.design import STUDY
from tests.refusals import refused

PARTS = [{"name": "a", "title": "A", "parts": [{"do": "hold", "duration_s": 1}]}]
REFUSED = ("\0", "\x07", "\x08", "\x0b", "\x0c", "\x1b", "\x7f", "\x85", "\x9b", "\ud800", "\udfff", "\ude00\ud83d")
ACCEPTED = ("", "\t", "\n", "\r\n", "\xa0", "λ_q′", "漢", "😀", "\u202f")


def experiment(title: str) -> dict[str, Any]:
    return {"format": 1, "name": "a", "title": title, "description": "", "phases": PARTS}


def experiment_with_description(description: str) -> dict[str, Any]:
    return {**experiment("x"), "description": description}


def as_yaml(title: str = "", description: str = "") -> str:
    escaped = ["".join(f"\\U{ord(letter):08x}" for letter in words) for words in (title, description)]
    keys = f'title: "x{escaped[0]}y"\ndescription: "x{escaped[1]}y"'
    return f"format: 1\nname: a\n{keys}\nphases: {json.dumps(PARTS)}\n"


PATHS: dict[str, tuple[type[Exception], Callable[[str], object]]] = {
    "a text": (PlainTextError, check_plain_text),
    "a key": (PlainTextError, lambda words: check_plain_texts([{"a": {words: 1}}])),
    "a request": (RequestRejectedError, lambda words: require_valid_body(json.dumps({"note": words}).encode())),
    "YAML": (ExperimentError, lambda words: parser.parse_experiment(as_yaml(description=words))),
    "JSON as a text": (
        ExperimentError,
        lambda words: parser.parse_experiment(json.dumps(experiment_with_description(f"x{words}y"))),
    ),
    "an import": (ValueError, lambda words: read_strict(json.dumps({"run": [{"note": words}]}))),
    "an experiment in an import": (
        ValueError,
        lambda words: read_strict(json.dumps({"plan": {"experiment": json.dumps(experiment(words))}})),
    ),
    "a bank file": (BankError, lambda words: parse_bank_file(json.dumps({"name": words}))),
}
LINES_REFUSED = (*REFUSED, "\t", "\n", "\r", "\u2028", "\u202e", "\u2066", "\u200f", "\u200b", "\ufeff", "\u00ad")
LINES_ACCEPTED = ("λ_q′", "漢字", "x😀y", "1\u202f000", "می\u200cخواهم", "👩\u200d🔧", "❤\ufe0f")
SETTING = {"name": "b", "symbol": "b", "meaning": "b", "default": 1, "minimum": 0, "maximum": 2}


def with_setting(**parts: Any) -> str:
    return json.dumps({**experiment("x"), "settings": [{**SETTING, **parts}]})


LINES: dict[str, tuple[type[Exception], Callable[[str], object]]] = {
    "a line": (PlainTextError, check_single_line),
    "a title in YAML": (ExperimentError, lambda words: parser.parse_experiment(as_yaml(words))),
    "a title in JSON": (ExperimentError, lambda words: parser.parse_experiment(json.dumps(experiment(words)))),
    "a phase": (
        ExperimentError,
        lambda words: parser.parse_experiment(
            json.dumps({**experiment("x"), "phases": [{**PARTS[0], "title": words}]})
        ),
    ),
    "a symbol": (ExperimentError, lambda words: parser.parse_experiment(with_setting(symbol=words))),
    "a unit": (ExperimentError, lambda words: parser.parse_experiment(with_setting(unit=words))),
    "a meaning": (ExperimentError, lambda words: parser.parse_experiment(with_setting(meaning=words))),
    "a choice": (
        ExperimentError,
        lambda words: parser.parse_experiment(with_setting(kind="choice", choices=[words], default=words)),
    ),
    "a remedy": (
        ExperimentError,
        lambda words: parser.parse_experiment(
            json.dumps({**experiment("x"), "rules": [{"that": "1 < 2", "remedy": words}]})
        ),
    ),
    "the title of a study": (
        ValueError,
        lambda words: STUDY.validate_json(json.dumps({"format": 1, "name": "a", "title": words})),
    ),
    "the name of a bank": (BankError, require_name),
    "a bank that is asked for": (ValueError, lambda words: BankRequest(name=words, identifications=[1])),
    "a bank that is sent": (
        ValueError,
        lambda words: BankFile.model_validate(
            {"name": words, "entries": [{"S_nominal": 9, "K_q": 1, "T_q": 1, "K_S": 1, "T_S": 1}]}
        ),
    ),
    "a person": (ValueError, lambda words: NameRequest(name=words)),
    "a person who signs in": (ValueError, lambda words: SignIn(token="t", name=words)),
    "a spring table": (ValueError, lambda words: SpringTableRequest(name=words, table="")),
    "a layout": (
        ValueError,
        lambda words: ChartLayout.model_validate(
            {"version": 1, "name": words, "panels": [{"title": "a", "signals": [], "over": None, "share": 1.0}]}
        ),
    ),
    "a record of an import": (
        UnfitDocumentError,
        lambda words: require_lines({"figures": [{"label": words, "value": 1.0}]}),
    ),
    "a key of an import": (UnfitDocumentError, lambda words: require_lines({"a": {words: 1.0}})),
}


@pytest.mark.parametrize("path", LINES)
@pytest.mark.parametrize("words", LINES_REFUSED, ids=ascii)
def test_single_line_texts_with_invisible_characters_are_rejected(path: str, words: str) -> None:
    kind, accept = LINES[path]
    with pytest.raises(kind):
        accept(f"x{words}y")


@pytest.mark.parametrize("path", [path for path in LINES if path != "a title in YAML"])
@pytest.mark.parametrize("words", [" ", "   ", "\xa0", "\u3000 "], ids=ascii)
def test_blank_single_line_texts_are_rejected(path: str, words: str) -> None:
    kind, accept = LINES[path]
    with pytest.raises(kind):
        accept(words)


@pytest.mark.parametrize("path", LINES)
@pytest.mark.parametrize("words", LINES_ACCEPTED, ids=ascii)
def test_single_line_texts_in_any_language_are_accepted(path: str, words: str) -> None:
    LINES[path][1](words)


@pytest.mark.parametrize("words", [*LINES_REFUSED, " "], ids=ascii)
def test_titles_stored_by_earlier_versions_are_read_with_escapes(words: str) -> None:
    title = f"x{words}y" if words.strip() else words
    read = parser.parse_canonical(json.dumps(experiment(title)))
    assert read.title == escape_line(title)
    assert read.title.isprintable()
    assert parser.parse_experiment(json.dumps(experiment(title)), stored=True)[0].title == escape_line(title)
    assert STUDY.validate_json(
        json.dumps({"format": 1, "name": "a", "title": escape_line(title)}), context=STORED_CONTEXT
    ).title == escape_line(title)
    assert parser.parse_canonical(parser.to_canonical_text(read)) == read


def test_control_characters_are_escaped_for_the_terminal() -> None:
    assert escape_line("a\x1b[2J\u202eb\n\ud800\U000e0041") == "a\\x1b[2J\\u202eb\\x0a\\ud800\\U000e0041"
    assert escape_lines("a\n\tb\r\x9b") == "a\n\tb\\x0d\\x9b"
    document = {"a\x9b": ["\u202e", "\ud800", "λ", 1.5], "\U000e0041": None}
    assert json.loads(format_json(document, indent=2)) == document
    assert escape_lines(format_json(document, indent=2)) == format_json(document, indent=2)


FORMULAS = ("=1", "+1+1", "-1+1", "@SUM(1)", "=HYPERLINK(1)", "\t=1", " =1", "\r=1", "\n@a", "＝1", "-1|a!b", "+a")


@pytest.mark.parametrize("formula", FORMULAS, ids=ascii)
def test_csv_cells_contain_no_formulas(formula: str) -> None:
    cell = format_csv_cell(formula)
    assert cell == f"'{escape_line(formula)}"
    for cut in (",", ";"):
        line = format_csv_comment(f"run 1: a{cut}{formula}{cut}b, c")
        assert not any(part.startswith(("=", "+", "-", "@", "＝")) for part in line.split(cut))
        document = {"note": f"a{cut}{formula}", "b": [formula, -1.5, -1], formula: f'{cut}{formula}"{cut}{formula}'}
        written = escape_json_for_csv(json.dumps(document, ensure_ascii=False))
        assert json.loads(written) == document
        for quoted in (False, True):
            row = next(csv.reader([written], delimiter=cut)) if quoted else written.split(cut)
            cells = [part.strip().strip('"') for part in row]
            assert not any(part.startswith(("=", "+", "@", "＝")) for part in cells)
            assert all(_is_number(part) for part in (one.rstrip("]}") for one in cells) if part.startswith("-"))


def _is_number(words: str) -> bool:
    try:
        float(words)
    except ValueError:
        return False
    return True


@pytest.mark.parametrize("value", ["-5", "+1e-3", "a=b", "λ_q′", "1 - 2", "", None, -5, -0.1, True])
def test_numbers_and_plain_texts_are_written_to_cells_unchanged(value: Any) -> None:
    assert format_csv_cell(value) == ("" if value is None else repr(value) if isinstance(value, float) else value)


def test_file_names_contain_no_path_and_no_invisible_characters() -> None:
    assert make_file_name("../../etc/passwd") == "etc-passwd"
    assert make_file_name('.a"\r\nb: c') == "a-x0d-x0ab-c"
    assert make_file_name("sinew-run-12.csv") == "sinew-run-12.csv"
    assert make_file_name("\u202e") == "u202e"
    assert make_file_name("..") == "file"


@pytest.mark.parametrize("path", PATHS)
@pytest.mark.parametrize("words", REFUSED, ids=ascii)
def test_texts_with_control_characters_are_rejected(path: str, words: str) -> None:
    kind, accept = PATHS[path]
    with pytest.raises(kind) as refused:
        accept(words)
    if "\ud800" not in words or path != "a request":  # the JSON itself is invalid
        assert any(f"U+{ord(letter):04X}" in str(refused.value) for letter in words) or "JSON" in str(refused.value)


@pytest.mark.parametrize("path", PATHS)
@pytest.mark.parametrize("words", ACCEPTED, ids=ascii)
def test_texts_in_any_language_are_accepted(path: str, words: str) -> None:
    PATHS[path][1](words)


def test_json_surrogate_pairs_are_accepted() -> None:
    written = json.dumps(experiment("😀"))
    assert "\\ud83d\\ude00" in written
    assert parser.parse_experiment(written)[0].title == "😀"


def test_escapes_outside_unicode_are_rejected() -> None:
    with pytest.raises(ExperimentError):
        parser.parse_experiment('title: "\\Uffffffff"')


def test_a_rejected_character_is_reported_with_its_position() -> None:
    with refused(PlainTextError, "character_not_allowed", text="ab\x07", position=2, description="a control character"):
        check_plain_text("ab\x07")
    with refused(PlainTextError, "character_not_allowed_in_line", position=1):
        check_single_line("a\u202eb")
    with refused(PlainTextError, "text_is_blank", text=" "):
        check_single_line(" ")


def test_a_rejected_character_is_reported_with_line_and_field() -> None:
    with pytest.raises(ExperimentError) as refused:
        parser.parse_experiment(as_yaml("\0"))
    assert refused.value.line == 3
    assert refused.value.path == ("title",)
