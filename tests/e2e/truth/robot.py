"""A robot of two operators: random actions of a page; after each, both pages are compared with the service.

The seed determines all choices but not the timing, so that a run with the same seed repeats the actions as long as page
and loop reach the same states.
"""

import json
import random
import secrets
import time
from collections.abc import Callable, Collection
from contextlib import closing

from playwright.sync_api import Browser, Error, Page, Response, expect

from tests.e2e.browser import DESKTOP, Watched
from tests.e2e.operator import MOTION_TIMEOUT_MS
from tests.e2e.service import Service
from tests.e2e.sharing import sign_in_at
from tests.e2e.truth.checked import SETTLED_S, settled, what_of
from tests.e2e.truth.deeds import ON_OPERATE, Deed, Scene
from tests.e2e.truth.deeds_elsewhere import ELSEWHERE
from tests.e2e.truth.deeds_typing import TYPING
from tests.e2e.truth.drafts import Typed
from tests.e2e.truth.findings import Findings
from tests.e2e.truth.logged import Account, account_of, unlogged
from tests.e2e.truth.moment import Around, State

DEEDS = (*ON_OPERATE, *ELSEWHERE, *TYPING)
NAMES = ("Ada", "Grace")
OTHER_ONE = 0.15
"""How likely the other person does the next deed."""

_ENTRY = {"K_q": 0.05, "T_q": 0.342, "K_S": 0.7209, "T_S": 0.342}
_CAUSES = ("mode", "task", "trial", "own_tuning", "pretension_done", "fault", "holder", "touch", "earlier")
"""Where one of these has changed by itself, what was offered before may rightly be refused."""

_BETWEEN_DEEDS_MS = 300
_BEGINNING_S = 600.0
"""A busy machine takes so long to load what evaluates the first identification."""


class UntrueError(AssertionError):
    """The page shows something that disagrees with the service, or offers a refused command."""


class Person:
    """A person with a name and a page in an own browser."""

    def __init__(self, browser: Browser, service: Service, name: str) -> None:
        self.name = name
        self.watched = Watched(browser.new_context(viewport=DESKTOP, accept_downloads=True).new_page())
        self.page = self.watched.page
        self.page.set_default_timeout(MOTION_TIMEOUT_MS)
        sign_in_at(self.page, service, "operate", name)
        self.around = Around(self.page, service, name)
        self.typed = Typed(self.page)
        self.refused: list[Response] = []
        self.page.on("response", self._hear)

    def close(self) -> None:
        self.around.close()
        self.page.context.close()

    def disagreements(self, known: Collection[str]) -> Findings:
        """Return the differences between page and service, and the lost drafts."""
        found = settled(self.around, known=known)
        return Findings([*found, *(one for one in self.typed.lost() if what_of(one) not in known)])

    def complaints(self) -> list[str]:
        """Return the messages of the console except refusals, which are checked separately."""
        return [one for one in self.watched.complaints if "the server responded with a status of 4" not in one]

    def _hear(self, response: Response) -> None:
        if response.status >= 400 and response.request.method != "GET":
            self.refused.append(response)


class Robot:
    """A robot at the pages of two people; ``say`` receives a description of each action.

    It ends at the first difference; with ``go_on`` it collects the differences, each kind once.
    """

    def __init__(
        self, browser: Browser, service: Service, seed: int, say: Callable[[str], None], *, go_on: bool = False
    ) -> None:
        self.seed, self.say, self._go_on = seed, say, go_on
        self._known: set[str] = set()
        self._collected: list[str] = []
        self._chance = random.Random(seed)
        self.people = [Person(browser, service, name) for name in NAMES]
        self._person = self.people[0]
        self._trail: list[str] = []
        self._logged: Account

    @property
    def around(self) -> Around:
        return self._person.around

    @property
    def page(self) -> Page:
        return self._person.page

    def close(self) -> None:
        for person in self.people:
            person.close()

    def work(self, count: int) -> None:
        """Perform ``count`` actions. Raises UntrueError."""
        _give_banks(self.around)
        _identify_motors(self.around)
        self._logged = account_of(self.around)
        self._check("beginning")
        for number in range(1, count + 1):
            if self._chance.random() < OTHER_ONE:
                self._person = next(one for one in self.people if one is not self._person)
                self.page.bring_to_front()
            self._step(number)
        odd = {person.name: person.complaints() for person in self.people if person.complaints()}
        if odd:
            self._found("at the end", Findings([f"the console complained: {odd}"]))
        if self._collected:
            raise UntrueError(self._told("\n".join(self._collected)))

    def _found(self, after: str, found: Findings) -> None:
        """Raise or collect a difference. Raises UntrueError."""
        words = f"after {after}:\n" + "\n".join(f"  {one}" for one in found)
        if not self._go_on:
            raise UntrueError(self._told(words))
        self._known |= {what_of(one) for one in found}
        self._collected.append(words)
        self.say(f"UNTRUE {words}\n  state {json.dumps(self.around.state(), ensure_ascii=False)}")

    def _scene(self) -> Scene:
        before, _ = self.around.look()
        return Scene(self.page, before.shown, before.state, self._chance, self.around, self._person.typed)

    def _step(self, number: int) -> None:
        scene = self._scene()
        deed = self._chosen(scene)
        if deed.place is not None and deed.place != scene.shown.place:
            self._go(deed.place)
            scene = self._scene()
            if not deed.offered(scene):  # the expected control is not offered there now: another action is chosen
                deed = self._chosen(scene, elsewhere=False)
        for person in self.people:
            person.refused.clear()
        words = f"{number}. {self._person.name}: {deed.name}"
        self.say(f"{words} (mode {scene.state['mode']})")
        try:
            deed.do(scene)
        except Error as error:  # the control disappeared before the action
            scene.say(f"not done: {error.message.splitlines()[0]}")
            self.page.keyboard.press("Escape")
        except AssertionError as error:
            self._found(", ".join([words, *scene.said]), Findings([str(error)]))
        self.page.wait_for_timeout(_BETWEEN_DEEDS_MS)
        said = f"{words} on {scene.shown.place}: {', '.join(scene.said)}"
        self._trail.append(f"{said} (mode {scene.state['mode']})")
        self._check(said)
        self._check_log(said)
        self._look_at_refusals(deed, scene.state)

    def _chosen(self, scene: Scene, *, elsewhere: bool = True) -> Deed:
        """Choose an action: offered by the open page, or assumed on other pages."""
        here = scene.shown.place
        possible = [one for one in DEEDS if _there(one, here) and one.offered(scene)]
        possible += [one for one in DEEDS if elsewhere and not _there(one, here)]
        return self._chance.choices(possible, [one.weight * _ease(one, here) for one in possible])[0]

    def _go(self, place: str) -> None:
        name = place.capitalize()
        self.page.get_by_role("navigation", name="Main").get_by_role("link", name=name, exact=True).click()
        expect(self.page.get_by_role("heading", level=1, name=name)).to_be_attached()
        self._check(f"going to {name}")

    def _check(self, after: str) -> None:
        """Check both pages, that of the acting person first."""
        for person in sorted(self.people, key=lambda one: one is not self._person):
            if found := person.disagreements(self._known):
                self._found(f"{after}, at the page of {person.name} ({person.around.place})", found)

    def _check_log(self, after: str) -> None:
        """Compare the log with the state; the latest event may not be logged yet."""
        deadline = time.monotonic() + SETTLED_S
        while found := unlogged(self._logged, now := account_of(self.around)):
            if time.monotonic() > deadline:
                self._found(f"{after}, in the log", found)
                break
            self.page.wait_for_timeout(_BETWEEN_DEEDS_MS)
        self._logged = now

    def _look_at_refusals(self, deed: Deed, before: State) -> None:
        after = self.around.state()
        moved = [name for name in _CAUSES if _still(before, name) != _still(after, name)]
        for response in [one for person in self.people for one in person.refused]:
            if response.status in deed.refused or moved or _is_resumed(response):
                continue
            self._found(deed.name, Findings([f"{deed.name} was offered, and refused: {_body(response)}"]))

    def _told(self, what: str) -> str:
        state = json.dumps(self.around.state(), ensure_ascii=False)
        trail = "\n".join(self._trail)
        return f"seed {self.seed}, deed {len(self._trail)}: {what}\nbefore that:\n{trail}\nstate: {state}"


def _still(state: State, name: str) -> object:
    told = state[name]
    if name == "holder":
        return told and told["epoch"]
    if name == "task":
        return told and (told["run"], told["phase"])
    if name == "trial":
        return told is None
    return told


def _ease(deed: Deed, here: str) -> float:
    """Return the weight of staying on the open page, so that the robot does not only change pages."""
    return 1.0 if _there(deed, here) else 0.25


def _there(deed: Deed, here: str) -> bool:
    return deed.place in (None, here)


def _is_resumed(response: Response) -> bool:
    """Return whether a reloaded page requested its earlier control, which another person has taken."""
    asked = response.request
    return asked.url.endswith("/api/control") and "resume" in (asked.post_data or "")


def _body(response: Response) -> str:
    """Return the refused request; the response is not read, because that blocks after a reload."""
    request = response.request
    return f"{request.method} {request.url} {request.post_data}: {response.status}"


def _give_banks(around: Around) -> None:
    """Create two banks: one with two entries and one with one."""
    tensions = {"wide": ((10.55, 20.0), (12.43, 30.0)), "narrow": ((10.55, 20.0),)}
    for name, points in tensions.items():
        entries = [{"S_nominal": S, "tension_N": F, **_ENTRY} for S, F in points]
        bank = {"format": "sinew-bank", "version": 1, "name": name, "entries": entries}
        around.script.post("/api/banks/file", json=bank).raise_for_status()


def _identify_motors(around: Around) -> None:
    """Identify the motors once, so that an estimate can be applied; the actuator is off afterwards."""
    script = around.script
    script.post("/api/mode", json={"mode": "pretension"}).raise_for_status()
    _wait_until(around, lambda state: bool(state["pretension_done"]))
    settings = {"levels": 3, "settle_s": 0.5}  # shorter steps yield no model
    script.post("/api/identifications", json={"kind": "motor", **settings}).raise_for_status()
    _wait_until(around, lambda state: state["task"] is None)
    script.post("/api/mode", json={"mode": "off"}).raise_for_status()
    script.delete("/api/control").raise_for_status()


def _wait_until(around: Around, reached: Callable[[State], bool]) -> None:
    deadline = time.monotonic() + _BEGINNING_S
    while not reached(around.state()):
        assert time.monotonic() < deadline, "what the robot begins with was not reached"
        around.page.wait_for_timeout(_BETWEEN_DEEDS_MS)


def fresh_seed() -> int:
    """Return a random seed."""
    return secrets.randbelow(1_000_000)


def robot_at_work(
    browser: Browser, service: Service, seed: int, count: int, say: Callable[[str], None], *, go_on: bool = False
) -> None:
    """Let a robot perform ``count`` actions. Raises UntrueError, which states the seed."""
    with closing(Robot(browser, service, seed, say, go_on=go_on)) as robot:
        robot.work(count)
