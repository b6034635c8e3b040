"""Positions on a page: bounding boxes in the browser, and the element that receives a click at a point.

Each question is one call to the browser, because a page with live charts responds slowly.
"""

import time
from collections.abc import Callable, Mapping
from typing import NamedTuple

from playwright.sync_api import Page

DRAWN_WITHIN_S = 10.0
_SURVEY = """
selectors => {
    const main = document.querySelector("main");
    const box = element => {
        const { left, top, right, bottom } = element.getBoundingClientRect();
        return [left + main.scrollLeft, top + main.scrollTop, right + main.scrollLeft, bottom + main.scrollTop];
    };
    const named = ([name, selector]) => [name, [...document.querySelectorAll(selector)].map(box)];
    return Object.fromEntries(Object.entries(selectors).map(named));
}
"""
_COVERED = """
selector => [...document.querySelectorAll(selector)].filter(element => {
    element.scrollIntoView({ block: "nearest" });
    const { left, top, width, height } = element.getBoundingClientRect();
    const hit = document.elementFromPoint(left + width / 2, top + height / 2);
    return hit === null || !(element.contains(hit) || hit.contains(element));
}).map(element => element.outerHTML)
"""
_CUT = """
selector => [...document.querySelectorAll(selector)]
    .filter(one => one.scrollWidth > one.clientWidth + 1 && one.clientWidth > 0).map(element => element.outerHTML)
"""


class Box(NamedTuple):
    """A rectangle in the coordinates of the scrolled page [CSS px]."""

    left: float
    top: float
    right: float
    bottom: float

    def overlaps(self, other: "Box") -> bool:
        """Return whether two boxes share more than a border."""
        apart = min(self.right, other.right) - max(self.left, other.left) <= 1
        return not (apart or min(self.bottom, other.bottom) - max(self.top, other.top) <= 1)

    def holds(self, other: "Box") -> bool:
        """Return whether the other box is inside, within one pixel."""
        across = self.left - 1 <= other.left and other.right <= self.right + 1
        return across and self.top - 1 <= other.top and other.bottom <= self.bottom + 1


def survey(page: Page, selectors: Mapping[str, str]) -> dict[str, list[Box]]:
    """Return the boxes of all elements at one moment, independent of the scroll position."""
    found = page.evaluate(_SURVEY, dict(selectors))
    return {name: [Box(*edges) for edges in boxes] for name, boxes in found.items()}


def scrolled_page(page: Page) -> Box:
    """Return the box of the complete scrollable page."""
    edges = page.evaluate(
        "() => { const main = document.querySelector('main'), { left, top } = main.getBoundingClientRect();"
        " return [left, top, left + main.scrollWidth, top + main.scrollHeight]; }"
    )
    return Box(*edges)


def sideways(page: Page) -> float:
    """Return how far document and page exceed the visible width [CSS px]."""
    return float(
        page.evaluate(
            "Math.max(...document.querySelectorAll('html, main').values()"
            ".map(one => one.scrollWidth - one.clientWidth))"
        )
    )


def stays(page: Page, wrong: Callable[[], list[str]]) -> list[str]:
    """Return the faults that persist after a new window size has been drawn for some frames."""
    deadline = time.monotonic() + DRAWN_WITHIN_S
    while (found := wrong()) and time.monotonic() < deadline:
        page.evaluate("new Promise(requestAnimationFrame)")
    return found


def document_scrolls_by(page: Page) -> float:
    """Return how far the document exceeds the window [CSS px]; scrolling it would move header and STOP."""
    return float(page.evaluate("document.documentElement.scrollHeight - innerHeight"))


def covered(page: Page, selector: str) -> list[str]:
    """Return the controls whose middle is covered by another element after scrolling to them."""
    return list(page.evaluate(_COVERED, selector))


def cut(page: Page, selector: str) -> list[str]:
    """Return the elements whose content is clipped."""
    return list(page.evaluate(_CUT, selector))
