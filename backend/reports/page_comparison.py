"""A page as it is read beside the one that is made again: line by line, drawing by drawing."""

import re
from collections.abc import Callable, Iterator
from html import unescape
from itertools import zip_longest

from backend.reports.differences import MOST, Difference, Verified, not_made
from backend.reports.evidence import (
    DRAWING,
    LAYOUT,
    SINEW,
    Evidence,
    SeriesEvidence,
    element_of,
    made_with,
    to_element,
    without_element,
)

_TAG = re.compile(r"<[^<>]*>")
_SET = re.compile(r"</?(?:i|b|sub|sup)>")
_OPEN, _CLOSE = "<svg", "</svg>"
_PLACE = "<svg/>"
_LINE = 2000
"""Letters of a line of which a difference is told: what is longer is a forged page's."""
_DRAWING_OF = "drawing of figure"
_CARRIED = "figures, criteria, models, parameters and hashes that it carries, but not the page as it is read"

_XML = re.compile(r"<(/?)([A-Za-z][\w:.-]*)([^<>]*)>")
_ATTRIBUTE = re.compile(r'\s+([A-Za-z][\w:.-]*)="([^"<>]*)"')
_COMMENT = re.compile(r"<!--[^<>]*-->")
_REST = re.compile(r"\s*/?")
_NAMESPACES = {"xmlns", "xmlns:xlink", "xmlns:rdf", "xmlns:dc", "xmlns:cc"}
_DRAWS: dict[str, set[str]] = {
    "svg": {"role", "aria-label", "width", "height", "viewBox", "version"} | _NAMESPACES,
    "g": {"id", "style", "transform", "clip-path"},
    "defs": set(),
    "path": {"id", "style", "transform", "clip-path", "d"},
    "use": {"style", "transform", "x", "y", "xlink:href", "clip-path"},
    "clipPath": {"id"},
    "rect": {"x", "y", "width", "height", "style"},
    "image": {"id", "style", "transform", "x", "y", "width", "height", "xlink:href", "clip-path"},
    "metadata": set(),
    "style": {"type"},
    "rdf:RDF": set(_NAMESPACES),
    "cc:Work": set(),
    "dc:type": {"rdf:resource"},
    "dc:format": set(),
    "title": set(),
}
"""Elements that a drawing of a report has, with their attributes: none covers the page or fetches anything."""
_STYLES = {
    *("fill", "fill-opacity", "fill-rule", "stroke", "stroke-width", "stroke-linecap", "stroke-linejoin", "opacity"),
    *("stroke-opacity", "stroke-dasharray", "stroke-dashoffset", "stroke-miterlimit", "image-rendering"),
}
_STYLE_SHEET = "*{stroke-linejoin: round; stroke-linecap: butt}"


def compare_pages(page: str, evidence: Evidence | SeriesEvidence, make_again: Callable[[], str]) -> Verified:
    """Compare a page, whose account was read from it, with the same page made here.

    The versions that the account names decide nothing, as anybody can change them: they only explain why a page that
    differs may have been written by another version. Such a page is not verified; it does not hold.
    """
    here = made_with()
    said = evidence.made_with if isinstance(evidence, Evidence) else evidence.runs[0].made_with
    foreign = tuple(_foreign(page))
    try:
        again = make_again()
    except Exception as error:
        return Verified((not_made("the page", "one that can be made again", error), *foreign)[:MOST], ())
    differences = [*_account(page, evidence), *_pages(page, again)]
    others = [name for name, other in here.items() if said.get(name) != other] + [*({*said} - {*here})]
    if SINEW in others or LAYOUT in others:
        by, this = (
            f"Sinew {versions.get(SINEW)}, layout {versions.get(LAYOUT, 'unknown')}" for versions in (said, here)
        )
        left_out = f"the page as it is read: it was written by {by}, this is {this}"
        return Verified(foreign[:MOST], (left_out,), _CARRIED)
    if DRAWING in others:
        differences = [one for one in differences if not one.name.startswith(_DRAWING_OF)]
    told = (
        f"what {name} made: the account names its version {said.get(name)}, here is {here.get(name)}" for name in others
    )
    return Verified((*differences, *foreign)[:MOST], tuple(told))


def _foreign(page: str) -> Iterator[Difference]:
    """Name what stands in the drawings of a page and is none of a report's: elements, attributes, styles, addresses."""
    for number, drawing in enumerate(_drawings(page), start=1):
        found = next(_strangers(drawing), None)
        if found is not None:
            yield Difference(f"{_DRAWING_OF} {number}", f"“{found[:80]}”", "nothing but lines, letters and areas")


def _strangers(drawing: str) -> Iterator[str]:
    end, before = 0, ""
    for tag in _XML.finditer(drawing):
        between = _COMMENT.sub("", drawing[end : tag.start()])
        if "<" in between or ">" in between:
            yield between.strip()
        if before == "style" and between.strip() and between.strip() != _STYLE_SHEET:
            yield between.strip()
        end, name = tag.end(), tag[2]
        before = "" if tag[1] else name
        if name not in _DRAWS:
            yield tag[0]
            continue
        if tag[1]:
            continue
        attributes = list(_ATTRIBUTE.finditer(tag[3]))
        rest = tag[3][attributes[-1].end() :] if attributes else tag[3]
        if sum(len(one[0]) for one in attributes) + len(rest) != len(tag[3]) or not _REST.fullmatch(rest):
            yield tag[0]
        for one in attributes:
            if one[1] not in _DRAWS[name] or not _is_harmless(name, one[1], unescape(one[2])):
                yield one[0].strip()


def _is_harmless(element: str, attribute: str, value: str) -> bool:
    if attribute == "style":
        named = {part.split(":")[0].strip() for part in value.split(";") if part.strip()}
        return named <= _STYLES and "url(" not in value
    if attribute == "xlink:href":
        return value.startswith("data:image/png;base64,") if element == "image" else value.startswith("#")
    if attribute == "clip-path":
        return value.startswith("url(#")
    return True


def _account(page: str, evidence: Evidence | SeriesEvidence) -> Iterator[Difference]:
    """Compare the account as it is written with what was read of it: nothing else may stand in it."""
    said, found = element_of(page), to_element(evidence)
    if said != found:
        yield Difference("the account as it is written", *where_they_differ(said, found))


def _pages(page: str, again: str) -> Iterator[Difference]:
    """Compare what a person sees, line by line, and drawing by drawing."""
    said, found = without_element(page), without_element(again)
    drawn = [list(_drawings(text)) for text in (said, found)]
    counts = [len(each) for each in drawn]
    if counts[0] != counts[1]:
        yield Difference("number of drawings", str(counts[0]), str(counts[1]))
    else:
        for number, (one, other) in enumerate(zip(*drawn, strict=True), start=1):
            if one != other:
                yield Difference(f"{_DRAWING_OF} {number}", "another drawing", "that of its samples")
    lines = [_without_drawings(text).replace("<dt>", "\n<dt>").split("\n") for text in (said, found)]
    for number, (one, other) in enumerate(zip(*lines, strict=False), start=1):
        if one != other:
            yield Difference(_called(one[:_LINE], number), *where_they_differ(one, other))
    sizes = [len(each) for each in lines]
    if sizes[0] != sizes[1]:
        yield Difference("length of the page", f"{sizes[0]} lines", f"{sizes[1]} lines")


def _drawings(text: str) -> Iterator[str]:
    """Return the drawings of a page in turn; one look over the page, whatever stands in it."""
    for begin, end in _places(text):
        yield text[begin:end]


def _without_drawings(text: str) -> str:
    parts, after = [], 0
    for begin, end in _places(text):
        parts += [text[after:begin], _PLACE]
        after = end
    return "".join((*parts, text[after:]))


def _places(text: str) -> Iterator[tuple[int, int]]:
    end = 0
    while (begin := text.find(_OPEN, end)) >= 0:
        close = text.find(_CLOSE, begin)
        if close < 0:
            return
        end = close + len(_CLOSE)
        yield begin, end


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
    first = next(place for place, (left, right) in enumerate(zip_longest(one, other)) if left != right)
    near = slice(max(0, first - _LINE), first + _LINE)
    said, found = _plain(one[near]), _plain(other[near])
    if said == found:
        said, found = one[near], other[near]
    same = next(place for place, (left, right) in enumerate(zip_longest(said, found)) if left != right)
    part = slice(max(0, same - 30), same + 40)
    return f"“{said[part]}”", f"“{found[part]}”"
