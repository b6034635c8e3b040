"""What the boxes of the page's forms mean: read from the requests that the forms send, which describe each field.

Settings of experiments and identifications describe themselves where they are offered (``SettingView``).
"""

from annotated_types import Ge, Le
from pydantic.fields import FieldInfo

from backend.errors import WORDS
from backend.glossary.entry import Entry, Kind
from backend.messages.base import HUGE, Schema
from backend.messages.identification import ActuatorRequest
from backend.messages.state import Push, References, Wall
from backend.messages.touch import TouchOrder
from backend.messages.trigger import TriggerOrder
from backend.messages.tuning import TrialRequest

FORMS: dict[str, type[Schema]] = {
    "references": References,
    "push": Push,
    "wall": Wall,
    "touch": TouchOrder,
    "trigger": TriggerOrder,
    "tuning": TrialRequest,
    "identification": ActuatorRequest,
}


def fields() -> list[Entry]:
    """Return an entry for each described field of each form, by the form's name and its own."""
    return [
        _entry(form, name, field)
        for form, request in FORMS.items()
        for name, field in request.model_fields.items()
        if field.description
    ]


def _entry(form: str, name: str, field: FieldInfo) -> Entry:
    extra = field.json_schema_extra
    unit = str(extra["unit"]) if isinstance(extra, dict) and "unit" in extra else ""
    meaning = str(field.description).removesuffix(f" [{unit}]")
    low, high = bounds(field)
    accepted = () if low is None or high is None else (("Accepted", f"{low:g} to {high:g} {unit}".strip()),)
    words = WORDS.get(name, name.replace("_", " "))
    return Entry(Kind.SETTING, f"{form}.{name}", words, meaning, "" if unit == "1" else unit, more=accepted)


def bounds(field: FieldInfo) -> tuple[float | None, float | None]:
    """Return the bounds that a field declares; None where only the plant can tell them."""
    low = next((float(str(one.ge)) for one in field.metadata if isinstance(one, Ge)), None)
    high = next((float(str(one.le)) for one in field.metadata if isinstance(one, Le)), None)
    return (None if low == -HUGE else low), (None if high == HUGE else high)
