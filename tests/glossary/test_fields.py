"""Each box of a form is explained, and with the bounds that the service accepts."""

import pytest
from pydantic import TypeAdapter, ValidationError

from backend.errors import InvalidValueError
from backend.experiments.library import experiments_by_name
from backend.experiments.plans import LoopSettings
from backend.glossary.glossary import FORMS, TermKind, build_field_terms, read_bounds
from backend.models.settings import Setting, describe_settings
from backend.schemas.base import UNITS
from backend.schemas.identification import IdentificationRequest
from backend.services.jobs import describe_identification_kinds

REQUEST: TypeAdapter[IdentificationRequest] = TypeAdapter(IdentificationRequest)
NAMED = ("kind",)
"""Which form it is, chosen above it."""


@pytest.mark.parametrize("form", FORMS)
def test_every_field_of_an_order_says_what_its_request_says(form: str) -> None:
    told = {
        entry.name.removeprefix(f"{form}."): entry for entry in build_field_terms() if entry.name.startswith(f"{form}.")
    }
    declared = FORMS[form].model_fields
    assert set(told) == set(declared) - set(NAMED)
    for name, entry in told.items():
        assert entry.kind is TermKind.SETTING
        unit = UNITS.get(name, "1")
        assert entry.unit == ("" if unit == "1" else unit)
        assert declared[name].description in (entry.meaning, f"{entry.meaning} [{unit}]")


@pytest.mark.parametrize("form", FORMS)
def test_bounds_that_are_told_are_those_that_the_request_takes(form: str) -> None:
    request = FORMS[form]
    for name, field in request.model_fields.items():
        low, high = read_bounds(field)
        if low is None or high is None:
            continue
        adapter: TypeAdapter[object] = TypeAdapter(request.__pydantic_fields__[name].rebuild_annotation())
        told = next(entry for entry in build_field_terms() if entry.name == f"{form}.{name}")
        assert dict(told.more)["Accepted"].startswith(f"{low:g} to {high:g}")
        for value in (low, high):
            adapter.validate_python(int(value) if value.is_integer() else value)
        for value in (low - 1.0, high + 1.0):
            with pytest.raises(ValidationError):
                adapter.validate_python(value)


def shown(setting: Setting) -> None:
    """A setting has words, a unit and, for a number, both bounds."""
    assert setting.meaning.strip()
    assert setting.unit
    number = isinstance(setting.default, int | float) and not isinstance(setting.default, bool)
    assert not number or (setting.minimum is not None and setting.maximum is not None), setting.name


@pytest.mark.parametrize("kind", [kind.kind for kind in describe_identification_kinds()])
def test_settings_of_an_identification_take_their_ends_and_nothing_beyond(kind: str) -> None:
    settings = next(one.settings for one in describe_identification_kinds() if one.kind == kind)
    for setting in settings:
        shown(setting)
        if setting.minimum is None or setting.maximum is None:
            continue
        for value in (setting.minimum, setting.maximum):
            REQUEST.validate_python({"kind": kind, setting.name: value})
        for value in (setting.minimum - 1, setting.maximum + 1):
            with pytest.raises(ValidationError, match=setting.name):
                REQUEST.validate_python({"kind": kind, setting.name: value})


@pytest.mark.parametrize("name", experiments_by_name())
def test_settings_of_an_experiment_take_their_ends_and_nothing_beyond(name: str) -> None:
    declared = [*experiments_by_name()[name].settings, *describe_settings(LoopSettings)]
    for setting in declared:
        shown(setting)
        if setting.kind not in ("number", "integer"):
            continue
        assert setting.minimum is not None
        assert setting.maximum is not None
        assert [setting.parse(value) for value in (setting.minimum, setting.maximum)] == [
            setting.minimum,
            setting.maximum,
        ]
        for value in (setting.minimum - 1, 2 * abs(setting.maximum) + 1):
            with pytest.raises(InvalidValueError):
                setting.parse(round(value) if setting.kind == "integer" else value)
