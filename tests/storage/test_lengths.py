"""Each text that the program composes fits its column; a longer one is refused on SQLite as on PostgreSQL."""

import itertools
from collections.abc import Iterable
from dataclasses import replace
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest
from sqlalchemy import String, text

from backend import __version__
from backend.banks.tuning_settings import saved_tuning_key
from backend.commissioning.steps import StepId
from backend.errors import STATION_NAME_LENGTH
from backend.experiments import library
from backend.faults import Fault
from backend.identification.fitting import Fit
from backend.identification.models import joint_method_name
from backend.identification.validation import MAX_NOISE_ORDER
from backend.models.document import document_digest
from backend.models.run import Outcome
from backend.schemas.run import SEARCH_NAME_MAX
from backend.storage import identifications, runs
from backend.storage.database import Database
from backend.storage.events import EventKind
from backend.storage.imports import KINDS
from backend.storage.orm import TAG_MAX, Base, FormulaRow, QueuedRow, RunTagRow, StudyRow, UnfitError
from backend.storage.runs import EndState, RunKind
from backend.storage.search_index import NO_OUTCOME, ValueSource, insert_new, iterate_parameters
from backend.studies.point import FAILED, LOST, REFUSED
from plant.interface import FILE_NAME_MAX, NAME_MAX
from plant.parameters import load_parameters
from tests.storage.test_lineage import NEW_IDENTIFICATION, NEW_RUN

LONGEST_PERSON = "x" * 40 + " (viewer) 999"
"""A name at sign-in has at most 40 characters; the role and a number may follow it."""


def methods() -> Iterable[str]:
    """Yield each method that two channels can have, as ``Fit`` names the estimator of one."""
    channels = ["ARX with low-pass prefilter"]
    for order, low_pass, drive in itertools.product(range(MAX_NOISE_ORDER + 1), (0.0, 0.9), (None, object())):
        problem = SimpleNamespace(whitening=np.ones(order + 1), low_pass=low_pass)
        channels.append(Fit(cast(Any, SimpleNamespace(problem=problem)), cast(Any, drive)).method)
    for G_q, G_S in itertools.product(channels, repeat=2):
        yield joint_method_name({"G_q": G_q, "G_S": G_S})


DIGEST = [document_digest({})]
STATIONS = ["x" * STATION_NAME_LENGTH]
PEOPLE = [LONGEST_PERSON]
SOFTWARE = [__version__, f"{__version__}.post123.dev123+g{'0' * 12}"]
COMPOSED: dict[str, Iterable[str]] = {
    "bank.name": ["x" * 60],  # as the API bounds it
    "queued_experiment.name": ["x" * 60],  # as the API bounds it
    "bring_up.step": StepId,
    "bring_up.fingerprint": DIGEST,
    "chunk.sha256": DIGEST,
    "event.kind": EventKind,
    "experiment.name": library.READY_NAMES,
    "flight_record.fault": Fault,
    "formula.name": ["x" * 20],  # as the API bounds it
    "formula.unit": ["x" * 20],
    "identification.kind": ["actuator", "motor", "spring"],
    "identification.method": [*methods(), "least squares on position", "least-squares polynomials"],
    "identification.software": SOFTWARE,
    "origin.kind": KINDS,
    "origin.sha256": DIGEST,
    "parameter_value.parameters_sha256": DIGEST,
    "report.format": ["html", "pdf"],
    "result.software": SOFTWARE,
    "run.kind": RunKind,
    "run.plant": ["x" * NAME_MAX],
    "run.software": SOFTWARE,
    "run.end_state": EndState,
    "run_index.kind": RunKind,
    "run_index.parameters_sha256": DIGEST,
    "run_index.end_state": EndState,
    "run_index.outcome": [*Outcome, NO_OUTCOME],
    "run_tag.tag": ["x" * TAG_MAX],
    "setting.name": [
        saved_tuning_key(2**31 - 1),
        f"search/{'x' * SEARCH_NAME_MAX}",
        f"viewer-preferences/{LONGEST_PERSON}",
        f"hands at the {'x' * NAME_MAX}",
    ],
    "study.name": ["x" * 40],  # as its text bounds it
    "study.title": ["x" * 100],
    "study.runner": [f"{'x' * 64}:{2**22}"],
    "study_point.state": [*EndState, REFUSED, FAILED, LOST],
    "value_name.source": ValueSource,
    "value_name.name": [name for name, _ in iterate_parameters(load_parameters("lab").to_document())],
    "bring_up.wiring": ["x" * FILE_NAME_MAX],
    "run.parameters_name": ["x" * FILE_NAME_MAX],
}
assert StudyRow.metadata is QueuedRow.metadata is FormulaRow.metadata is Base.metadata, "their tables count too"
BOUNDED = {
    str(column): column.type.length
    for table in Base.metadata.sorted_tables
    for column in table.columns
    if isinstance(column.type, String) and column.type.length
}
WHO_AND_WHERE = {"who": PEOPLE, "station": STATIONS}
"""Columns that many tables have."""


@pytest.mark.parametrize("column", BOUNDED)
def test_what_the_program_composes_fits(column: str) -> None:
    composed = list(COMPOSED.get(column) or WHO_AND_WHERE[column.partition(".")[2]])
    assert composed
    assert [words for words in map(str, composed) if len(words) > BOUNDED[column]] == []


def test_each_list_is_of_a_column_that_there_is() -> None:
    assert set(COMPOSED) <= set(BOUNDED)


@pytest.mark.parametrize("column", BOUNDED)
def test_a_longer_text_is_refused_with_column_and_length(sqlite: Database, column: str) -> None:
    table, _, name = column.partition(".")
    (row,) = (mapper.class_ for mapper in Base.registry.mappers if mapper.class_.__tablename__ == table)
    longer = "x" * (BOUNDED[column] + 1)
    refused = rf"^{table}\.{name} .* {len(longer)} characters, {BOUNDED[column]} are the most"
    with sqlite.session() as session, pytest.raises(UnfitError, match=refused), session.begin_nested():
        session.add(row(**{name: longer}))
    with pytest.raises(UnfitError, match=refused), sqlite.session() as session:
        insert_new(session, row, [{name: longer}])


def test_the_longest_text_is_kept_whole_and_one_more_character_refused(database: Database) -> None:
    longest = "ö" * BOUNDED["identification.method"]
    with pytest.raises(UnfitError, match=r"^identification\.method .* 201 characters"), database.session() as session:
        identifications.add(session, replace(NEW_IDENTIFICATION, method=f"{longest}x"))
    with database.session() as session:
        run = runs.create(session, NEW_RUN)
        added = identifications.add(session, replace(NEW_IDENTIFICATION, run_id=run.id, method=longest))
        insert_new(session, RunTagRow, [{"run_id": run.id, "tag": "ö" * TAG_MAX}])
    with database.reading() as session:
        assert identifications.get(session, added.id).method == longest
        assert session.scalar(text("SELECT tag FROM run_tag")) == "ö" * TAG_MAX


def test_a_row_with_a_longer_text_from_an_earlier_version_can_be_changed_elsewhere(sqlite: Database) -> None:
    with sqlite.session() as session:
        run = runs.create(session, NEW_RUN)
        session.execute(text("UPDATE run SET parameters_name = :longer"), {"longer": "x" * 300})
    with sqlite.session() as session:
        runs.end(session, run.id, EndState.COMPLETED)
    with sqlite.reading() as session:
        assert runs.get(session, run.id).end_state == EndState.COMPLETED


def test_a_value_with_a_longer_name_is_stored_and_not_searched_by(database: Database) -> None:
    values = {"geometry": {name: {"value": 1.0} for name in ("r_m", "x" * 300)}}
    with database.session() as session:
        run = runs.create(session, replace(NEW_RUN, parameters=values))
    with database.reading() as session:
        assert runs.get(session, run.id).parameters == values
        assert list(session.scalars(text("SELECT name FROM value_name WHERE source = 'parameter'"))) == ["geometry.r_m"]
