"""Parses experiments from YAML or JSON, and the expressions in them, without executing any code."""

import ast
import json
import math
import operator
import re
from collections.abc import Callable, Collection, Iterator, Mapping
from contextlib import contextmanager
from typing import Any, NamedTuple, TypeVar

import yaml
from pydantic import TypeAdapter, ValidationError

from backend.banks import TUNING_NAMES
from backend.errors import InvalidValueError, OutOfRangeError, Path
from backend.experiments import messages
from backend.experiments.schema import EXPERIMENT, FORMAT, Declared, Experiment, Rule
from backend.models import Setting, SettingError, Value
from backend.plain_text import STORED_CONTEXT, PlainTextError, check_plain_text, escape_refused_characters
from backend.recording import Derived, FormulaStep
from backend.sample import COMBINED_SIGNAL_BY_NAME, UNIT_BY_SIGNAL, find_nearest_name
from backend.units import AngleUnit
from plant import ErrorCode, Message, SinewError

# Expressions ---------------------------------------------------------------------------------------
# Expressions of settings such as "2 * hold_s": numbers, names, arithmetic, comparisons, conditions.
#
# All numbers are floats, and length, nesting and rounding are bounded, so that the cost of an
# expression is bounded. With Python's integers, ``round(1, -1000000000)`` would compute a power of
# ten with a billion digits.


Names = Mapping[str, bool | int | float | str]
CONSTANTS = {"pi": math.pi}
MAX_LENGTH = 500
"""Maximum length of an expression [characters]."""

MAX_NODES = 200
"""Maximum number of numbers, names and operations in an expression."""

MAX_DEPTH = 30
"""Maximum nesting of an expression."""

MAX_DIGITS = 15
"""Maximum number of digits for rounding, before or after the decimal point; a float has no more."""


def _round(number: float, digits: float = 0.0) -> float:
    if not abs(digits) <= MAX_DIGITS or digits != int(digits):
        raise ValueError(messages.rounding_to_other_digits(maximum=MAX_DIGITS))
    return round(float(number), int(digits))


FUNCTIONS: dict[str, Callable[..., Any]] = {
    "min": min,
    "max": max,
    "abs": abs,
    "sqrt": math.sqrt,
    "round": _round,
}
_EXPRESSION_BINARY: dict[type, Callable[[Any, Any], Any]] = {
    ast.Add: operator.add,
    ast.Sub: operator.sub,
    ast.Mult: operator.mul,
    ast.Div: operator.truediv,
    ast.Mod: operator.mod,
    ast.Pow: math.pow,
}
_UNARY: dict[type, Callable[[Any], Any]] = {ast.UAdd: operator.pos, ast.USub: operator.neg, ast.Not: operator.not_}
_EXPRESSION_COMPARE: dict[type, Callable[[Any, Any], bool]] = {
    ast.Lt: operator.lt,
    ast.LtE: operator.le,
    ast.Gt: operator.gt,
    ast.GtE: operator.ge,
    ast.Eq: operator.eq,
    ast.NotEq: operator.ne,
}


class ExpressionError(SinewError, ValueError):
    """An expression is invalid or has no value."""

    category = ErrorCode.BAD_VALUE


def evaluate_number(expression: float | str, names: Names) -> float:
    """Return the value of a numeric expression. Raises ExpressionError."""
    value = _evaluate_text(expression, names)
    if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
        raise ExpressionError(messages.not_a_finite_number(expression=expression, value=value))
    return float(value)


def evaluate_condition(expression: str, names: Names) -> bool:
    """Return the value of a condition. Raises ExpressionError."""
    value = _evaluate_text(expression, names)
    if not isinstance(value, bool):
        raise ExpressionError(messages.not_a_comparison(expression=expression, value=value))
    return value


def require_known(expression: float | str, names: Names) -> None:
    """Raise ExpressionError for an unknown name or an unsupported construct, independent of values."""
    if isinstance(expression, str):
        _require_supported(parse_expression(expression).body, names)


def find_names(expression: str) -> set[str]:
    """Return the names in an expression. Raises ExpressionError."""
    return {node.id for node in ast.walk(parse_expression(expression)) if isinstance(node, ast.Name)}


class Comparison(NamedTuple):
    """A name compared with a bound, with both values; ``below``: the value must stay below the bound."""

    name: str
    value: float
    bound: float
    below: bool


def extract_comparison(expression: str, names: Names) -> Comparison | None:
    """Return the comparison of a name with a bound, as in "S_low < S_high"; None for other expressions."""
    match parse_expression(expression).body:
        case ast.Compare(
            left=ast.Name(id=name), ops=[ast.Lt() | ast.LtE() | ast.Gt() | ast.GtE() as sign], comparators=[right]
        ):
            value, bound = names.get(name), evaluate_number(ast.unparse(right), names)
            if isinstance(value, int | float):
                return Comparison(name, float(value), bound, isinstance(sign, ast.Lt | ast.LtE))
        case _:
            pass
    return None


def _evaluate_text(expression: float | str, names: Names) -> Any:
    if not isinstance(expression, str):
        try:
            return _to_float(expression)
        except OverflowError:
            raise ExpressionError(messages.number_too_long()) from None
    tree = parse_expression(expression)
    _require_supported(tree.body, names)
    try:
        return _evaluate(tree.body, names)
    except (ArithmeticError, ValueError, TypeError) as error:
        raise ExpressionError(messages.no_value(expression=expression, reason=str(error))) from None


def parse_expression(expression: str) -> ast.Expression:
    """Return the syntax tree of an expression, with bounded size. Raises ExpressionError."""
    if len(expression) > MAX_LENGTH:
        raise ExpressionError(messages.expression_too_long(expression=expression, maximum=MAX_LENGTH))
    try:
        tree = ast.parse(expression.strip(), mode="eval")
    except (SyntaxError, ValueError, MemoryError, RecursionError):
        raise ExpressionError(messages.not_an_expression(expression=expression)) from None
    _require_small(tree)
    return tree


def _require_small(tree: ast.Expression) -> None:
    """Raise ExpressionError for more than MAX_NODES nodes or a nesting deeper than MAX_DEPTH."""
    level: list[ast.AST] = [tree.body]
    count = depth = 0
    while level:
        count, depth = count + len(level), depth + 1
        if count > MAX_NODES:
            raise ExpressionError(messages.too_many_operations(maximum=MAX_NODES))
        if depth > MAX_DEPTH:
            raise ExpressionError(messages.expression_nested_too_deep(maximum=MAX_DEPTH))
        level = [child for node in level for child in ast.iter_child_nodes(node) if isinstance(child, ast.expr)]


def _require_supported(node: ast.AST, names: Names) -> None:
    match node:
        case ast.Name(id=name) if name not in names and name not in CONSTANTS:
            raise ExpressionError(messages.unknown_name(name=name, known=", ".join((*names, *CONSTANTS))))
        case ast.Constant(value=value) if not isinstance(value, bool | int | float | str):
            raise ExpressionError(messages.unsupported_constant(value=value))
        case ast.Call(func=ast.Name(id=name), args=arguments, keywords=[]) if name in FUNCTIONS:
            for argument in arguments:
                _require_supported(argument, names)
            return
        case ast.Name() | ast.Constant():
            return
        case ast.BinOp(op=operation) if type(operation) in _EXPRESSION_BINARY:
            pass
        case ast.UnaryOp(op=operation) if type(operation) in _UNARY:
            pass
        case ast.Compare(ops=operations) if all(type(item) in _EXPRESSION_COMPARE for item in operations):
            pass
        case ast.IfExp() | ast.BoolOp():
            pass
        case _:
            raise ExpressionError(
                messages.unsupported_operation(operation=ast.unparse(node), functions=", ".join(FUNCTIONS))
            )
    for child in ast.iter_child_nodes(node):
        if isinstance(child, ast.expr):
            _require_supported(child, names)


def _to_float(value: Any) -> Any:
    """Return an integer as a float, other values unchanged. Raises OverflowError."""
    return float(value) if isinstance(value, int) and not isinstance(value, bool) else value


def _evaluate(node: ast.AST, names: Names) -> Any:
    match node:
        case ast.Constant(value=value):
            return _to_float(value)
        case ast.Name(id=name):
            return _to_float(names[name] if name in names else CONSTANTS[name])
        case ast.BinOp(left=left, op=operation, right=right):
            return _EXPRESSION_BINARY[type(operation)](float(_evaluate(left, names)), float(_evaluate(right, names)))
        case ast.UnaryOp(op=operation, operand=operand):
            return _UNARY[type(operation)](_evaluate(operand, names))
        case ast.IfExp(test=test, body=body, orelse=otherwise):
            return _evaluate(body if _evaluate(test, names) else otherwise, names)
        case ast.BoolOp(op=operation, values=values):
            results = [bool(_evaluate(value, names)) for value in values]
            return all(results) if isinstance(operation, ast.And) else any(results)
        case ast.Compare(left=left, ops=operations, comparators=others):
            values = [_evaluate(item, names) for item in (left, *others)]
            return all(
                _EXPRESSION_COMPARE[type(item)](low, high)
                for item, low, high in zip(operations, values, values[1:], strict=False)
            )
        case ast.Call(func=ast.Name(id=name), args=arguments):
            return FUNCTIONS[name](*(_evaluate(argument, names) for argument in arguments))
        case _:
            raise ExpressionError(messages.not_evaluated())


# Errors --------------------------------------------------------------------------------------------


Lines = Mapping[Path, int]
"""Line of each part of a text, from 1, by its path in the document."""


class ExperimentError(InvalidValueError):
    """An experiment is invalid. ``line`` is None without a text."""

    code = "bad_experiment"

    def __init__(self, why: str | InvalidValueError, path: Path = (), line: int | None = None) -> None:
        self.why = why
        self.line = line
        super().__init__(str(path[-1]) if path else "experiment", label=format_path(path), path=path)

    @property
    def fields(self) -> dict[str, Any]:
        """Error code, message and path, with the line."""
        return {**super().fields, "line": self.line}

    def format_message(self, angles: AngleUnit) -> Message:
        """Return the message with angles in this unit; its value ``reason`` is the message without the place."""
        reason = self.why if isinstance(self.why, str) else self.why.format_message(angles)
        return messages.at_place(line=self.line, place=self.label if self.path else "", reason=reason)


def format_path(path: Path) -> str:
    """Return a path as text, counted from 1: "phases 2, parts 1, q_ref"."""
    words: list[str] = []
    for part in path:
        if isinstance(part, int) and words:
            words[-1] += f" {part + 1}"
        else:
            words.append(str(part))
    return ", ".join(words) or "experiment"


def find_line(path: Path, lines: Lines) -> int | None:
    """Return the line of a path, or of its nearest parent that has one."""
    for length in range(len(path), -1, -1):
        if path[:length] in lines:
            return lines[path[:length]]
    return None


@contextmanager
def error_context(path: Path, lines: Lines) -> Iterator[None]:
    """Add path and line to errors raised in the block."""
    try:
        yield
    except ExperimentError:
        raise
    except InvalidValueError as error:
        raise ExperimentError(error, path, find_line(path, lines)) from None


# Settings ------------------------------------------------------------------------------------------
# Settings that an experiment declares.


PLANT_NAMES = ("u_max", "F_max", "r_j", "r_m", "ideal")
"""Names of the plant in the bounds of criteria, in addition to settings and tuning."""

_SETTING_TAKEN = {*TUNING_NAMES, *PLANT_NAMES, "seed", "experiment", "name", *CONSTANTS, *FUNCTIONS}


def build_settings(experiment: Experiment, lines: Lines) -> tuple[Setting, ...]:
    """Return the settings that an experiment declares. Raises ExperimentError for an invalid declaration."""
    settings: list[Setting] = []
    for index, declared in enumerate(experiment.settings):
        path: Path = ("settings", index)
        if declared.name in _SETTING_TAKEN or any(declared.name == other.name for other in settings):
            taken = messages.setting_name_taken(name=declared.name)
            raise ExperimentError(taken, (*path, "name"), find_line((*path, "name"), lines))
        try:
            setting = _build_setting(declared)
            setting.parse(setting.default)
        except ExpressionError as error:
            raise ExperimentError(error.message, path, find_line(path, lines)) from None
        except ValueError as error:  # SettingError and OutOfRangeError too
            reason = messages.invalid_default(name=declared.name, default=declared.default, reason=str(error))
            raise ExperimentError(reason, path, find_line(path, lines)) from None
        settings.append(setting)
    return tuple(settings)


def parse_values(settings: tuple[Setting, ...], values: Mapping[str, object]) -> dict[str, Value]:
    """Return the values of all settings by name, with defaults. Raises SettingError, OutOfRangeError."""
    known = {setting.name: setting for setting in settings}
    for name, value in values.items():
        if name not in known:
            legal = tuple(known)
            raise SettingError(name, value, messages.unknown_setting(known=", ".join(legal)), legal=legal)
    return {name: setting.parse(values.get(name, setting.default)) for name, setting in known.items()}


def require_rules(
    experiment: Experiment,
    settings: tuple[Setting, ...],
    values: Mapping[str, Value],
    given: Collection[str],
    lines: Lines,
) -> None:
    """Raise an error for the first rule that does not hold.

    If a ``given`` setting violates a simple comparison with a bound, the error is OutOfRangeError of that setting;
    otherwise ExperimentError with the rule.
    """
    for index, rule in enumerate(experiment.rules):
        path: Path = ("rules", index, "that")
        try:
            is_true, names = evaluate_condition(rule.that, values), find_names(rule.that)
        except ExpressionError as error:
            raise ExperimentError(error.message, path, find_line(path, lines)) from None
        if is_true:
            continue
        if names & set(given):
            _raise_for_setting(rule, settings, values)
        involved = (
            messages.value_of_setting(name=name, value=value) for name, value in values.items() if name in names
        )
        settings_text = ", ".join(involved)
        broken = messages.rule_not_satisfied(rule=rule.that, values=settings_text, remedy=rule.remedy)
        raise ExperimentError(broken, path, find_line(path, lines))


def _raise_for_setting(rule: Rule, settings: tuple[Setting, ...], values: Mapping[str, Value]) -> None:
    """Raise OutOfRangeError of the setting that a rule compares with a bound, if it is a simple comparison."""
    compared = extract_comparison(rule.that, values)
    setting = next((setting for setting in settings if compared and setting.name == compared.name), None)
    if compared is None or setting is None:
        return
    least, most = (None, compared.bound) if compared.below else (compared.bound, None)
    raise OutOfRangeError(
        quantity=setting.name,
        value=compared.value,
        minimum=least,
        maximum=most,
        unit=setting.unit,
        remedy=rule.remedy,
        label=setting.meaning,
        path=(setting.name,),
    )


def _build_setting(declared: Declared) -> Setting:
    if declared.kind == "choice" and declared.default not in declared.choices:
        raise ExpressionError(messages.default_not_a_choice(default=declared.default))
    if declared.kind in ("number", "integer") and (declared.minimum is None or declared.maximum is None):
        raise ExpressionError(messages.setting_without_bounds(name=declared.name))
    numeric = declared.kind in ("number", "integer")
    default = evaluate_number(declared.default, {}) if numeric else declared.default
    if declared.kind == "integer" and default != round(float(default)):
        raise ExpressionError(messages.default_not_whole(default=declared.default))
    return Setting(
        name=declared.name,
        kind=declared.kind,
        symbol=declared.symbol,
        unit=declared.unit,
        meaning=declared.meaning,
        default=int(default) if declared.kind == "integer" else default,
        minimum=None if declared.minimum is None else evaluate_number(declared.minimum, {}),
        maximum=None if declared.maximum is None else evaluate_number(declared.maximum, {}),
        choices=declared.choices or None,
    )


# Text ----------------------------------------------------------------------------------------------
# Documents of experiments and studies as YAML or JSON, parsed with the line of each part.
#
# Only the data types of JSON are accepted. Anchors and aliases are rejected, because they can expand
# a small text without limit, and so are tags.


MAX_CHARACTERS = 100_000
_MAX_NESTING = 40
_T = TypeVar("_T")


class _Loader(yaml.SafeLoader):  # type: ignore[misc]  # PyYAML has no types
    """Composes nodes, with scalars as in YAML 1.2 and JSON: "no" is a text, 1e3 a number."""

    yaml_implicit_resolvers: dict[str, Any] = {}  # noqa: RUF012  # as its parent declares it

    def compose_node(self, parent: Any, index: Any) -> Any:
        if self.check_event(yaml.AliasEvent) or getattr(self.peek_event(), "anchor", None):
            line = self.peek_event().start_mark.line + 1
            raise ExperimentError(messages.anchor_or_alias(), (), line)
        if (tag := getattr(self.peek_event(), "tag", None)) is not None:
            raise ExperimentError(messages.unsupported_tag(tag=tag), (), self.peek_event().start_mark.line + 1)
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


def parse_experiment(text: str, *, stored: bool = False) -> tuple[Experiment, Lines]:
    """Return the experiment of a text and the line of each part; ``stored`` as in ``parse_document``.

    Raises ExperimentError.
    """
    document, lines = parse_document(text, stored=stored)
    return build_experiment(document, lines, stored=stored), lines


def parse_document(text: str, *, stored: bool = False) -> tuple[Any, Lines]:
    """Return the document of a text as plain data and the line of each part. Raises ExperimentError.

    In a ``stored`` text, characters that are no longer accepted are replaced by escapes instead of being rejected.
    """
    if len(text) > MAX_CHARACTERS:
        raise ExperimentError(messages.text_too_long(characters=len(text), maximum=MAX_CHARACTERS))
    lines: dict[Path, int] = {}
    try:
        node = _Loader(text).get_single_node()
        document = None if node is None else _convert_node(node, (), lines, 0, stored=stored)
        return escape_refused_characters(document) if stored else document, lines
    except yaml.MarkedYAMLError as error:
        mark = error.problem_mark or error.context_mark
        reason = messages.not_yaml_or_json(reason=str(error.problem))
        raise ExperimentError(reason, (), mark and mark.line + 1) from None
    except ExperimentError:
        raise
    except (yaml.YAMLError, RecursionError, ValueError, OverflowError) as error:  # such as an escape beyond Unicode
        raise ExperimentError(messages.not_yaml_or_json(reason=str(error))) from None


def build_experiment(document: Any, lines: Lines, *, stored: bool = False) -> Experiment:
    """Return the experiment of a document; ``stored`` as in ``parse_document``. Raises ExperimentError."""
    if not isinstance(document, Mapping):
        raise ExperimentError(messages.not_an_experiment(), (), 1)
    return validate_document(EXPERIMENT, FORMAT, document, lines, stored=stored)


def validate_document(
    form: TypeAdapter[_T], known: int, document: Mapping[str, Any], lines: Lines, *, stored: bool = False
) -> _T:
    """Validate a document of format ``known`` and return its object. Raises ExperimentError with the path."""
    if document.get("format") != known:
        unknown = messages.unknown_format(value=document.get("format"), known=known)
        raise ExperimentError(unknown, ("format",), find_line(("format",), lines))
    try:
        return form.validate_json(json.dumps(document), context=STORED_CONTEXT if stored else None)
    except ValidationError as error:
        found = error.errors(include_url=False)
        # a misspelt key is unknown and makes another key missing: report the unknown one
        first = next((item for item in found if item["type"] == _UNKNOWN_KEY), found[0])
        path = _find_path(document, first["loc"])
        raise ExperimentError(_describe_problem(first), path, find_line(path, lines)) from None


def parse_canonical(line: str) -> Experiment:
    """Return the experiment of a stored text of ``to_canonical_text``. Raises ExperimentError."""
    try:
        return build_experiment(escape_refused_characters(json.loads(line)), {}, stored=True)
    except (ValueError, RecursionError) as error:
        if isinstance(error, ExperimentError):
            raise
        raise ExperimentError(messages.not_json(reason=str(error))) from None


def to_canonical_text(experiment: Experiment) -> str:
    """Return an experiment as one line of JSON; equal experiments have equal texts."""
    return EXPERIMENT.dump_json(experiment, exclude_defaults=True).decode()


def _convert_node(node: Any, path: Path, lines: dict[Path, int], depth: int, *, stored: bool) -> Any:
    line = node.start_mark.line + 1
    lines.setdefault(path, line)
    if depth > _MAX_NESTING:
        raise ExperimentError(messages.text_nested_too_deep(maximum=_MAX_NESTING), path[:3], line)
    if isinstance(node, yaml.MappingNode) and node.tag == f"{_PLAIN}map":
        mapping: dict[str, Any] = {}
        for key_node, value_node in node.value:
            key = _convert_node(key_node, path, {}, depth + 1, stored=stored)
            if not isinstance(key, str):
                raise ExperimentError(messages.key_not_a_text(key=key), path, key_node.start_mark.line + 1)
            if key in mapping:
                raise ExperimentError(messages.key_given_twice(), (*path, key), key_node.start_mark.line + 1)
            lines[*path, key] = key_node.start_mark.line + 1
            mapping[key] = _convert_node(value_node, (*path, key), lines, depth + 1, stored=stored)
        return mapping
    if isinstance(node, yaml.SequenceNode) and node.tag == f"{_PLAIN}seq":
        return [
            _convert_node(item, (*path, index), lines, depth + 1, stored=stored)
            for index, item in enumerate(node.value)
        ]
    if not isinstance(node, yaml.ScalarNode):
        raise ExperimentError(messages.unsupported_tag(tag=node.tag), path, line)
    match node.tag.removeprefix(_PLAIN):
        case "str":
            words = _join_surrogates(node.value)
            try:
                if not stored:
                    check_plain_text(words)
            except PlainTextError as error:
                raise ExperimentError(error.message, path, line) from None
            return words
        case "null":
            return None
        case "bool":
            return node.value == "true"
        case "int":
            if len(node.value) > 18:
                raise ExperimentError(messages.too_many_digits(number=node.value), path, line)
            return int(node.value)
        case "float" if math.isfinite(float(node.value)):
            return float(node.value)
        case _:
            raise ExperimentError(messages.unsupported_scalar(value=node.value, tag=node.tag), path, line)


def _join_surrogates(words: str) -> str:
    r"""Return a text with each pair of halves, as JSON escapes "\ud83d\ude00", as the character that it is."""
    if words.isascii():
        return words
    try:
        return words.encode("utf-16-le", "surrogatepass").decode("utf-16-le")
    except UnicodeDecodeError:
        return words


def _find_path(document: Any, loc: tuple[int | str, ...]) -> Path:
    """Return the path of an error in the document; pydantic's location also contains names of union members."""
    path: list[int | str] = []
    here = document
    for position, part in enumerate(loc):
        if _has_child(here, part):
            here = here[part]
        elif position < len(loc) - 1 or not isinstance(part, str) or not isinstance(here, Mapping):
            continue
        path.append(part)
    return tuple(path)


def _has_child(here: Any, part: int | str) -> bool:
    if isinstance(here, Mapping):
        return part in here and part != here.get("do")
    return isinstance(here, list | tuple) and isinstance(part, int) and part < len(here)


_UNKNOWN_KEY = "unexpected_keyword_argument"


def _describe_problem(first: Any) -> Message:
    match first["type"]:
        case "union_tag_invalid":
            known = first["ctx"]["expected_tags"].replace("'", "")
            return messages.unknown_part(name=first["ctx"]["tag"], known=known)
        case "union_tag_not_found":
            return messages.part_without_do()
        case "missing" | "missing_argument" | "missing_keyword_only_argument":
            return messages.key_missing()
        case str(kind) if kind in (_UNKNOWN_KEY, "extra_forbidden"):
            return messages.unknown_key()
        case "too_short":
            return messages.list_is_empty()
        case "string_pattern_mismatch":
            return messages.invalid_name()
        case kind:
            reason = str(first["msg"]).removeprefix("Value error, ").replace("Input should be", "it should be")
            return messages.invalid_value(error_type=kind, reason=reason)


# Formulas ------------------------------------------------------------------------------------------
# Formulas of derived signals: expressions over signals, converted to steps that compute them.


_NAME = re.compile(r"[A-Za-z][A-Za-z0-9_]{0,19}")
_FORMULA_TAKEN = {*UNIT_BY_SIGNAL, *FUNCTIONS, *CONSTANTS, "and", "or", "not", "if", "else", "tick", "t"}
SIGNAL_NAMES = tuple(name for name in UNIT_BY_SIGNAL if name.isidentifier())
"""Names of the signals in formulas; differences are written as such."""

_FORMULA_BINARY = {ast.Add: "add", ast.Sub: "sub", ast.Mult: "mul", ast.Div: "div", ast.Mod: "mod", ast.Pow: "pow"}
_FORMULA_COMPARE = {ast.Lt: "lt", ast.LtE: "le", ast.Gt: "gt", ast.GtE: "ge", ast.Eq: "eq", ast.NotEq: "ne"}
_ARGUMENTS = {"min": (2, 50), "max": (2, 50), "abs": (1, 1), "sqrt": (1, 1), "round": (1, 2)}


def parse_derived_signal(name: str, unit: str, expression: str) -> Derived:
    """Return the derived signal that a formula defines. Raises ExpressionError."""
    if not _NAME.fullmatch(name) or name in _FORMULA_TAKEN:
        raise ExpressionError(messages.invalid_formula_name(name=name))
    steps: list[FormulaStep] = []
    _append_steps(parse_expression(expression).body, steps)
    found = Derived(name, unit, tuple(steps))
    if not found.signals:
        raise ExpressionError(messages.formula_without_signal(expression=expression, known=", ".join(SIGNAL_NAMES)))
    return found


def _append_steps(node: ast.AST, steps: list[FormulaStep]) -> None:
    """Append the steps of an expression, in postfix order."""
    match node:
        case ast.Constant(value=bool() | int() | float() as value):
            try:
                steps.append(FormulaStep("number", value=float(value)))
            except OverflowError:
                raise ExpressionError(messages.number_too_long()) from None
        case ast.Name(id=name):
            _append_name(name, steps)
        case ast.BinOp(left=left, op=operation, right=right) if type(operation) in _FORMULA_BINARY:
            _append_operation(_FORMULA_BINARY[type(operation)], [left, right], steps)
        case ast.UnaryOp(op=ast.UAdd(), operand=operand):
            _append_steps(operand, steps)
        case ast.UnaryOp(op=ast.USub(), operand=operand):
            _append_operation("neg", [operand], steps)
        case ast.UnaryOp(op=ast.Not(), operand=operand):
            _append_operation("not", [operand], steps)
        case ast.IfExp(test=test, body=body, orelse=otherwise):
            _append_operation("if", [test, body, otherwise], steps)
        case ast.BoolOp(op=operation, values=values):
            _append_operation("and" if isinstance(operation, ast.And) else "or", values, steps)
        case ast.Compare(left=left, ops=operations, comparators=others) if all(
            type(o) in _FORMULA_COMPARE for o in operations
        ):
            pairs = list(zip([left, *others], operations, others, strict=False))
            for item, sign, other in pairs:
                _append_operation(_FORMULA_COMPARE[type(sign)], [item, other], steps)
            if len(pairs) > 1:
                steps.append(FormulaStep("and", len(pairs)))
        case ast.Call(func=ast.Name(id=name), args=arguments, keywords=[]) if name in FUNCTIONS:
            least, most = _ARGUMENTS[name]
            if not least <= len(arguments) <= most:
                raise ExpressionError(
                    messages.wrong_number_of_arguments(function=name, minimum=least, maximum=most, count=len(arguments))
                )
            _append_operation(name, arguments, steps)
        case _:
            raise ExpressionError(
                messages.unsupported_in_formula(operation=ast.unparse(node), functions=", ".join(FUNCTIONS))
            )


def _append_operation(operation: str, operands: list[ast.expr], steps: list[FormulaStep]) -> None:
    for operand in operands:
        _append_steps(operand, steps)
    steps.append(FormulaStep(operation, len(operands)))  # type: ignore[arg-type]  # the tables hold operations only


def _append_name(name: str, steps: list[FormulaStep]) -> None:
    if name in CONSTANTS:
        steps.append(FormulaStep("number", value=CONSTANTS[name]))
    elif name in COMBINED_SIGNAL_BY_NAME:
        for number, term in enumerate(COMBINED_SIGNAL_BY_NAME[name].terms):
            steps.append(FormulaStep("signal", name=term.column))
            if term.length:
                steps += [FormulaStep("length", name=term.length), FormulaStep("mul", 2)]
            if term.sign < 0:
                steps.append(FormulaStep("neg", 1))
            if number:
                steps.append(FormulaStep("add", 2))
    elif name in SIGNAL_NAMES:
        steps.append(FormulaStep("signal", name=name))
    else:
        raise ExpressionError(messages.unknown_signal(name=name, nearest=find_nearest_name(name, SIGNAL_NAMES)))
