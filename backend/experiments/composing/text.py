"""An experiment as YAML or JSON: read with the line of each part, and written; a study is read so, too. Pure.

Only what JSON has too is taken: mappings with texts as keys, lists, texts, numbers, true, false, null. No anchors or
aliases, which could make a small text endless, and no tags.
"""

import json
import math
import re
from collections.abc import Mapping
from typing import Any, TypeVar

import yaml
from pydantic import TypeAdapter, ValidationError

from backend.documents.experiment import EXPERIMENT, FORMAT, Experiment
from backend.errors import Path
from backend.experiments.composing.refused import ExperimentError, Lines, line_of
from backend.plain_text import STORED, PlainTextError, as_stored, require_plain

MAX_CHARACTERS = 100_000
_DEEPEST = 40
_T = TypeVar("_T")


class _Loader(yaml.SafeLoader):  # type: ignore[misc]  # PyYAML comes without types
    """Composes nodes; numbers and words as YAML 1.2 and JSON have them: "no" is a text, 1e3 a number."""

    yaml_implicit_resolvers: dict[str, Any] = {}  # noqa: RUF012  # as its parent declares it

    def compose_node(self, parent: Any, index: Any) -> Any:
        if self.check_event(yaml.AliasEvent) or getattr(self.peek_event(), "anchor", None):
            line = self.peek_event().start_mark.line + 1
            raise ExperimentError("anchors and aliases are not taken: write it out, or use repeat", (), line)
        if (tag := getattr(self.peek_event(), "tag", None)) is not None:
            raise ExperimentError(f"the tag {tag} is not taken", (), self.peek_event().start_mark.line + 1)
        return super().compose_node(parent, index)


_Loader.add_implicit_resolver("tag:yaml.org,2002:null", re.compile(r"^(?:~|null|)$"), ["~", "n", ""])
_Loader.add_implicit_resolver("tag:yaml.org,2002:bool", re.compile(r"^(?:true|false)$"), ["t", "f"])
_Loader.add_implicit_resolver("tag:yaml.org,2002:int", re.compile(r"^[-+]?[0-9]+$"), list("-+0123456789"))
_Loader.add_implicit_resolver(
    "tag:yaml.org,2002:float",
    re.compile(r"^[-+]?(?:[0-9]+\.[0-9]*|\.[0-9]+|[0-9]+)(?:[eE][-+]?[0-9]+)?$"),
    list("-+.0123456789"),
)
_PLAIN = "tag:yaml.org,2002:"


def read(text: str, *, stored: bool = False) -> tuple[Experiment, Lines]:
    """Return the experiment that a text says, and the line of each of its parts; ``stored`` as for ``document_of``.

    Raises ExperimentError.
    """
    document, lines = document_of(text, stored=stored)
    return of_document(document, lines, stored=stored), lines


def document_of(text: str, *, stored: bool = False) -> tuple[Any, Lines]:
    """Return what a text says as plain data, and the line of each of its parts. Raises ExperimentError.

    A ``stored`` text is read as it was accepted: characters that are refused now are escapes in what is returned.
    """
    if len(text) > MAX_CHARACTERS:
        raise ExperimentError(f"it has {len(text)} characters, at most {MAX_CHARACTERS} are taken: shorten it")
    lines: dict[Path, int] = {}
    try:
        node = _Loader(text).get_single_node()
        document = None if node is None else _value(node, (), lines, 0, stored=stored)
        return as_stored(document) if stored else document, lines
    except yaml.MarkedYAMLError as error:
        mark = error.problem_mark or error.context_mark
        raise ExperimentError(f"it is neither YAML nor JSON: {error.problem}", (), mark and mark.line + 1) from None
    except ExperimentError:
        raise
    except (yaml.YAMLError, RecursionError, ValueError, OverflowError) as error:  # an escape beyond all characters
        raise ExperimentError(f"it is neither YAML nor JSON: {error}") from None


def of_document(document: Any, lines: Lines, *, stored: bool = False) -> Experiment:
    """Return the experiment that a document is; ``stored`` as for ``document_of``. Raises ExperimentError."""
    if not isinstance(document, Mapping):
        raise ExperimentError("an experiment is a mapping with format, name, title and phases", (), 1)
    return in_form(EXPERIMENT, FORMAT, document, lines, stored=stored)


def in_form(
    form: TypeAdapter[_T], known: int, document: Mapping[str, Any], lines: Lines, *, stored: bool = False
) -> _T:
    """Return what a document of the ``known`` format says. Raises ExperimentError naming the place."""
    if document.get("format") != known:
        why = f"{document.get('format')!r} is not known: this Sinew reads format {known}"
        raise ExperimentError(why, ("format",), line_of(("format",), lines))
    try:
        return form.validate_json(json.dumps(document), context=STORED if stored else None)
    except ValidationError as error:
        found = error.errors(include_url=False)
        # a word that is not known is what made another one missing
        first = next((one for one in found if one["type"] == _UNKNOWN), found[0])
        path = _place(document, first["loc"])
        raise ExperimentError(_told(first), path, line_of(path, lines)) from None


def of_canonical(line: str) -> Experiment:
    """Return the experiment that ``canonical`` has written and a run has kept. Raises ExperimentError."""
    try:
        return of_document(as_stored(json.loads(line)), {}, stored=True)
    except (ValueError, RecursionError) as error:
        if isinstance(error, ExperimentError):
            raise
        raise ExperimentError(f"it is not JSON: {error}") from None


def canonical(experiment: Experiment) -> str:
    """Return an experiment as one line of JSON: equal experiments, equal texts."""
    return EXPERIMENT.dump_json(experiment, exclude_defaults=True).decode()


def _value(node: Any, path: Path, lines: dict[Path, int], depth: int, *, stored: bool) -> Any:
    line = node.start_mark.line + 1
    lines.setdefault(path, line)
    if depth > _DEEPEST:
        raise ExperimentError(f"it is nested deeper than {_DEEPEST} times", path[:3], line)
    if isinstance(node, yaml.MappingNode) and node.tag == f"{_PLAIN}map":
        mapping: dict[str, Any] = {}
        for key_node, value_node in node.value:
            key = _value(key_node, path, {}, depth + 1, stored=stored)
            if not isinstance(key, str):
                raise ExperimentError(f"the key {key!r} is not a text", path, key_node.start_mark.line + 1)
            if key in mapping:
                raise ExperimentError("it is said twice", (*path, key), key_node.start_mark.line + 1)
            lines[*path, key] = key_node.start_mark.line + 1
            mapping[key] = _value(value_node, (*path, key), lines, depth + 1, stored=stored)
        return mapping
    if isinstance(node, yaml.SequenceNode) and node.tag == f"{_PLAIN}seq":
        return [_value(item, (*path, place), lines, depth + 1, stored=stored) for place, item in enumerate(node.value)]
    if not isinstance(node, yaml.ScalarNode):
        raise ExperimentError(f"the tag {node.tag} is not taken", path, line)
    match node.tag.removeprefix(_PLAIN):
        case "str":
            words = _with_pairs_joined(node.value)
            try:
                if not stored:
                    require_plain(words)
            except PlainTextError as error:
                raise ExperimentError(str(error), path, line) from None
            return words
        case "null":
            return None
        case "bool":
            return node.value == "true"
        case "int":
            if len(node.value) > 18:
                raise ExperimentError(f"{node.value[:24]}… is not a number that can be meant", path, line)
            return int(node.value)
        case "float" if math.isfinite(float(node.value)):
            return float(node.value)
        case _:
            raise ExperimentError(f"{node.value[:40]!r} with the tag {node.tag} is not taken", path, line)


def _with_pairs_joined(words: str) -> str:
    r"""Return a text with each pair of halves, as JSON escapes "\ud83d\ude00", as the character that it is."""
    if words.isascii():
        return words
    try:
        return words.encode("utf-16-le", "surrogatepass").decode("utf-16-le")
    except UnicodeDecodeError:
        return words


def _place(document: Any, loc: tuple[int | str, ...]) -> Path:
    """Return where a refused value stands: pydantic also names the form that it took a part for."""
    path: list[int | str] = []
    here = document
    for position, part in enumerate(loc):
        if _leads_on(here, part):
            here = here[part]
        elif position < len(loc) - 1 or not isinstance(part, str) or not isinstance(here, Mapping):
            continue
        path.append(part)
    return tuple(path)


def _leads_on(here: Any, part: int | str) -> bool:
    if isinstance(here, Mapping):
        return part in here and part != here.get("do")
    return isinstance(here, list | tuple) and isinstance(part, int) and part < len(here)


_UNKNOWN = "unexpected_keyword_argument"
_WORDS = {
    "missing": "it is missing",
    _UNKNOWN: "it is not known here",
    "too_short": "it is empty: it needs one at least",
    "extra_forbidden": "it is not known here",
    "string_pattern_mismatch": "a name has letters, digits and _, begins with a letter and is 40 characters at most",
}


def _told(first: Any) -> str:
    if first["type"] == "union_tag_invalid":
        return f"{first['ctx']['tag']!r} is no motion; there are {first['ctx']['expected_tags'].replace(chr(39), '')}"
    if first["type"] == "union_tag_not_found":
        return "a part says by `do` what it does"
    if first["type"] == "missing_argument" or first["type"] == "missing_keyword_only_argument":
        return "it is missing"
    said = str(first["msg"]).removeprefix("Value error, ").replace("Input should be", "it should be")
    return _WORDS.get(first["type"]) or said
