"""Stored identifications are read, written unchanged, and listed."""

import json
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path
from typing import Any

import pytest

from backend.analysis.identification_views import build_curves
from backend.identification.validation import read_whiteness_test
from backend.models import identification
from backend.models.document import DocumentCodec, UnreadableDocumentError
from backend.models.identification import ArxEstimate, FailedCandidate
from backend.models.upgrades import upgrade_quality
from backend.services.identifications import StoredIdentifications
from backend.services.tuning_state import default_tuning
from backend.storage import identifications
from backend.storage.banks import read_method_name
from backend.storage.database import Database, open_database
from backend.workers import WorkerProcess
from plant.parameters import load_parameters
from tests.models import earlier_identifications as earlier
from tests.models.earlier_identifications import put_identification
from tests.refusals import refused

TUNING = default_tuning(load_parameters("ideal"))[0]


@pytest.fixture
def database(tmp_path: Path) -> Iterator[Database]:
    with closing(open_database(tmp_path)) as opened:
        put_identification(opened, 1, "motor", earlier.MOTORS)
        put_identification(opened, 2, "spring", earlier.SPRINGS)
        put_identification(opened, 3, "actuator", earlier.ACTUATOR)
        put_identification(opened, None, "spring", earlier.TABLE)
        yield opened


def open_identifications(database: Database) -> StoredIdentifications:
    return StoredIdentifications(database, lambda _run: 1.0, WorkerProcess(print), lambda: TUNING)


@pytest.mark.parametrize(
    ("codec", "document"),
    [
        (identification.ACTUATOR_MODEL, earlier.ACTUATOR["model"]),
        (identification.ACTUATOR_QUALITY, earlier.ACTUATOR["quality"]),
        (identification.MOTOR_MODELS, earlier.MOTORS["model"]),
        (identification.MOTOR_QUALITIES, earlier.MOTORS["quality"]),
        (identification.SPRING_MODELS, earlier.SPRINGS["model"]),
        (identification.SPRING_QUALITIES, earlier.SPRINGS["quality"]),
        (identification.SPRING_MODELS, earlier.TABLE["model"]),
        (identification.SPRING_QUALITIES, earlier.TABLE["quality"]),
    ],
)
def test_reading_and_writing_a_document_only_adds_the_version(codec: DocumentCodec[Any], document: Any) -> None:
    written = codec.write(codec.read(document, "run 7"))
    assert written == {**document, "version": 1}
    assert list(written)[:-1] == list(document)
    assert codec.write(codec.read(written, "run 7")) == written


def test_the_page_lists_stored_identifications(database: Database) -> None:
    views = open_identifications(database).list_identifications()
    assert [view.kind for view in views] == ["actuator", "spring", "motor"]
    assert views[0].G_q is not None
    assert (views[0].S_nominal, views[0].G_q.K) == (10.5, 0.05)
    assert [one.name for one in views[1].springs] == ["A", "B"]
    assert [one.fitted.K_m for one in views[2].motors] == [2.88, 2.88]
    [table] = open_identifications(database).list_spring_tables()
    assert (table.file, table.spring.fits[0].order) == ("spring.csv", 2)
    with database.reading() as session:
        for estimate in identifications.find(session):
            assert any(build_curves(estimate).values())


def test_parts_that_early_versions_did_not_store_are_missing(database: Database) -> None:
    early = json.loads(json.dumps(earlier.ACTUATOR))
    del early["options"]["estimator"]
    for name in ("G_q", "G_S"):
        del early["model"][name]["method"]
        quality = early["quality"][name]
        for part in ("arx", "candidates", "frequency"):
            del quality[part]
        quality["residuals"] = {"whiteness": earlier.BAND, "input_correlation": earlier.BAND}
    early["quality"] = upgrade_quality("actuator", early["model"], early["quality"])
    put_identification(database, 4, "actuator", early)
    with database.reading() as session:
        found, current = identifications.of_run(session, 4), identifications.of_run(session, 3)
    quality = found.actuator.channel("G_q").quality
    assert (quality.arx, quality.candidates, quality.frequency) == (None, (), None)
    assert found.actuator_options.estimator is None
    assert read_method_name(found) == "output error"
    early_bound, bound = (
        read_whiteness_test(one.residuals.whiteness).bound for one in (quality, current.actuator.quality.G_q)
    )
    assert early_bound[0] > bound[0]  # early versions stored the band of one lag only
    assert isinstance(current.actuator.channel("G_q").quality.candidates[1], FailedCandidate)
    assert not isinstance(current.actuator.channel("G_q").quality.arx, ArxEstimate)


@pytest.mark.parametrize(
    ("changed", "code", "values"),
    [
        (
            {"model": {**earlier.ACTUATOR["model"], "version": 2}},
            "document_of_newer_version",
            {"label": "its model", "version": 2},
        ),
        (
            {"model": {**earlier.ACTUATOR["model"], "S_nominal": "stiff"}},
            "document_unreadable",
            {"label": "its model", "field": "S_nominal"},
        ),
        (
            {"quality": {**earlier.ACTUATOR["quality"], "G_S": {**earlier.QUALITY, "grade": "fine"}}},
            "document_unreadable",
            {"label": "the quality of its model", "field": "G_S.grade"},
        ),
        (
            {
                "quality": {
                    **earlier.ACTUATOR["quality"],
                    "G_S": {**earlier.QUALITY, "candidates": [{"structure": "first", "grade": "usable", "BIC": 1.0}]},
                }
            },
            "document_unreadable",
            {"label": "the quality of its model", "field": "G_S.candidates.0.TriedStructure.K"},
        ),
    ],
)
def test_unreadable_documents_are_reported_with_run_and_field(
    tmp_path: Path, changed: Any, code: str, values: dict[str, object]
) -> None:
    with closing(open_database(tmp_path)) as database:
        put_identification(database, 2, "spring", earlier.SPRINGS)
        put_identification(database, 3, "actuator", earlier.ACTUATOR | changed)
        with pytest.raises(UnreadableDocumentError) as caught:
            open_identifications(database).load_identification(3)
        message = caught.value.message
        assert (message.code, message.values) == (code, {**message.values, **values, "owner": "run 3"})
        views = open_identifications(database).list_identifications()
        assert [(view.id, view.G_q) for view in views] == [(3, None), (2, None)]
        assert message in views[0].message
        assert [one.name for one in views[1].springs] == ["A", "B"]


@pytest.mark.parametrize("part", ["model", "quality"])
def test_an_incomplete_spring_is_rejected(tmp_path: Path, part: str) -> None:
    document = {name: value for name, value in earlier.SPRINGS[part].items() if name != "B"}
    with closing(open_database(tmp_path)) as database:
        put_identification(database, 2, "spring", earlier.SPRINGS | {part: document})
        values = {"owner": "run 2", "label": "its model", "field": "B", "reason": "it is missing"}
        with refused(UnreadableDocumentError, "document_unreadable", **values):
            open_identifications(database).load_identification(2)
