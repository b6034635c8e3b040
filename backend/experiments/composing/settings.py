"""The settings that an experiment declares, as the page, the command line and the interface know settings. Pure."""

from collections.abc import Collection, Mapping

from backend.banks.tuning_settings import NAMES
from backend.documents.experiment import Declared, Experiment, Rule
from backend.errors import OutOfRangeError, Path
from backend.experiments.composing.expressions import (
    CONSTANTS,
    FUNCTIONS,
    ExpressionError,
    bound_of,
    names_in,
    number_of,
    truth_of,
)
from backend.experiments.composing.refused import ExperimentError, Lines, line_of
from backend.models.run import Value
from backend.models.settings import Setting, SettingError

OF_THE_PLANT = ("u_max", "F_max", "r_j", "r_m", "ideal")
"""What the bounds of criteria may speak of beside settings and tuning."""

_TAKEN = {*NAMES, *OF_THE_PLANT, "seed", "experiment", "name", *CONSTANTS, *FUNCTIONS}


def settings_of(experiment: Experiment, lines: Lines) -> tuple[Setting, ...]:
    """Return the settings of an experiment. Raises ExperimentError for one that cannot be."""
    made: list[Setting] = []
    for place, declared in enumerate(experiment.settings):
        path: Path = ("settings", place)
        if declared.name in _TAKEN or any(declared.name == other.name for other in made):
            why = f"{declared.name!r} is taken: by the tuning, the seed or another setting"
            raise ExperimentError(why, (*path, "name"), line_of((*path, "name"), lines))
        try:
            setting = _setting(declared)
            setting.parse(setting.default)
        except (ExpressionError, SettingError, OutOfRangeError, ValueError) as error:
            raise ExperimentError(str(error), path, line_of(path, lines)) from None
        made.append(setting)
    return tuple(made)


def parsed(settings: tuple[Setting, ...], values: Mapping[str, object]) -> dict[str, Value]:
    """Return all settings by name, those that are not named at their defaults. Raises SettingError, OutOfRangeError."""
    known = {setting.name: setting for setting in settings}
    for name, value in values.items():
        if name not in known:
            legal = tuple(known)
            raise SettingError(name, value, f"unknown setting; known are {', '.join(legal)}", legal=legal)
    return {name: setting.parse(values.get(name, setting.default)) for name, setting in known.items()}


def require_rules(
    experiment: Experiment,
    settings: tuple[Setting, ...],
    values: Mapping[str, Value],
    given: Collection[str],
    lines: Lines,
) -> None:
    """Raise for a rule of the settings that does not hold.

    With values that somebody has ``given`` it is OutOfRangeError of the setting that the rule compares with a bound,
    where it is so plain; else ExperimentError naming the rule.
    """
    for place, rule in enumerate(experiment.rules):
        path: Path = ("rules", place, "that")
        try:
            held, names = truth_of(rule.that, values), names_in(rule.that)
        except ExpressionError as error:
            raise ExperimentError(str(error), path, line_of(path, lines)) from None
        if held:
            continue
        if names & set(given):
            _blame(rule, settings, values)
        told = ", ".join(f"{name} is {value}" for name, value in values.items() if name in names)
        raise ExperimentError(f"{rule.that} does not hold ({told}): {rule.remedy}", path, line_of(path, lines))


def _blame(rule: Rule, settings: tuple[Setting, ...], values: Mapping[str, Value]) -> None:
    """Raise OutOfRangeError of the setting that a rule compares with a bound, where it is so plain."""
    compared = bound_of(rule.that, values)
    blamed = next((setting for setting in settings if compared and setting.name == compared.name), None)
    if compared is None or blamed is None:
        return
    least, most = (None, compared.bound) if compared.below else (compared.bound, None)
    raise OutOfRangeError(
        blamed.name, compared.value, least, most, blamed.unit, rule.remedy, words=blamed.meaning, path=(blamed.name,)
    )


def _setting(declared: Declared) -> Setting:
    if declared.kind == "choice" and declared.default not in declared.choices:
        raise ExpressionError(f"the default {declared.default!r} is none of its choices")
    if declared.kind in ("number", "integer") and (declared.minimum is None or declared.maximum is None):
        raise ExpressionError(f"{declared.name} needs a minimum and a maximum")
    numeric = declared.kind in ("number", "integer")
    default = number_of(declared.default, {}) if numeric else declared.default
    if declared.kind == "integer" and default != round(float(default)):
        raise ExpressionError(f"the default {declared.default!r} is not a whole number")
    return Setting(
        name=declared.name,
        kind=declared.kind,
        symbol=declared.symbol,
        unit=declared.unit,
        meaning=declared.meaning,
        default=int(default) if declared.kind == "integer" else default,
        minimum=None if declared.minimum is None else number_of(declared.minimum, {}),
        maximum=None if declared.maximum is None else number_of(declared.maximum, {}),
        choices=declared.choices,
    )
