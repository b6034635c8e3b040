"""Messages about rejected fields of requests, and about chart layouts that cannot be drawn."""

from plant import catalogue_entry

# Fields of requests --------------------------------------------------------------------------------


@catalogue_entry
def value_out_of_range(*, label: str, fault: str, remedy: str) -> str:
    return f"{label}: {fault}; {remedy}"


@catalogue_entry
def invalid_value(*, label: str, reason: str) -> str:
    return f"{label}: {reason}"


@catalogue_entry
def value_missing(*, label: str) -> str:
    return f"{label}: it is missing"


@catalogue_entry
def unknown_name(*, label: str) -> str:
    return f"{label}: this name is unknown: remove it"


@catalogue_entry
def text_required(*, label: str) -> str:
    return f"{label}: text is required"


@catalogue_entry
def list_required(*, label: str) -> str:
    return f"{label}: a list is required"


@catalogue_entry
def object_required(*, label: str) -> str:
    return f"{label}: an object with named values is required"


@catalogue_entry
def character_not_allowed(*, label: str) -> str:
    return f"{label}: it contains characters that are not allowed, or its format is wrong"


@catalogue_entry
def number_too_long(*, label: str) -> str:
    return f"{label}: the number is too long"


@catalogue_entry
def unknown_choice(*, label: str, value: str, legal: str) -> str:
    return f"{label}: {value} is not allowed; choose one of {legal}"


@catalogue_entry
def number_required(*, label: str, unit: str) -> str:
    return f"{label}: a number{f' in {unit}' if unit else ''} is required"


@catalogue_entry
def whole_number_required(*, label: str, unit: str) -> str:
    return f"{label}: a whole number{f' in {unit}' if unit else ''} is required"


@catalogue_entry
def not_a_number(*, label: str, value: str, unit: str) -> str:
    return f"{label}: {value} is not a number; give one{f' in {unit}' if unit else ''}"


@catalogue_entry
def not_a_whole_number(*, label: str, value: str, unit: str) -> str:
    return f"{label}: {value} is not a whole number; give one{f' in {unit}' if unit else ''}"


@catalogue_entry
def not_a_boolean(*, label: str, value: str) -> str:
    return f"{label}: {value} is neither true nor false"


@catalogue_entry
def too_many_characters(*, label: str, length: int, maximum: int) -> str:
    return f"{label}: too many characters ({length}); at most {maximum} are allowed"


@catalogue_entry
def too_many_items(*, label: str, length: int, maximum: int) -> str:
    return f"{label}: too many items ({length}); at most {maximum} are allowed"


@catalogue_entry
def empty_text(*, label: str) -> str:
    return f"{label}: it must not be empty"


@catalogue_entry
def too_few_characters(*, label: str, length: int, minimum: int) -> str:
    return f"{label}: too few characters ({length}); at least {minimum} are required"


@catalogue_entry
def too_few_items(*, label: str, length: int, minimum: int) -> str:
    return f"{label}: too few items ({length}); at least {minimum} are required"


# Chart layouts -------------------------------------------------------------------------------------


@catalogue_entry
def duplicate_layout(*, layout: str, count: int) -> str:
    return f"layout of the charts: “{layout}” occurs {count} times: remove the duplicates"


@catalogue_entry
def duplicate_panel(*, layout: str, panel: str, count: int) -> str:
    return f"panel of layout “{layout}”: “{panel}” occurs {count} times: remove the duplicates"


@catalogue_entry
def no_panel_over_time(*, layout: str) -> str:
    return f"layout “{layout}” has no time panel: add one, because its time axis applies to all panels"


@catalogue_entry
def unknown_signal(*, layout: str, panel: str, signal: str) -> str:
    return f"panel “{panel}” of layout “{layout}”: there is no signal {signal}"


@catalogue_entry
def duplicate_signal(*, layout: str, panel: str, signal: str, count: int) -> str:
    return f"signal in panel “{panel}” of layout “{layout}”: “{signal}” occurs {count} times: remove the duplicates"


@catalogue_entry
def several_units(*, layout: str, panel: str, signals: str) -> str:
    return (
        f"panel “{panel}” of layout “{layout}” has {signals}: all signals of a panel must have the same unit; "
        "move them to separate panels"
    )
