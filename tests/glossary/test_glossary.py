"""Glossary entries of signals, metrics, faults and states, and of form fields."""

import re
from dataclasses import fields, is_dataclass
from enum import StrEnum
from importlib import import_module
from pathlib import Path
from pkgutil import iter_modules
from typing import get_args

import pytest
from pydantic import TypeAdapter, ValidationError

from backend import analysis
from backend.analysis.evaluation import METRICS_BY_MEASURE, build_metric_documents
from backend.analysis.step_metrics import WholeMetrics
from backend.api.export import build_files
from backend.commissioning.status import StepState
from backend.errors import InvalidValueError
from backend.experiments.library import experiments_by_name
from backend.experiments.plans import LoopSettings
from backend.faults import EXPLANATIONS, Fault, Limit
from backend.glossary.glossary import (
    EQUATIONS,
    FORMS,
    RESULTS,
    GlossaryError,
    GlossaryTerm,
    TermKind,
    build_field_terms,
    build_glossary,
    parse_concepts,
    parse_faults,
    parse_limits,
    parse_notation,
    read_bounds,
)
from backend.identification.models import Grade
from backend.models.run import Outcome
from backend.models.settings import Setting, describe_settings
from backend.realtime.modes import Cause, HomingEnd, Mode
from backend.sample import FIELDS
from backend.schemas.base import UNITS
from backend.schemas.identification import IdentificationRequest
from backend.schemas.run import ChecklistState
from backend.schemas.state import ChainLinkView
from backend.services.jobs import describe_identification_kinds
from backend.storage.runs import EndState
from plant.parameters import MECHANISMS, SECTIONS
from tests.refusals import refused

# Every displayed term of signals, results, faults and states has a meaning and one source.

ROOT = Path(__file__).parents[2]
ENTRIES = build_glossary()


def entries_of(kind: TermKind) -> dict[str, GlossaryTerm]:
    return {entry.name: entry for entry in ENTRIES.values() if entry.kind is kind}


def test_every_signal_of_the_sample_has_a_meaning_and_a_unit() -> None:
    explained = {name: (entry.term, entry.unit, entry.meaning) for name, entry in entries_of(TermKind.SIGNAL).items()}
    assert explained == {one.name: (one.symbol, "" if one.unit == "1" else one.unit, one.meaning) for one in FIELDS}


def test_every_term_of_the_glossary_has_a_meaning_and_its_replaced_words() -> None:
    page = (ROOT / "docs" / "glossary.md").read_text(encoding="utf-8")
    rows = [line for line in page.splitlines() if line.startswith("| ") and not line.startswith("| Term |")]
    concepts = entries_of(TermKind.CONCEPT)
    assert len(concepts) == len(rows) > 50
    for row in rows:
        term, meaning, replaced = (cell.strip().replace("`", "") for cell in row.strip("|").split("|"))
        assert concepts[term].meaning == meaning
        assert dict(concepts[term].more).get("Not used", "") == replaced
    with refused(GlossaryError, "term_or_meaning_missing", heading="Actuator"):
        parse_concepts("\n## Actuator\n| Term | Meaning | Not |\n|---|---|---|\n| tendon |  | rope |\n")


@pytest.mark.parametrize(
    ("kind", "members"),
    [
        (TermKind.OUTCOME, Outcome),
        (TermKind.GRADE, Grade),
        (TermKind.END, EndState),
        (TermKind.MODE, Mode),
        (TermKind.STEP, StepState),
        (TermKind.SETUP, ChecklistState),
        (TermKind.CAUSE, (*Cause, *HomingEnd)),
        (TermKind.CHAIN, get_args(ChainLinkView.model_fields["name"].annotation)),
        (TermKind.LIMIT, [str(limit.name) for limit in Limit]),
        (TermKind.FAULT, [fault for fault in Fault if fault is not Fault.NONE]),
        (TermKind.CRITERION, ["pass", "fail", "not_measured"]),
    ],
)
def test_every_displayed_enum_member_has_an_entry(kind: TermKind, members: list[StrEnum | str]) -> None:
    assert set(entries_of(kind)) == {str(member) for member in members}


def test_every_metric_has_the_definition_of_its_result() -> None:
    for measured in METRICS_BY_MEASURE.values():
        for item in (one for one in vars(measured)["__dataclass_fields__"].values() if one.metadata):
            entry = entries_of(TermKind.FIGURE)[item.name]
            texts = {entry.meaning, *(text for _, text in entry.more)}
            assert item.metadata["definition"] in texts, item.name


def test_stored_metrics_have_the_definitions_of_the_glossary() -> None:
    stored = build_metric_documents(WholeMetrics(min_tension_N=1.0, max_tension_N=2.0, peak_voltage_V=3.0))
    assert [one.definition for one in stored] == [entries_of(TermKind.FIGURE)[one.name].meaning for one in stored]


def test_every_equation_belongs_to_a_metric() -> None:
    assert set(EQUATIONS) <= set(entries_of(TermKind.FIGURE))
    assert all(entries_of(TermKind.FIGURE)[name].equation == text for name, text in EQUATIONS.items())


def test_parameter_entries_match_the_parameters_of_the_plant() -> None:
    kinds = SECTIONS | MECHANISMS
    names = {f"{section}.{name}" for section, kind in kinds.items() for name in vars(kind)["__dataclass_fields__"]}
    assert set(entries_of(TermKind.PARAMETER)) == names


def test_fault_entries_have_the_message_and_remedy_of_the_state() -> None:
    for name, entry in entries_of(TermKind.FAULT).items():
        assert entry.meaning == EXPLANATIONS[Fault(name)].message
        assert dict(entry.more)["Remedy"] == EXPLANATIONS[Fault(name)].remedy
        assert [heading for heading, _ in entry.more] == ["Cause", "Reaction", "Within", "Remedy"]


def test_entries_have_a_meaning_and_contain_no_markup() -> None:
    for entry in ENTRIES.values():
        texts = [entry.meaning, entry.equation, entry.source, *(text for pair in entry.more for text in pair)]
        assert entry.meaning.strip(), entry.key
        assert not [text for text in texts if "`" in text or "](" in text or "backend." in text], entry.key
        assert entry.unit != "1"


def test_sources_are_the_paper_or_existing_documents() -> None:
    for entry in ENTRIES.values():
        cited = re.match(r"paper, |docs/decisions, decision \d+$", entry.source)
        assert not entry.source or cited or (ROOT / entry.source).is_file(), f"{entry.key}: {entry.source}"


def test_citations_of_the_paper_are_separated_from_equations() -> None:
    assert ENTRIES["signal:S"].source == "paper, equation (16)"
    assert ENTRIES["signal:S"].equation == "S = 2 r_j² (k1 + k2 r_m (θ_A + θ_B))"
    assert ENTRIES["parameter:geometry.r_m"].source == "paper, equations (1), (2)"
    assert ENTRIES["signal:t"].equation == "t = k T_s"
    assert ENTRIES["quantity:lam_motor"].source == "paper, table 2"


def test_a_missing_explanation_is_rejected_with_its_name() -> None:
    page = (ROOT / "docs" / "reference" / "faults.md").read_text(encoding="utf-8")
    with refused(GlossaryError, "fault_not_explained", fault="slack", needed="Cause, Reaction, Within, Remedy"):
        parse_faults(page.replace("### `slack`", "### `slacker`"))
    with refused(GlossaryError, "limits_not_explained", limits="GOVERNOR"):
        parse_limits(page.replace("| `GOVERNOR` |", "| `GOVERNED` |"))
    with refused(GlossaryError, "section_missing", heading="Signals"):
        parse_notation("# nothing\n")


def test_the_generated_module_matches_the_repository() -> None:
    written = (ROOT / "frontend" / "src" / "wire" / "glossary.gen.ts").read_text(encoding="utf-8")
    assert build_files()["glossary.gen.ts"] == written


def test_every_result_with_metrics_is_in_the_glossary() -> None:
    modules = [import_module(f"{analysis.__name__}.{found.name}") for found in iter_modules(analysis.__path__)]
    declaring = {
        kind
        for module in modules
        for kind in vars(module).values()
        if isinstance(kind, type) and is_dataclass(kind) and kind.__module__ == module.__name__
        if any("definition" in item.metadata for item in fields(kind))
    }
    assert declaring == set(RESULTS)


# Every form field has an explanation and the bounds that the service accepts.

REQUEST: TypeAdapter[IdentificationRequest] = TypeAdapter(IdentificationRequest)
UNEXPLAINED = ("kind",)
"""The page shows the kind as the choice of the form, not as a field."""


@pytest.mark.parametrize("form", FORMS)
def test_every_form_field_has_the_description_of_its_request(form: str) -> None:
    terms = {
        entry.name.removeprefix(f"{form}."): entry for entry in build_field_terms() if entry.name.startswith(f"{form}.")
    }
    declared = FORMS[form].model_fields
    assert set(terms) == set(declared) - set(UNEXPLAINED)
    for name, entry in terms.items():
        assert entry.kind is TermKind.SETTING
        unit = UNITS.get(name, "1")
        assert entry.unit == ("" if unit == "1" else unit)
        assert declared[name].description in (entry.meaning, f"{entry.meaning} [{unit}]")


@pytest.mark.parametrize("form", FORMS)
def test_displayed_bounds_match_the_bounds_of_the_request(form: str) -> None:
    request = FORMS[form]
    for name, field in request.model_fields.items():
        low, high = read_bounds(field)
        if low is None or high is None:
            continue
        adapter: TypeAdapter[object] = TypeAdapter(request.__pydantic_fields__[name].rebuild_annotation())
        term = next(entry for entry in build_field_terms() if entry.name == f"{form}.{name}")
        assert dict(term.more)["Accepted"].startswith(f"{low:g} to {high:g}")
        for value in (low, high):
            adapter.validate_python(int(value) if value.is_integer() else value)
        for value in (low - 1.0, high + 1.0):
            with pytest.raises(ValidationError):
                adapter.validate_python(value)


def assert_describes_itself(setting: Setting) -> None:
    """Check that a setting has a meaning, a unit and, for a number, both bounds."""
    assert setting.meaning.strip()
    assert setting.unit
    number = isinstance(setting.default, int | float) and not isinstance(setting.default, bool)
    assert not number or (setting.minimum is not None and setting.maximum is not None), setting.name


@pytest.mark.parametrize("kind", [kind.kind for kind in describe_identification_kinds()])
def test_settings_of_an_identification_accept_their_bounds_and_reject_values_beyond(kind: str) -> None:
    settings = next(one.settings for one in describe_identification_kinds() if one.kind == kind)
    for setting in settings:
        assert_describes_itself(setting)
        if setting.minimum is None or setting.maximum is None:
            continue
        for value in (setting.minimum, setting.maximum):
            REQUEST.validate_python({"kind": kind, setting.name: value})
        for value in (setting.minimum - 1, setting.maximum + 1):
            with pytest.raises(ValidationError, match=setting.name):
                REQUEST.validate_python({"kind": kind, setting.name: value})


@pytest.mark.parametrize("name", experiments_by_name())
def test_settings_of_an_experiment_accept_their_bounds_and_reject_values_beyond(name: str) -> None:
    declared = [*experiments_by_name()[name].settings, *describe_settings(LoopSettings)]
    for setting in declared:
        assert_describes_itself(setting)
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
