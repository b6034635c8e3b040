"""Studies and their rows, on both kinds of database: each row once, exact, and of one station."""

from pathlib import Path

from backend.storage import studies
from backend.storage.database import Database, open_database
from backend.storage.orm import UnknownRecordError
from backend.storage.studies import NewStudy, StudyPoint
from tests.refusals import refused

NEW = NewStudy("map", "Map", "format: 1", {"software": "1.0.0"}, 3, "Ana")
FIRST = StudyPoint(0, "completed", "", True, {"lam_q": 0.1 + 0.2, "seed": 3}, {"rmse_q": 1e-300, "reach_q_s": None})
OTHER = StudyPoint(2, "refused", "λ_q: 0.1 s is outside", None, {"lam_q": 0.1}, {})


def begun(database: Database) -> int:
    with database.session() as session:
        return studies.add(session, NEW).id


def test_study_rows_are_read_back_unchanged_in_order_and_once(database: Database) -> None:
    study = begun(database)
    for points in ([OTHER], [FIRST, OTHER], []):
        with database.session() as session:
            studies.add_points(session, study, points)
    with database.reading() as session:
        assert studies.points(session, study) == [FIRST, OTHER]
        assert studies.points(session, study, first=1, limit=5) == [OTHER]
        assert studies.numbers(session, study) == {0, 2}
        assert studies.states(session, study) == {"completed": 1, "refused": 1}
        assert studies.count_rows(session, study) == 2


def test_a_study_runner_continues_until_a_stop_or_another_claim(database: Database) -> None:
    study = begun(database)

    def may(runner: str) -> bool:
        with database.session() as session:
            return studies.refresh_claim(session, study, runner)

    with database.session() as session:
        studies.claim(session, study, "one:1")
    assert may("one:1")
    with database.session() as session:
        studies.claim(session, study, "two:2")
    assert (may("one:1"), may("two:2")) == (False, True)
    with database.session() as session:
        studies.ask_to_stop(session, study)
        studies.release(session, study, "one:1", "not its own any more")
    assert not may("two:2")
    with database.reading() as session:
        assert (studies.get(session, study).runner, studies.get(session, study).problem) == ("two:2", "")
    with database.session() as session:
        assert not studies.claim(session, study, "three:3")  # the stop holds for whoever comes
        studies.want(session, study)
        assert studies.claim(session, study, "two:2")
    assert may("two:2")


def test_a_study_belongs_to_its_station(database: Database, tmp_path: Path) -> None:
    study = begun(database)
    url = database.engine.url.render_as_string(hide_password=False)
    other = open_database(tmp_path / "other", url, station="rig-b")
    with other.session() as session:
        assert studies.newest(session, 10) == []
        with refused(UnknownRecordError, "record_not_found", record="study", number=study):
            studies.get(session, study)
    other.close()
    with database.reading() as session:
        assert [found.id for found in studies.newest(session, 10)] == [study]
