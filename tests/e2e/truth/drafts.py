"""Unsent input: drafts of forms persist, and number boxes restore their value and show a message.

The robot stores the text of each box that it filled in as a draft. Whenever the box is visible again it shows this
text, after other pages, after reloads, and after actions of another person, until the draft is discarded.
"""

import random
from collections.abc import Callable, Mapping
from dataclasses import dataclass

from playwright.sync_api import Locator, Page

from tests.e2e.page_texts import load_texts
from tests.e2e.truth.findings import Findings

IDENTIFY_TEXTS = load_texts("pages/identify")
EXPERIMENT_TEXTS = load_texts("pages/experiments")
STUDY_TEXTS = load_texts("pages/studies")
RUNS = load_texts("pages/runs")
OPERATE = load_texts("pages/operate")


@dataclass(frozen=True)
class Box:
    """A box with a draft: its page, its locator, and a random text for it."""

    place: str
    find: Callable[[Page], Locator]
    text: Callable[[random.Random], str]
    draft: str | None = None
    """What the draft is of, as its mark and its button name it; None where the box has no mark."""


def _in(region: str, label: str) -> Callable[[Page], Locator]:
    return lambda page: page.get_by_role("region", name=region, exact=True).get_by_label(label, exact=True)


def _setting(form: str, name: str) -> Callable[[Page], Locator]:
    return lambda page: page.locator(f"form[aria-label='{form}'] [name={name}]")


def _number(low: float, high: float, decimals: int) -> Callable[[random.Random], str]:
    return lambda chance: f"{chance.uniform(low, high):.{decimals}f}"


def _study(chance: random.Random) -> str:
    return f"format: 1\nname: typed_{chance.randrange(1000)}\n"


TRACKING = "Tracking of position and stiffness"
BOXES: Mapping[str, Box] = {
    "name of an own experiment": Box("experiments", _in(EXPERIMENT_TEXTS["ownExperiments"], EXPERIMENT_TEXTS["name"]),
                                     lambda one: f"own_{one.randrange(999)}", EXPERIMENT_TEXTS["draftOf"]),
    "setting of tracking": Box("experiments", _setting(TRACKING, "S_hold"), _number(9.01, 11.99, 2),
                               EXPERIMENT_TEXTS["settingsOf"].format(experiment=TRACKING.lower())),
    "text of a study": Box("studies", _in(STUDY_TEXTS["newStudy"], STUDY_TEXTS["text"]), _study,
                           STUDY_TEXTS["draftOf"]),
    "setting of an identification": Box("identify", _setting(IDENTIFY_TEXTS["newIdentification"], "levels"),
                                        lambda one: str(one.randint(3, 9)), IDENTIFY_TEXTS["draftOf"]),
    "push": Box("operate", _in("Push", "Push [N]"), _number(-8.9, 8.9, 1)),
    "stiffness of a wall": Box("operate", _in("Wall", OPERATE["wallStiffness"]), _number(5000, 30000, 0)),
    "threshold of contacts": Box("operate", _in("Touch", OPERATE["threshold"]), _number(2.1, 8.9, 1)),
    "length of a trial": Box("operate", _in(OPERATE["tuningChanges"], OPERATE["trialDuration"]),
                             lambda one: str(one.randint(3, 9))),
    "level of a trigger": Box("system", _setting("Trigger", "before_s"), _number(1.1, 4.9, 1)),
    "note of a run": Box("runs", lambda page: page.get_by_role("textbox", name=RUNS["note"], exact=True),
                         lambda one: f"noted {one.randrange(1000)}"),
}  # fmt: skip


class Typed:
    """The input of one person: the text of each draft, with the address that identifies the form."""

    def __init__(self, page: Page) -> None:
        self._page = page
        self._texts: dict[str, tuple[str, str]] = {}

    def keep(self, name: str, text: str) -> None:
        self._texts[name] = (_address(self._page), text)

    def forget(self, name: str) -> None:
        self._texts.pop(name, None)

    def known(self, place: str) -> list[str]:
        """Return the drafts of a page."""
        return [name for name in self._texts if BOXES[name].place == place]

    def lost(self) -> Findings:
        """Return the visible boxes whose text differs from their draft."""
        found, address = Findings(), _address(self._page)
        for name, (where, text) in self._texts.items():
            box = BOXES[name].find(self._page)
            if where == address and box.count() == 1:
                found.same(f"draft: {name}", _plain(box.input_value()), _plain(text))
        return found


def _plain(text: str) -> str:
    """Return a number without trailing zeros, as the boxes of forms write it."""
    try:
        return f"{float(text):g}"
    except ValueError:
        return text


def _address(page: Page) -> str:
    return page.url.partition("#/")[2]
