"""Places of computed figures in the documents, their comparison, and their update.

A table is between ``<!-- computed: NAME -->`` and ``<!-- end -->``. A figure in a sentence has no mark: this package
declares the sentence with a format field for each figure, so that the text of the page stays readable.
"""

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from itertools import zip_longest
from pathlib import Path
from string import Formatter

ROOT = Path(__file__).parents[3]

Rows = Sequence[Sequence[str]]
Values = Mapping[str, float]

_NUMBER = r"[-+−]?\d+(?:\.\d+)?(?:e[-+]\d+)?"
_BLOCK = re.compile(r"<!-- computed: ([^>]+?) -->\n(.*?)<!-- end -->", re.DOTALL)


class PlaceError(Exception):
    """A page lacks a declared place, or contains it in another form."""


@dataclass(frozen=True)
class Table:
    """A table of a page. The first ``key`` cells of a row identify it."""

    page: str
    name: str
    headings: tuple[str, ...]
    key: int = 1

    def key_of(self, row: Sequence[str]) -> tuple[str, ...]:
        """Return the cells that identify a row."""
        return tuple(row[: self.key])


@dataclass(frozen=True)
class Prose:
    """Figures in a sentence of a page: ``text`` is the sentence, with a format field for each figure."""

    page: str
    name: str
    text: str

    def printed(self, text: str) -> re.Match[str]:
        """Return the place in the text of a page, a named group for each field. Raises PlaceError."""
        pattern = ""
        for literal, field, _, _ in Formatter().parse(self.text):
            pattern += r"\s+".join(map(re.escape, re.split(r"\s+", literal)))
            pattern += "" if field is None else f"(?P<{field}>{_NUMBER})"
        found = list(re.finditer(pattern, text))
        if len(found) != 1:
            raise PlaceError(f"{self.page} has this sentence {len(found)} times, not once: {self.text}")
        return found[0]

    def formatted(self, values: Values) -> dict[str, str]:
        """Return the text of each figure."""
        specs = {field: spec for _, field, spec, _ in Formatter().parse(self.text) if field is not None}
        if specs.keys() != values.keys():
            raise PlaceError(f"{self.name} was given {sorted(values)}, it prints {sorted(specs)}")
        return {field: format(values[field], spec or "") for field, spec in specs.items()}


Place = Table | Prose
Found = Mapping[Place, Rows | Values]


@dataclass(frozen=True)
class Computation:
    """One computation and the places of its figures; of a table it may compute only some rows."""

    name: str
    places: tuple[Place, ...]
    compute: Callable[[], Found]

    def found(self) -> Found:
        """Return the computed rows and values. Raises PlaceError if they differ from the declared places."""
        found = self.compute()
        if set(found) != set(self.places):
            raise PlaceError(f"{self.name} computes {sorted(place.name for place in found)}")
        return found


def page_text(page: str) -> str:
    """Return the text of a page."""
    return (ROOT / page).read_text(encoding="utf-8")


def printed_rows(table: Table) -> list[list[str]]:
    """Return the rows on the page, cell by cell, without headings. Raises PlaceError."""
    blocks = dict(_BLOCK.findall(page_text(table.page)))
    if table.name not in blocks:
        raise PlaceError(f"{table.page} has no block <!-- computed: {table.name} --> ... <!-- end -->")
    lines = [line for line in blocks[table.name].splitlines() if line.strip()]
    cells = [[cell.strip() for cell in line.strip().removeprefix("|").removesuffix("|").split("|")] for line in lines]
    if not cells:
        return []
    if tuple(cells[0]) != table.headings:
        raise PlaceError(f"{table.page}, {table.name}: the headings are {cells[0]}, declared are {table.headings}")
    return cells[2:]


def marked_tables(page: str) -> list[str]:
    """Return the names of the computed tables of a page."""
    return [name for name, _ in _BLOCK.findall(page_text(page))]


def differences(computation: Computation, found: Found) -> list[str]:
    """Return a message for each figure that differs from the computation. Raises PlaceError."""
    told = []
    for place, computed in found.items():
        for where, printed, now in _pairs(place, computed):
            if not same(printed, now):
                told.append(f"{place.page}, {place.name}, {where}: printed {printed!r}, computed {now!r}")
    return told


def _pairs(place: Place, computed: Rows | Values) -> list[tuple[str, str, str]]:
    if isinstance(place, Prose):
        assert isinstance(computed, Mapping)
        match = place.printed(page_text(place.page))
        return [(field, match[field], now) for field, now in place.formatted(computed).items()]
    assert not isinstance(computed, Mapping)
    on_page = {place.key_of(row): row for row in printed_rows(place)}
    pairs = []
    for row in computed:
        key = place.key_of(row)
        printed = on_page.get(key, [])
        for heading, was, now in zip_longest(place.headings, printed, row, fillvalue=""):
            pairs.append((f"{' / '.join(key)}, {heading}", was, now))
    return pairs


def same(printed: str, computed: str) -> bool:
    """Return whether two texts are equal, with numbers within one unit of the last printed digit."""
    if re.split(_NUMBER, printed) != re.split(_NUMBER, computed):
        return False
    pairs = zip(re.findall(_NUMBER, printed), re.findall(_NUMBER, computed), strict=True)
    return all(_near(was, now) for was, now in pairs)


def _near(printed: str, computed: str) -> bool:
    unit = max(_last_digit(printed), _last_digit(computed))
    return abs(_number(printed) - _number(computed)) <= unit * (1.0 + 1e-6)


def _number(text: str) -> float:
    return float(text.replace("−", "-"))


def _last_digit(text: str) -> float:
    digits, _, exponent = text.partition("e")
    _, _, decimals = digits.partition(".")
    return float(10.0 ** (int(exponent or 0) - len(decimals)))


def write(all_found: Mapping[Computation, Found], declared: Sequence[Computation]) -> list[str]:
    """Write computed figures to their pages; return the changed pages. Raises PlaceError before any change.

    Rows of a table whose computation is not in ``all_found`` are unchanged.
    """
    texts: dict[str, str] = {}
    for place in dict.fromkeys(place for found in all_found.values() for place in found):
        text = texts.get(place.page) or page_text(place.page)
        if isinstance(place, Prose):
            for found in all_found.values():
                if place in found:
                    text = _sentence(place, found[place], text)
        else:
            text = _table(place, _rows(place, all_found, declared), text)
        texts[place.page] = text
    changed = [page for page, text in texts.items() if text != page_text(page)]
    for page in changed:
        (ROOT / page).write_text(texts[page], encoding="utf-8")
    return changed


def _sentence(place: Prose, values: Rows | Values, text: str) -> str:
    assert isinstance(values, Mapping)
    match = place.printed(text)
    for field, now in sorted(place.formatted(values).items(), key=lambda item: -match.start(item[0])):
        start, end = match.span(field)
        minus = "−" if text[start] == "−" else "-"
        text = text[:start] + now.replace("-", minus, 1) + text[end:]
    return text


def _rows(table: Table, all_found: Mapping[Computation, Found], declared: Sequence[Computation]) -> Rows:
    computed = {table.key_of(row): row for found in all_found.values() for row in _rows_of(found, table)}
    contributing = [one for one in declared if table in one.places]
    if all(one in all_found for one in contributing):
        return list(computed.values())
    printed = printed_rows(table)
    new = [row for key, row in computed.items() if key not in {table.key_of(row) for row in printed}]
    return [*(computed.get(table.key_of(row), row) for row in printed), *new]


def _rows_of(found: Found, table: Table) -> Rows:
    rows = found.get(table, ())
    assert not isinstance(rows, Mapping)
    return rows


def _table(table: Table, rows: Rows, text: str) -> str:
    lines = [table.headings, ["---"] * len(table.headings), *rows]
    drawn = "\n".join(f"| {' | '.join(line)} |" for line in lines)
    places = [match for match in _BLOCK.finditer(text) if match[1] == table.name]
    if len(places) != 1:
        raise PlaceError(f"{table.page} has {len(places)} blocks <!-- computed: {table.name} -->, not one")
    start, end = places[0].span(2)
    return f"{text[:start]}\n{drawn}\n\n{text[end:]}"
