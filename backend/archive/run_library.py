"""Many runs: what they can be searched by, saved searches, tags, runs beside each other, a metric over their dates."""

import asyncio
from collections.abc import Sequence

from backend.archive import comparison
from backend.errors import Because, RefusalError
from backend.plain_text import PlainTextError, require_line
from backend.schemas.comparison import ComparisonAsked, RunComparison
from backend.schemas.run import SEARCH_NAME_MAX, MetricHistory, SavedSearch, SavedSearchList, SearchWords, TagList
from backend.storage import search, settings, tags
from backend.storage.database import Database
from backend.storage.orm import UnknownRecordError, require_distinct
from backend.storage.search import ENDS, VERDICTS, parse

_SEARCH = "search/"


class RunLibrary:
    """Reads and writes the database in threads. Saved searches are settings: what one was before stays there."""

    def __init__(self, database: Database) -> None:
        self._database = database

    async def words(self) -> SearchWords:
        """Return what runs can be searched by."""
        return await asyncio.to_thread(self._words)

    async def searches(self) -> SavedSearchList:
        """Return the saved searches of the station."""
        return await asyncio.to_thread(self.saved_searches)

    async def save_search(self, name: str, where: str, who: str) -> SavedSearchList:
        """Save a search under a name. Raises QueryError, RefusalError."""
        return await asyncio.to_thread(self.keep_search, name, where, who)

    async def forget_search(self, name: str, who: str) -> SavedSearchList:
        """Take a search off the list. Raises UnknownRecordError."""
        return await asyncio.to_thread(self.drop_search, name, who)

    async def put_tag(self, run_id: int, tag: str) -> None:
        """Put a tag on a run. Raises TagError, UnknownRecordError."""
        await asyncio.to_thread(self.tag, [run_id], [tag], [])

    async def take_tag(self, run_id: int, tag: str) -> None:
        """Take a tag off a run. Raises TagError, UnknownRecordError."""
        await asyncio.to_thread(self.tag, [run_id], [], [tag])

    async def rename_tag(self, before: str, after: str) -> TagList:
        """Call a tag otherwise on all runs of the station. Raises TagError, UnknownRecordError."""
        await asyncio.to_thread(self.rename, before, after)
        return TagList(tags=(await self.words()).tags)

    async def comparison(self, asked: ComparisonAsked) -> RunComparison:
        """Set runs beside each other. Raises RefusalError, UnknownRecordError."""
        return await asyncio.to_thread(self.compared, asked)

    async def metric_history(self, kind: str, metric: str, where: str, *, everywhere: bool) -> MetricHistory:
        """Return a metric of a kind of runs over their dates. Raises QueryError."""
        return await asyncio.to_thread(self.history, kind, metric, where, everywhere=everywhere)

    # At once, for the command line too ----------------------------------------------------------------------

    def saved_searches(self) -> SavedSearchList:
        """Return the saved searches of the station."""
        with self._database.reading() as session:
            kept = settings.newest_under(session, _SEARCH)
        found = [
            SavedSearch(name=one.name.removeprefix(_SEARCH), where=one.value["where"], who=one.who)
            for one in kept
            if one.value is not None
        ]
        return SavedSearchList(searches=found)

    def where_of(self, name: str) -> str:
        """Return the text of a saved search. Raises UnknownRecordError."""
        known = {one.name: one.where for one in self.saved_searches().searches}
        if name not in known:
            raise UnknownRecordError(f"there is no saved search {name!r}; there are: {', '.join(known) or 'none'}")
        return known[name]

    def keep_search(self, name: str, where: str, who: str) -> SavedSearchList:
        """Save a search that can be asked now under a name. Raises QueryError, RefusalError."""
        called = name.strip()
        if not 1 <= len(called) <= SEARCH_NAME_MAX:
            why = f"{called[:SEARCH_NAME_MAX]!r} is not 1 to {SEARCH_NAME_MAX} characters"
            raise RefusalError(Because.BAD_VALUE, f"name of the search: {why}")
        try:
            require_line(called)
        except PlainTextError as error:
            raise RefusalError(Because.BAD_VALUE, f"name of the search: {error}", code="bad_character") from None
        require_distinct("a saved search", called, (one.name for one in self.saved_searches().searches))
        query = parse(where)
        with self._database.session() as session:
            search.search(session, query, everywhere=False, limit=1)
            settings.put(session, f"{_SEARCH}{called}", {"where": where}, who)
        return self.saved_searches()

    def drop_search(self, name: str, who: str) -> SavedSearchList:
        """Take a search off the list; what it was stays in the database. Raises UnknownRecordError."""
        self.where_of(name)
        with self._database.session() as session:
            settings.put(session, f"{_SEARCH}{name}", None, who)
        return self.saved_searches()

    def tag(self, run_ids: Sequence[int], put: Sequence[str], taken: Sequence[str]) -> None:
        """Put tags on runs and take others off, all or nothing. Raises TagError, UnknownRecordError."""
        with self._database.session() as session:
            for run_id in sorted(run_ids):  # in the order in which everybody locks them
                for one in put:
                    tags.put(session, run_id, one)
                for one in taken:
                    tags.take(session, run_id, one)

    def rename(self, before: str, after: str) -> int:
        """Call a tag otherwise; return on how many runs. Raises TagError, UnknownRecordError."""
        with self._database.session() as session:
            return tags.rename(session, before, after)

    def compared(self, asked: ComparisonAsked) -> RunComparison:
        """Set runs beside each other. Raises RefusalError, UnknownRecordError."""
        with self._database.reading() as session:
            return comparison.compare(session, asked)

    def history(self, kind: str, metric: str, where: str, *, everywhere: bool) -> MetricHistory:
        """Return a metric of a kind of runs over their dates. Raises QueryError."""
        with self._database.reading() as session:
            return comparison.metric_history(session, kind, metric, where, everywhere=everywhere)

    def _words(self) -> SearchWords:
        with self._database.reading() as session:
            known = search.known_words(session)
        return SearchWords(
            station=self._database.station,
            stations=list(known.stations),
            fields=list(search.FIELDS),
            kinds=list(known.kinds),
            ends=list(ENDS),
            verdicts=list(VERDICTS),
            tags=list(known.tags),
            values={source: list(names) for source, names in known.values.items()},
        )
