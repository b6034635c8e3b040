"""Messages about banks: refused entries and files, names of entries, and the settings of a tuning as text."""

import json
from collections.abc import Sequence
from typing import Any

from plant import catalogue_entry

# Entries and files ---------------------------------------------------------------------------------


@catalogue_entry
def entry_without_models(*, entry: str, missing: str) -> str:
    return f"the entry {entry} has no {missing}"


@catalogue_entry
def no_identifications() -> str:
    return "a bank needs at least one identification"


@catalogue_entry
def other_parameters(*, name: str, parameter: str, recorded: object, current: object) -> str:
    return (
        f"{name} was made with other parameters: {parameter} was {recorded}, but is now {current}; identify again, "
        "or use the parameters of that run"
    )


@catalogue_entry
def not_positive(*, name: str, parameter: str, value: object) -> str:
    return f"{name} has {parameter} = {value}: it must be a number above 0"


@catalogue_entry
def entries_too_close(*, below: str, above: str, distance: float, minimum: float) -> str:
    return (
        f"{below} and {above} are {distance:.2f} N·m/rad apart, less than {minimum:g}: "
        "they describe the same operating point; choose one of them"
    )


@catalogue_entry
def tension_does_not_increase(
    *, below: str, above: str, S_below: float, S_above: float, F_below: float, F_above: float
) -> str:
    return (
        f"{above} is stiffer than {below} ({S_above:.2f} and {S_below:.2f} N·m/rad) at a tension that is not higher "
        f"({F_above:g} and {F_below:g} N): at least one of them is wrong; identify both again"
    )


@catalogue_entry
def gain_unlike_geometry(
    *, name: str, parameter: str, value: float, geometric: float, error_percent: float, maximum_percent: float
) -> str:
    return (
        f"{name} has {parameter} = {value:.4g}, {error_percent:+.0f} % from the value {geometric:.4g} given by the "
        f"geometry, more than {maximum_percent:g} %: identify again with more motion"
    )


@catalogue_entry
def not_robust(*, name: str, reason: str) -> str:
    return f"{name} gives loops that are not robust at any λ: {reason}"


@catalogue_entry
def not_of_an_actuator(*, source: str, kind: str) -> str:
    return f"{source} is of kind {kind}: choose actuator identifications"


@catalogue_entry
def not_usable(*, source: str, verdict: str) -> str:
    return f"{source} is not usable for tuning: {verdict}"


@catalogue_entry
def no_name() -> str:
    return "a bank needs a name"


@catalogue_entry
def invalid_name(*, reason: str) -> str:
    return f"name of a bank: {reason}"


@catalogue_entry
def file_too_large(*, maximum_bytes: int) -> str:
    return f"the file is larger than {maximum_bytes} bytes: it is not a bank"


@catalogue_entry
def invalid_text_in_file(*, reason: str) -> str:
    return f"the file: {reason}"


@catalogue_entry
def file_is_not_json(*, reason: str) -> str:
    return f"the file is not JSON: {reason}"


@catalogue_entry
def file_is_not_an_object() -> str:
    return "the file is not a bank: it contains no JSON object"


@catalogue_entry
def file_of_another_format(*, format_name: str, version: int) -> str:
    return f"the file is not a bank: it needs format = {format_name!r} and version = {version}"


@catalogue_entry
def file_without_name(*, maximum: int) -> str:
    return f"the bank in the file needs a name of at most {maximum} characters"


@catalogue_entry
def wrong_number_of_entries(*, maximum: int) -> str:
    return f"the bank in the file needs 1 to {maximum} entries"


@catalogue_entry
def unknown_key(*, name: str, known: str) -> str:
    return f"{name} may contain only {known}"


@catalogue_entry
def not_a_number(*, name: str, key: str, value: object) -> str:
    return f"{name} has {key} = {value!r}: it must be a number"


@catalogue_entry
def entry_without_stiffness(*, name: str) -> str:
    return f"{name} has no S_nominal"


# Names of identifications, entries and files -------------------------------------------------------


@catalogue_entry
def identification_of_run(*, run: int) -> str:
    return f"identification {run}"


@catalogue_entry
def identification_without_run(*, kind: str, estimate: int) -> str:
    return f"{kind} identification without a run (estimate {estimate})"


@catalogue_entry
def entry_at_position(*, position: int) -> str:
    return f"entry {position}"


@catalogue_entry
def entry_at_tension(*, tension_N: float) -> str:
    return f"the {tension_N:g} N entry"


@catalogue_entry
def imported(*, origin: Any) -> str:
    return f"imported; exported from {json.dumps(origin, ensure_ascii=False)[:200]}" if origin else "imported"


@catalogue_entry
def stored_tuning(*, who: str) -> str:
    return f"the tuning in the data folder, stored by {who}"


# Tuning settings -----------------------------------------------------------------------------------


@catalogue_entry
def setting_value(*, symbol: str, value: str, unit: str) -> str:
    return f"{symbol} {value}" + ("" if unit == "1" else f" {unit}")


@catalogue_entry
def setting_changed(*, symbol: str, before: str, after: str, unit: str) -> str:
    return f"{symbol} {before} → {after}" + ("" if unit == "1" else f" {unit}")


@catalogue_entry
def motion_of_references(*, motion: str) -> str:
    return f"{motion} motion"


@catalogue_entry
def source_of_gains(*, bank: int) -> str:
    return "geometric gains" if bank == 0 else f"bank {bank}"


@catalogue_entry
def gains_between_entries(*, interpolate: bool) -> str:
    return f"{'interpolating' if interpolate else 'switching'} between operating points"


@catalogue_entry
def default_tuning_moved(*, changes: Sequence[str]) -> str:
    return (
        "the method's default is outside the safe range of these models; the nearest safe tuning "
        f"is: {', '.join(changes)}"
    )
