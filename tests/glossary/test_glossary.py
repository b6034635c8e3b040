"""Explanations of words, and of boxes of forms."""

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
from plant.parameters import SECTIONS
from tests.refusals import refused

# Every word that the page shows of signals, results, faults and states has its meaning, and one source.

ROOT = Path(__file__).parents[2]
ENTRIES = build_glossary()


def of(kind: TermKind) -> dict[str, GlossaryTerm]:
    return {entry.name: entry for entry in ENTRIES.values() if entry.kind is kind}


def test_every_signal_of_the_sample_has_its_meaning_and_unit() -> None:
    explained = {name: (entry.term, entry.unit, entry.meaning) for name, entry in of(TermKind.SIGNAL).items()}
    assert explained == {one.name: (one.symbol, "" if one.unit == "1" else one.unit, one.meaning) for one in FIELDS}


def test_every_row_of_the_terms_is_explained_with_the_words_that_it_replaces() -> None:
    page = (ROOT / "docs" / "glossary.md").read_text(encoding="utf-8")
    rows = [line for line in page.splitlines() if line.startswith("| ") and not line.startswith("| Term |")]
    concepts = of(TermKind.CONCEPT)
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
def test_every_member_of_what_may_be_shown_has_an_entry(kind: TermKind, members: list[StrEnum | str]) -> None:
    assert set(of(kind)) == {str(member) for member in members}


def test_every_figure_of_a_result_is_explained_as_the_result_itself_does() -> None:
    for measured in METRICS_BY_MEASURE.values():
        for item in (one for one in vars(measured)["__dataclass_fields__"].values() if one.metadata):
            entry = of(TermKind.FIGURE)[item.name]
            said = {entry.meaning, *(text for _, text in entry.more)}
            assert item.metadata["definition"] in said, item.name


def test_a_stored_figure_carries_a_definition_that_the_glossary_knows() -> None:
    stored = build_metric_documents(WholeMetrics(min_tension_N=1.0, max_tension_N=2.0, peak_voltage_V=3.0))
    assert [one.definition for one in stored] == [of(TermKind.FIGURE)[one.name].meaning for one in stored]


def test_equations_are_of_figures_that_there_are() -> None:
    assert set(EQUATIONS) <= set(of(TermKind.FIGURE))
    assert all(of(TermKind.FIGURE)[name].equation == text for name, text in EQUATIONS.items())


def test_parameters_are_those_of_the_plant() -> None:
    names = {f"{section}.{name}" for section, kind in SECTIONS.items() for name in vars(kind)["__dataclass_fields__"]}
    assert set(of(TermKind.PARAMETER)) == names


def test_faults_say_what_the_state_says_and_what_to_do() -> None:
    for name, entry in of(TermKind.FAULT).items():
        assert entry.meaning == EXPLANATIONS[Fault(name)].message
        assert dict(entry.more)["Remedy"] == EXPLANATIONS[Fault(name)].remedy
        assert [heading for heading, _ in entry.more] == ["Cause", "Reaction", "Within", "Remedy"]


def test_no_entry_is_without_words_nor_has_marks_of_its_page_in_them() -> None:
    for entry in ENTRIES.values():
        told = [entry.meaning, entry.equation, entry.source, *(text for pair in entry.more for text in pair)]
        assert entry.meaning.strip(), entry.key
        assert not [text for text in told if "`" in text or "](" in text or "backend." in text], entry.key
        assert entry.unit != "1"


def test_sources_are_the_paper_or_pages_that_there_are() -> None:
    for entry in ENTRIES.values():
        cited = re.match(r"paper, |docs/decisions, decision \d+$", entry.source)
        assert not entry.source or cited or (ROOT / entry.source).is_file(), f"{entry.key}: {entry.source}"


def test_citations_of_the_paper_are_told_from_equations() -> None:
    assert ENTRIES["signal:S"].source == "paper, equation (16)"
    assert ENTRIES["signal:S"].equation == "S = 2 r_j² (k1 + k2 r_m (θ_A + θ_B))"
    assert ENTRIES["parameter:geometry.r_m"].source == "paper, equations (1), (2)"
    assert ENTRIES["signal:t"].equation == "t = k T_s"
    assert ENTRIES["quantity:lam_motor"].source == "paper, table 2"


def test_what_a_page_does_not_explain_is_refused_by_name() -> None:
    page = (ROOT / "docs" / "reference" / "faults.md").read_text(encoding="utf-8")
    with refused(GlossaryError, "fault_not_explained", fault="slack", needed="Cause, Reaction, Within, Remedy"):
        parse_faults(page.replace("### `slack`", "### `slacker`"))
    with refused(GlossaryError, "limits_not_explained", limits="GOVERNOR"):
        parse_limits(page.replace("| `GOVERNOR` |", "| `GOVERNED` |"))
    with refused(GlossaryError, "section_missing", heading="Signals"):
        parse_notation("# nothing\n")


def test_the_generated_module_is_the_one_in_the_repository() -> None:
    written = (ROOT / "frontend" / "src" / "wire" / "glossary.gen.ts").read_text(encoding="utf-8")
    assert build_files()["glossary.gen.ts"] == written


def test_every_result_that_declares_figures_is_in_the_glossary() -> None:
    modules = [import_module(f"{analysis.__name__}.{found.name}") for found in iter_modules(analysis.__path__)]
    declaring = {
        kind
        for module in modules
        for kind in vars(module).values()
        if isinstance(kind, type) and is_dataclass(kind) and kind.__module__ == module.__name__
        if any("definition" in item.metadata for item in fields(kind))
    }
    assert declaring == set(RESULTS)


# Each box of a form is explained, and with the bounds that the service accepts.

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
