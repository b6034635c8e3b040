"""The search for runs, their tags, and the metrics of the list."""

from collections.abc import Callable
from contextlib import closing
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, cast

import pytest
from sqlalchemy import text

from backend.models.run import MeasuredFigure, Metrics, RunCriterion
from backend.services.comparison import build_metric_history
from backend.services.runs import RunQuery, StoredRuns
from backend.storage import banks, identifications, results, runs, search, search_index, tags
from backend.storage.banks import BankEntry
from backend.storage.database import Database, Session, open_database
from backend.storage.results import NewResult
from backend.storage.runs import EndState, NewRun, RunKind
from backend.storage.search import QueryError, parse_query
from tests.bench.many_runs import Made, make_runs
from tests.exports.stored import ESTIMATE, recorded
from tests.models.earlier_identifications import QUALITY
from tests.refusals import refused
from tests.storage.refused_search import refused_search
from tests.storage.test_lineage import METRICS, NEW_RUN

# Runs are found by all their stored data; an invalid search is rejected with the position.

PARAMETERS = {
    "geometry": {"r_j": {"value": 0.075, "unit": "m"}},
    "spring": {"k": {"value": [-2.498, 331.49]}, "name": {"value": "soft"}},
}
NEW = NewRun(
    kind=RunKind.TRACKING,
    plant="simulator",
    parameters_name="lab",
    parameters=PARAMETERS,
    who="Ana",
    software="1.0.0",
    settings={"plan": {"q_amplitude": 1.25, "controller": "cascade"}, "loop": {"lam_q": 0.6, "interpolate": True}},
)
Find = Callable[[str], set[str]]


def metrics(overshoot: float | None, complete: bool = True) -> Metrics:
    figure = MeasuredFigure(
        "overshoot_q_percent", "%", "Overshoot of q", "", overshoot, "" if overshoot else "not seen"
    )
    return Metrics(complete=complete, played_s=1.0, planned_s=1.0, figures=(figure,))


def criterion(passed: bool | None) -> tuple[RunCriterion, ...]:
    return (RunCriterion("overshoot_q", "Overshoot of q", "<", 5.0, 1.0, "%", passed=passed),)


@pytest.fixture
def find(database: Database) -> Find:
    """Six runs by name, and what finds them."""
    names: dict[int, str] = {}

    def add(session: Session, name: str, new: NewRun, end: EndState = EndState.COMPLETED) -> int:
        run = runs.create(session, new)
        names[run.id] = name
        if end is not EndState.RUNNING:
            runs.end(session, run.id, end)
        return run.id

    other = {**PARAMETERS, "geometry": {"r_j": {"value": 0.08, "unit": "m"}}}
    with database.session() as session:
        bank = banks.add(session, "Bench", [BankEntry(8.0, {})], who="Ana")
        good = add(session, "good", replace(NEW, bank_id=bank.id))
        results.add(session, NewResult(good, metrics(3.0), criterion(True), "1"))
        bad = add(session, "bad", replace(NEW, who="Bo", note='Sehne "gerissen", Straße', parameters=other))
        results.add(session, NewResult(bad, metrics(12.5), criterion(False), "1"))
        unmeasured = add(session, "unmeasured", replace(NEW, kind=RunKind.COMPLIANCE))
        results.add(session, NewResult(unmeasured, metrics(None), criterion(None), "1"))
        add(session, "tripped", replace(NEW, note="100% worn"), EndState.TRIPPED)
        add(session, "session", replace(NEW, kind=RunKind.SESSION, settings={"mode": "run"}, parameters={}))
        own = {"plan": {"experiment": '{"name": "my_battery", "title": "Meine Batterie"}'}}
        add(session, "open", replace(NEW, kind=RunKind.EXPERIMENT, settings=own), EndState.RUNNING)
        tags.add(session, good, "Paper")
        tags.add(session, bad, "worn")
        tags.add(session, good, "rig:2")

    def found(query: str) -> set[str]:
        with database.reading() as session:
            page = search.search(session, parse_query(query), everywhere=False, limit=100)
            assert page.total == len(page.run_ids)
            assert list(page.run_ids) == sorted(page.run_ids, reverse=True)
            return {names[number] for number in page.run_ids}

    return found


ALL = {"good", "bad", "unmeasured", "tripped", "session", "open"}


FINDS = {
    "": ALL,
    "kind = tracking": {"good", "bad", "tripped"},
    "kind=my_battery": {"open"},
    "experiment = my_battery": {"open"},
    "title ~ batterie": {"open"},
    "kind = tracking, compliance": {"good", "bad", "tripped", "unmeasured"},
    "kind != tracking, compliance": {"session", "open"},
    "bank = bench": {"good"},
    "bank = BENCH@1": {"good"},
    "bank = none": ALL - {"good"},
    "plant = simulator who = bo": {"bad"},
    "geometry.r_j > 0.0775": {"bad"},
    "geometry.r_j = 0.075": ALL - {"bad", "session"},
    "parameter.geometry.r_j = none": {"session"},
    "spring.k.1 > 331": ALL - {"session"},
    "lam_q = 0.6 and not kind = tracking": {"unmeasured"},
    "q_amplitude >= 71.6deg q_amplitude < 72deg kind=compliance": {"unmeasured"},
    "controller = Cascade kind = compliance": {"unmeasured"},
    "mode = run": {"session"},
    "interpolate = yes kind=compliance": {"unmeasured"},
    "overshoot_q_percent < 5": {"good"},
    "overshoot_q_percent <= 12.5": {"good", "bad"},
    "overshoot_q_percent != 3": {"bad"},
    "not overshoot_q_percent < 5": ALL - {"good"},
    "metric.overshoot_q_percent = none": ALL - {"good", "bad"},
    "setting.lam_q != none": {"good", "bad", "unmeasured", "tripped"},
    "gerissen": {"bad"},
    "STRASSE": {"bad"},
    '"sehne \\"gerissen"': {"bad"},
    "100%": {"tripped"},
    "%": {"tripped"},
    "worn": {"tripped", "bad"},
    "note ~ worn": {"tripped"},
    "note = none": ALL - {"tripped", "bad"},
    "tag = paper": {"good"},
    "tag = PAPER, worn": {"good", "bad"},
    "tag != paper": ALL - {"good"},
    "tag = none": ALL - {"good", "bad"},
    "tag ~ rig": {"good"},
    "end = tripped": {"tripped"},
    "verdict = passed": {"good"},
    "verdict = failed, incomplete": {"bad", "unmeasured", "tripped"},
    "verdict = none": {"session", "open"},
    "(who = bo or end = tripped) kind = tracking": {"bad", "tripped"},
    "who = bo or end = tripped and kind = compliance": {"bad"},
    "station = none": ALL,
    'station ~ ""': ALL,
    "lasted_s < 3600": ALL - {"open"},
    "not lasted_s >= 0": {"open"},
    "not lasted_s < 0": ALL,
    "lasted_s = none": {"open"},
    "lasted_s != none": ALL - {"open"},
    "overshoot_q_percent = none, 3": ALL - {"bad"},
    "overshoot_q_percent != none, 3": {"bad"},
    "geometry.r_j = none, 0.08": {"session", "bad"},
    "controller = cascade, none": ALL,
    'worn ")" or who = bo': {"bad"},
    "date >= 2001-01-01": ALL,
    "date < 2001": set(),
}


def test_a_search_finds_matching_runs(find: Find) -> None:
    assert {query: find(query) for query in FINDS} == FINDS


REFUSED: tuple[tuple[str, int, str, dict[str, object]], ...] = (
    ("overshot_q_percent < 5", 1, "name_in_no_run", {"name": "overshot_q_percent"}),
    ("kind = trakcing", 8, "value_not_known", {"attribute": "kind of run", "value": "trakcing"}),
    ("end = gone", 7, "value_not_known", {"attribute": "end", "value": "gone"}),
    ("verdict = good", 11, "value_not_known", {"attribute": "verdict", "value": "good"}),
    ("station = rig-9", 11, "value_not_known", {"attribute": "station", "value": "rig-9"}),
    ("overshoot_q_percent < many", 23, "not_a_number", {"name": "overshoot_q_percent", "value": "many"}),
    ("overshoot_q_percent < nan", 23, "not_a_number", {"value": "nan"}),
    ("overshoot_q_percent = many", 23, "not_a_number", {"value": "many"}),
    ("overshoot_q_percent != 0%", 24, "not_a_number", {"value": "0%"}),
    ("lam_q = 0.4rad", 9, "not_a_number", {"name": "lam_q", "value": "0.4rad"}),
    ("lam_q = 0.4, nan", 14, "not_a_number", {"value": "nan"}),
    ("overshoot_q_percent ~ 0", 1, "operator_not_for_number", {"name": "overshoot_q_percent"}),
    ("controller < 5", 1, "operator_not_for_word", {"name": "controller", "operator": "<"}),
    ("date > yesterday", 8, "not_a_date", {"value": "yesterday"}),
    ("date > 2026-02-30", 8, "not_a_date", {"value": "2026-02-30"}),
    ("date ~ 2026", 1, "operator_not_for_date", {}),
    ("who < bo", 1, "operator_not_for_text", {"name": "who", "operator": "<"}),
    ("end < running", 1, "operator_not_for_choice", {"name": "end", "operator": "<"}),
    ("tag > a", 1, "operator_not_for_tag", {"operator": ">"}),
    ("lasted_s ~ 5", 1, "operator_not_for_number", {"name": "lasted_s"}),
    ("(kind = tracking", 1, "bracket_not_closed", {}),
    ("kind = tracking)", 16, "unexpected_token", {"token": ")"}),
    ("kind =", 7, "value_missing", {"token": "="}),
    ("= 5", 1, "not_a_term", {"token": "="}),
    ("a and", 6, "term_missing", {}),
    ('who = "bo', 7, "quote_not_closed", {}),
    ("lam_q < 1, 2", 12, "too_many_values", {"operator": "<"}),
    ("!", 1, "meaningless_character", {"character": "!"}),
    ("a \x00", 3, "unprintable_character", {}),
    ("not " * 30 + "a", 85, "nested_too_deep", {"maximum": 20}),
    ("a " * 61, 121, "too_many_terms", {"maximum": 60}),
    ("x" * 1001, 1001, "search_too_long", {"maximum": 1000}),
)


def test_a_run_is_found_by_every_notation_of_its_number(database: Database) -> None:
    with database.session() as session:
        numbers = [runs.create(session, replace(NEW, note=note)).id for note in ("2 kg", "run 1 again", "")]
    first, second, _ = numbers
    queries = {
        f"run {first}": [first],
        f"Run {second}": [second],
        f"run {first} or run {second}": [second, first],
        f"not run {first} again": [second],
        f'"run {first}"': [second],
        "run 2 = 3": None,
    }

    def found(query: str) -> list[int] | None:
        with database.reading() as session:
            try:
                return list(search.search(session, parse_query(query), everywhere=False, limit=9).run_ids)
            except QueryError:
                return None

    assert (first, second) == (1, 2)
    assert {query: found(query) for query in queries} == queries


def test_an_invalid_search_is_rejected_with_the_position(find: Find) -> None:
    for query, place, code, values in REFUSED:
        with refused_search(place, code, **values):
            find(query)


def test_an_unknown_word_is_rejected_with_suggestions(find: Find) -> None:
    for query, near in (("overshot_q_percent < 5", "overshoot_q_percent"), ("kind = trakcing", "tracking")):
        with pytest.raises(QueryError) as caught:
            find(query)
        assert near in cast(list[str], caught.value.message.values["near"])
    for query, known in (("end = gone", ["running", "completed"]), ("verdict = good", ["passed"])):
        with pytest.raises(QueryError) as caught:
            find(query)
        values = caught.value.message.values
        assert (values["near"], cast(list[str], values["known"])[: len(known)]) == ([], known)


def test_dates_are_years_months_days_and_minutes(database: Database) -> None:
    with database.session() as session:
        told = ("2026-03-01T00:00Z", "2026-03-01T23:59Z", "2026-03-02T00:00Z", "2026-12-31T12:00Z")
        moments = [datetime.fromisoformat(moment) for moment in told]
        numbers = {runs.create(session, NEW).id: moment for moment in moments}
    with database.session() as session:
        for number, moment in numbers.items():
            session.execute(
                text("UPDATE run SET started_at = :at WHERE id = :id"),
                {"at": moment.replace(tzinfo=None), "id": number},
            )
            search_index.update(session, [number])

    def found(query: str) -> int:
        with database.reading() as session:
            return search.search(session, parse_query(query), everywhere=False, limit=1).total

    asked = ("date=2026-03-01", "date>2026-03-01", "date<=2026-03-01", "date=2026-03", "date=2026", "date=2026-12")
    assert [found(query) for query in asked] == [2, 2, 2, 3, 4, 1]
    assert found("date=2026-03-01T23:59") == 1
    assert found("date!=2026-03") == 1
    assert found("date>=2026-12-31T12:00") == 1


def test_search_results_follow_changes(database: Database) -> None:
    with database.session() as session:
        number = runs.create(session, NEW).id

    def total(query: str) -> int:
        with database.reading() as session:
            return search.search(session, parse_query(query), everywhere=False, limit=1).total

    assert (total("end=running"), total("verdict=none")) == (1, 1)
    with database.session() as session:
        runs.end(session, number, EndState.COMPLETED)
    assert (total("end=running"), total("verdict=incomplete")) == (0, 1)
    with database.session() as session:
        results.add(session, NewResult(number, metrics(9.0), (), "1"))
        runs.set_note(session, number, "slack")
    assert (total("overshoot_q_percent > 8"), total("verdict=neutral"), total("slack")) == (1, 1, 1)
    with database.session() as session:
        results.add(session, NewResult(number, metrics(2.0), (), "1"))
        runs.set_note(session, number, "")
    assert (total("overshoot_q_percent > 8"), total("slack")) == (0, 0)
    with database.session() as session:
        runs.create(session, NEW)
    with database.session() as session:
        assert len(runs.close_interrupted(session)) == 1
    assert total("end=service_died") == 1


def test_an_index_of_an_earlier_version_is_rebuilt(database: Database) -> None:
    with database.session() as session:
        number = runs.create(session, NEW).id
    with database.session() as session:
        session.execute(text("UPDATE run_index SET version = 0, words = ''"))
        lost = runs.create(session, NEW).id
    with database.session() as session:
        session.execute(text("DELETE FROM run_index WHERE run_id = :id"), {"id": lost})
    with database.session() as session:
        assert search.search(session, parse_query("ana"), everywhere=False, limit=9).total == 0
        assert search_index.is_behind(session)
        assert search_index.renew(session) == 2
        assert not search_index.is_behind(session)
        assert search.search(session, parse_query("ana"), everywhere=False, limit=9).run_ids == (lost, number)


def test_a_partly_unreadable_run_is_found_by_its_readable_fields(database: Database) -> None:
    with database.session() as session:
        number = runs.create(session, replace(NEW, settings={"version": 99})).id
        session.execute(
            text(
                "INSERT INTO result (run_id, metrics, criteria, software, created_at) VALUES (:id, '3', '[]', '', :at)"
            ),
            {"id": number, "at": datetime(2026, 1, 1)},
        )
        runs.end(session, number, EndState.COMPLETED)
    with database.reading() as session:
        for query in ("who=ana", "verdict=incomplete", "kind=tracking"):
            assert search.search(session, parse_query(query), everywhere=False, limit=9).run_ids == (number,)


def test_an_ambiguous_name_must_be_qualified(database: Database) -> None:
    figure = MeasuredFigure("lam_q", "s", "λ", "", 0.9)
    with database.session() as session:
        number = runs.create(session, NEW).id
        runs.end(session, number, EndState.COMPLETED)
        told = Metrics(complete=True, played_s=1.0, planned_s=1.0, figures=(figure,))
        results.add(session, NewResult(number, told, (), "1"))
    with database.reading() as session:
        with refused_search(1, "name_ambiguous", name="lam_q", candidates=["setting.lam_q", "metric.lam_q"]):
            search.search(session, parse_query("lam_q < 1"), everywhere=False, limit=9)
        for query, expected in (("setting.lam_q < 0.7", 1), ("metric.lam_q < 0.7", 0)):
            assert search.search(session, parse_query(query), everywhere=False, limit=9).total == expected


def test_the_searchable_names_are_listed(find: Find, database: Database) -> None:
    assert find("") == ALL
    with database.reading() as session:
        known = search.known_words(session)
    assert known.tags == ("paper", "rig:2", "worn")
    assert known.stations == ("",)
    assert {"tracking", "my_battery", "session"} <= set(known.kinds)
    assert known.values["metric"] == ("overshoot_q_percent",)
    assert known.values["parameter"] == ("geometry.r_j", "spring.k.0", "spring.k.1")
    assert set(known.values["setting"]) == {"controller", "interpolate", "lam_q", "mode", "q_amplitude"}


# Tags of runs: added, removed, renamed; invalid tags are rejected.


def test_tags_are_added_removed_and_renamed(database: Database) -> None:
    with database.session() as session:
        first, second = (runs.create(session, NEW).id for _ in range(2))
        tags.add(session, first, "Worn")
        tags.add(session, first, "worn")
        tags.add(session, first, "old")
        tags.add(session, second, "worn")
        assert tags.of_runs(session, [first, second]) == {first: ["old", "worn"], second: ["worn"]}
        assert tags.rename(session, "worn", "old") == 2
        assert tags.of_runs(session, [first, second]) == {first: ["old"], second: ["old"]}
        tags.take(session, first, "OLD")
        assert tags.of_runs(session, [first, second]) == {second: ["old"]}
    with database.reading() as session:
        assert search.search(session, parse_query("old"), everywhere=False, limit=9).run_ids == (second,)


def test_an_accent_may_be_typed_as_one_character_or_two(database: Database) -> None:
    composed, decomposed = "pr\u00fcfstand", "Pru\u0308fstand"
    with database.session() as session:
        number = runs.create(session, NEW).id
        tags.add(session, number, decomposed)
        assert tags.of_runs(session, [number]) == {number: [composed]}
    with database.reading() as session:
        for typed in (composed, decomposed):
            asked = parse_query(f"tag={typed}")
            assert search.search(session, asked, everywhere=False, limit=9).run_ids == (number,)


NO_TAGS = ("", "none", "two words", "a,b", 'a"b', "a=b", "x" * 41, "\x00", "a/b")


def test_invalid_tags_are_rejected(database: Database) -> None:
    with database.session() as session:
        number = runs.create(session, NEW).id
        for tag in NO_TAGS:
            with refused(tags.TagError, "invalid_tag", tag=tag, maximum=40):
                tags.add(session, number, tag)
            with refused(tags.TagError, "invalid_tag", tag=tag, maximum=40):
                tags.rename(session, "worn", tag)


# A metric over the dates of its runs: whatever any of them has can be asked for.

NEWER = 25
"""More than are looked through for what their metrics are."""


def test_a_metric_that_only_older_runs_have_is_shown(database: Database) -> None:
    older = MeasuredFigure("settling", "s", "Settling", "", 0.7)
    with database.session() as session:
        for figures in ((*METRICS.figures, older), *[METRICS.figures] * NEWER):
            run = runs.create(session, replace(NEW_RUN, kind=RunKind.TRACKING)).id
            runs.end(session, run, EndState.COMPLETED)
            results.add(session, NewResult(run, replace(METRICS, figures=figures), (), "1"))
    with database.reading() as session:
        found = build_metric_history(session, "tracking", "settling", "", everywhere=False)
        assert found.metric is not None
        assert (found.metric.label, [point.value for point in found.points]) == ("Settling", [0.7])
        assert found.without == NEWER
        assert [one.name for one in found.metrics] == ["overshoot", "settling"]
        assert len(build_metric_history(session, "tracking", "", "", everywhere=False).points) == NEWER + 1
        for unknown in ("setling", "overshoot.x"):
            with pytest.raises(QueryError, match="have no metric"):
                build_metric_history(session, "tracking", unknown, "", everywhere=False)
        with pytest.raises(QueryError, match="have no metric 'settling'"):
            build_metric_history(session, "compliance", "settling", "", everywhere=False)


# A run that identified the actuator shows the lower fit of its newest estimate as its key figure.


def fit_of(value: float, other: float) -> dict[str, dict[str, Any]]:
    return {"G_q": QUALITY | {"fit_percent": value}, "G_S": QUALITY | {"fit_percent": other}}


def test_the_newest_estimate_determines_the_headline_metric(database: Database) -> None:
    with database.session() as session:
        run, bare = recorded(session), recorded(session)
        identifications.add(session, replace(ESTIMATE, run_id=run, quality=fit_of(50.0, 60.0)))
        identifications.add(session, replace(ESTIMATE, run_id=run, quality=fit_of(97.0, 91.5)))
    with database.reading() as session:
        assert identifications.fits_of_runs(session, [run, bare]) == {run: {"G_q": 97.0, "G_S": 91.5}}
    listed = {one.id: one for one in StoredRuns(database, lambda: None, lambda _run: False).find_runs(RunQuery()).runs}
    headline = listed[run].headline
    assert headline is not None
    assert (headline.name, headline.label, headline.value, headline.unit) == ("fit_percent", "Fit of G_S", 91.5, "%")
    assert listed[bare].headline is None


# A search among many runs finds the same runs as a check of each run.

COUNT = 600
FITS: dict[str, Callable[[Made], bool]] = {
    "": lambda run: True,
    "worn": lambda run: "worn" in run.note,
    "kind = tracking": lambda run: run.kind is RunKind.TRACKING,
    "overshoot_q_percent < 5": lambda run: run.overshoot is not None and run.overshoot < 5,
    "not overshoot_q_percent < 5": lambda run: run.overshoot is None or run.overshoot >= 5,
    "overshoot_q_percent = none": lambda run: run.overshoot is None,
    "geometry.r_j > 0.0725": lambda run: run.r_j > 0.0725,
    "tag = paper": lambda run: run.number % 13 == 0,
    "verdict = failed": lambda run: run.overshoot is not None and run.overshoot >= 5,
    "who ~ öz or end = tripped": lambda run: "Öz" in run.who or run.end is EndState.TRIPPED,
    "lam_q >= 0.5 date >= 2026-01-03": lambda run: run.lam_q >= 0.5 and run.started >= datetime(2026, 1, 3, tzinfo=UTC),
    "figure_7 = 3 not kind = compliance": lambda run: (
        run.kind not in (RunKind.SESSION, RunKind.COMPLIANCE) and run.number % 9 == 3
    ),
}


def test_each_search_finds_matching_runs_page_by_page(tmp_path: Path) -> None:
    with closing(open_database(tmp_path)) as database:
        made = make_runs(database, COUNT)
        stored = StoredRuns(database, lambda: None, lambda _run: False)
        for where, fits in FITS.items():
            expected = [number for number in sorted(made, reverse=True) if fits(made[number])]
            assert 0 < len(expected) <= COUNT
            found: list[int] = []
            while True:
                page = stored.find_runs(RunQuery(where=(where,), limit=130, offset=len(found)))
                assert page.total == len(expected)
                found += [run.id for run in page.runs]
                if not page.runs:
                    break
            assert found == expected, where
            first = stored.find_runs(RunQuery(where=(where,), limit=1)).runs[0]
            assert (first.note, first.who) == (made[first.id].note, made[first.id].who)
