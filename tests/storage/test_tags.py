"""Tags of runs: put on, taken off, renamed; what is no tag is refused."""

import pytest

from backend.storage import runs, search, tags
from backend.storage.database import Database
from backend.storage.search import parse_query
from tests.storage.test_run_search import NEW


def test_tags_are_put_taken_and_renamed(database: Database) -> None:
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


def test_what_is_no_tag_is_refused(database: Database) -> None:
    with database.session() as session:
        number = runs.create(session, NEW).id
        for tag in NO_TAGS:
            with pytest.raises(tags.TagError, match="letters, digits"):
                tags.add(session, number, tag)
            with pytest.raises(tags.TagError, match="letters, digits"):
                tags.rename(session, "worn", tag)
