"""A page as it is read beside the one that is made again: line by line, drawing by drawing."""

import re
from collections.abc import Callable, Iterator
from html import unescape
from itertools import zip_longest

from backend.reports.differences import MOST, Difference, Verified, not_made
from backend.reports.evidence import (
    DRAWING,
    SINEW,
    Evidence,
    SeriesEvidence,
    element_of,
    made_with,
    to_element,
    without_element,
)

_TAG = re.compile(r"<[^>]*>")
_SET = re.compile(r"</?(?:i|b|sub|sup)>")
_DRAWING = re.compile(r"<svg.*?</svg>", re.DOTALL)
_PLACE = "<svg/>"
_CARRIED = "figures, criteria, models, parameters and hashes that it carries, but not the page as it is read"


def compare_pages(page: str, evidence: Evidence | SeriesEvidence, make_again: Callable[[], str]) -> Verified:
    """Compare a page, whose account was read from it, with the same page made here."""
    here = made_with()
    said = evidence.made_with if isinstance(evidence, Evidence) else evidence.runs[0].made_with
    if said.get(SINEW) != here[SINEW]:
        left_out = f"the page as it is read: it was written by Sinew {said.get(SINEW)}, this is {here[SINEW]}"
        return Verified((), (left_out,), _CARRIED)
    try:
        again = make_again()
    except Exception as error:
        return Verified((not_made("the page", "one that can be made again", error),), ())
    drawings = said.get(DRAWING) == here[DRAWING]
    differences = (*_account(page, evidence), *_pages(page, again, drawings=drawings))
    left = () if drawings else (f"figures: they were drawn by {DRAWING} {said.get(DRAWING)}, here is {here[DRAWING]}",)
    return Verified(differences[:MOST], left)


def _account(page: str, evidence: Evidence | SeriesEvidence) -> Iterator[Difference]:
    """Compare the account as it is written with what was read of it: nothing else may stand in it."""
    said, found = element_of(page), to_element(evidence)
    if said != found:
        yield Difference("the account as it is written", *where_they_differ(said, found))


def _pages(page: str, again: str, *, drawings: bool) -> Iterator[Difference]:
    """Compare what a person sees, line by line; drawings only where the same library would draw them alike."""
    said, found = without_element(page), without_element(again)
    drawn = [_DRAWING.findall(text) for text in (said, found)]
    counts = [len(each) for each in drawn]
    if counts[0] != counts[1]:
        yield Difference("number of drawings", str(counts[0]), str(counts[1]))
    elif drawings:
        for number, (one, other) in enumerate(zip(*drawn, strict=True), start=1):
            if one != other:
                yield Difference(f"drawing of figure {number}", "another drawing", "that of its samples")
    lines = [_DRAWING.sub(_PLACE, text).replace("<dt>", "\n<dt>").split("\n") for text in (said, found)]
    for number, (one, other) in enumerate(zip(*lines, strict=False), start=1):
        if one != other:
            yield Difference(_called(one, number), *where_they_differ(one, other))
    sizes = [len(each) for each in lines]
    if sizes[0] != sizes[1]:
        yield Difference("length of the page", f"{sizes[0]} lines", f"{sizes[1]} lines")


def _called(line: str, number: int) -> str:
    if row := re.match(r"<tr><t[dh][^>]*>(.*?)</t[dh]>", line):
        return f"row “{_plain(row.group(1))}”"
    if fact := re.match(r"<dt>(.*?)</dt>", line):
        return f"“{_plain(fact.group(1))}” in the heading"
    return f"line {number} of the page"


def _plain(line: str) -> str:
    return " ".join(unescape(_TAG.sub(" ", _SET.sub("", line.replace("<sub>", "_")))).split())


def where_they_differ(one: str, other: str) -> tuple[str, str]:
    """Return what stands around the first difference of two lines: as a person reads them, else with their markup."""
    said, found = _plain(one), _plain(other)
    if said == found:
        said, found = one, other
    same = next(place for place, (left, right) in enumerate(zip_longest(said, found)) if left != right)
    part = slice(max(0, same - 30), same + 40)
    return f"“{said[part]}”", f"“{found[part]}”"
