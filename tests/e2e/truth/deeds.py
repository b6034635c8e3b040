"""Actions of the robot that the page offers, executed by mouse or by keyboard."""

import math
import random
from collections.abc import Callable
from dataclasses import dataclass, field

from playwright.sync_api import Locator, Page

from backend.models.run import MOTIONS
from tests.e2e.page_texts import load_texts
from tests.e2e.truth.drafts import Typed
from tests.e2e.truth.moment import Around, State
from tests.e2e.truth.shown import Shown

OPERATE = load_texts("pages/operate")

Value = frozenset({409, 422})
"""Refused for what was asked: it cannot be reached, or the joint is not at rest, which no state tells beforehand."""
Never: frozenset[int] = frozenset()
VOLTAGE_LIMIT = OPERATE["voltageLimitBox"]


@dataclass
class Scene:
    """Input of the robot: the page as just read, the state, and the random generator."""

    page: Page
    shown: Shown
    state: State
    chance: random.Random
    around: Around
    typed: Typed
    said: list[str] = field(default_factory=list)

    def say(self, words: str) -> None:
        """Record what exactly is done."""
        self.said.append(words)

    @property
    def main(self) -> Locator:
        return self.page.get_by_role("main")

    def button(self, name: str) -> Locator:
        return self.page.get_by_role("button", name=name, exact=True).first

    def press(self, name: str) -> None:
        """Press a button by mouse, or by key when it has the focus."""
        button = self.button(name)
        if self.chance.random() < 0.3:
            self.say(f"{name} by key")
            button.press("Enter")
        else:
            self.say(name)
            button.click()

    def type(self, label: str, value: float, decimals: int) -> None:
        """Type a number into a box and send it."""
        self.say(f"{label} {value:.{decimals}f}")
        box = self.page.get_by_role("textbox", name=label, exact=True)
        box.fill(f"{value:.{decimals}f}")
        box.press("Enter")

    def steer(self, name: str) -> None:
        """Move a slider: some steps by arrow keys, to an end and back, or by a press on its track."""
        thumb = self.page.get_by_role("slider", name=name, exact=True)
        how = self.chance.choice(("steps", "end", "left", "track"))
        if how == "steps":
            key, count = self.chance.choice(("ArrowLeft", "ArrowRight")), self.chance.randint(1, 8)
            self.say(f"{name} slider, {count} times {key}")
            for _ in range(count):
                thumb.press(key)
        elif how == "track":
            place = self.chance.uniform(0.1, 0.9)
            self.say(f"{name} slider, pressed at {place:.2f} of its length")
            track = thumb.locator("xpath=..")
            size = track.bounding_box() or {"width": 1.0, "height": 1.0}
            track.click(position={"x": place * size["width"], "y": size["height"] / 2})
        else:
            key = self.chance.choice(("Home", "End"))
            last = "Enter" if how == "end" else "Escape"
            self.say(f"{name} slider, {key} and {last}")
            thumb.press(key)
            thumb.press(last)


@dataclass(frozen=True)
class Deed:
    """An action: its page, its relative frequency, its condition, its execution, and the refusals that it may cause."""

    name: str
    place: str | None
    weight: float
    offered: Callable[[Scene], bool]
    do: Callable[[Scene], None]
    refused: frozenset[int] = Never


def pressing(name: str, place: str | None, weight: float, refused: frozenset[int] = Never) -> Deed:
    """Return the action that presses a button of the page."""
    return Deed(name, place, weight, lambda scene: scene.shown.offers(name), lambda scene: scene.press(name), refused)


def typing(
    label: str, weight: float, low: Callable[[State], float], high: Callable[[State], float], decimals: int
) -> Deed:
    """Return the action that enters a number between the bounds of the service."""

    def do(scene: Scene) -> None:
        scene.type(label, scene.chance.uniform(low(scene.state), high(scene.state)), decimals)

    return Deed(label, "operate", weight, lambda scene: scene.shown.offers(label), do, Value)


def _typed_angle(scene: Scene) -> None:
    limits = scene.state["limits"]
    for unit, factor, decimals in (("°", 180.0 / math.pi, 1), ("rad", 1.0, 3)):
        if scene.shown.offers(f"q_ref value [{unit}]"):
            q = scene.chance.uniform(0.97 * limits["q_min"], 0.97 * limits["q_max"])
            scene.type(f"q_ref value [{unit}]", q * factor, decimals)


def _offers_angle(scene: Scene) -> bool:
    return scene.shown.offers("q_ref value [°]") or scene.shown.offers("q_ref value [rad]")


def steering(name: str, weight: float) -> Deed:
    """Return the action that moves a slider of Operate."""
    return Deed(f"slider {name}", "operate", weight, lambda scene: scene.shown.offers(name),
                lambda scene: scene.steer(name), Value)  # fmt: skip


def switching(name: str, weight: float, refused: frozenset[int] = Never) -> Deed:
    """Return the action that toggles a switch of Operate."""

    def do(scene: Scene) -> None:
        scene.say(name)
        scene.main.get_by_role("switch", name=name, exact=True).press("Space")

    return Deed(name, "operate", weight, lambda scene: scene.shown.offers(name), do, refused)


def _wall(scene: Scene) -> None:
    side = scene.chance.choice(("above", "below"))
    scene.say(f"wall {side}")
    scene.page.get_by_role("combobox", name=OPERATE["wallSide"]).select_option(side)
    scene.press(OPERATE["addWall"])


def _choose_motion(scene: Scene) -> None:
    """Choose the other motion, by mouse or by arrow key."""
    present = scene.state["tuning"]["motion"]
    other = next(one for one in MOTIONS if one != present)
    choice = scene.main.get_by_role("radiogroup", name="Motion", exact=True)
    if scene.chance.random() < 0.5:
        scene.say(f"{other} by key")
        choice.get_by_role("radio", name=present, exact=True).press("ArrowRight")
    else:
        scene.say(other)
        choice.get_by_text(other, exact=True).click()


ON_OPERATE = (
    pressing("Pretension", "operate", 5),
    pressing("Run", "operate", 8),
    pressing("Compliance", "operate", 2),
    pressing("Soft stop", "operate", 0.6),
    pressing("Off", "operate", 0.6),
    Deed("q_ref", "operate", 4, _offers_angle, _typed_angle, Value),
    typing("S_ref value [N·m/rad]", 3, lambda s: s["limits"]["S_min"], lambda s: s["limits"]["S_max"], 2),
    steering("q_ref", 3),
    steering("S_ref", 2),
    steering("λ_q", 2),
    steering("λ_S", 1),
    typing("λ_q value [s]", 2, lambda s: s["tuning"]["lam_q_min"] + 1e-3, lambda s: s["tuning"]["lam_q_max"], 3),
    typing("λ_S value [s]", 1, lambda s: s["tuning"]["lam_S_min"] + 1e-3, lambda s: s["tuning"]["lam_S_max"], 3),
    *(pressing(f"{verb} λ_q", "operate", 0.5, Value) for verb in ("Decrease", "Increase", "Reset")),
    Deed("Motion", "operate", 2.5, lambda scene: scene.shown.offers("lambda", "References"), _choose_motion, Value),
    typing(
        VOLTAGE_LIMIT,
        1.5,
        lambda s: s["tuning"]["u_plan_min"],
        lambda s: s["tuning"]["u_plan_max"] - 0.05,
        1,
    ),
    switching(OPERATE["rejection"], 2),
    typing(OPERATE["rejectionGain"], 1, lambda _s: 0.1, lambda _s: 0.9, 2),
    switching("Stage changes", 1),
    *(pressing(name, "operate", 2, Value) for name in ("Apply", "Try for", "Revert to saved")),
    *(pressing(name, "operate", 1) for name in ("Save", "Undo change", "Redo change", "Keep", "Revert now", "Discard")),
    pressing("Push", "operate", 2),
    pressing(OPERATE["release"], "operate", 0.5),
    Deed("wall", "operate", 1, lambda scene: scene.shown.offers(OPERATE["addWall"]), _wall, Value),
    pressing(OPERATE["removeWall"], "operate", 0.7),
    pressing(OPERATE["calibrate"], "operate", 2, Value),
    pressing(OPERATE["calibrateOverS"], "operate", 0.5, Value),
    pressing(OPERATE["stopCalibration"], "operate", 1),
    pressing(OPERATE["enableReaction"], "operate", 0.7, Value),
    pressing(OPERATE["disableReaction"], "operate", 2),
    pressing(OPERATE["clearBias"], "operate", 0.3),
)
