"""An operator who uses only the keyboard, and checks that the focus is visible at each stop.

The focus is visible if the computed outline, shadow or border of the control, or of an adjacent element, changes when
the control loses the focus.
"""

import re
from dataclasses import dataclass
from typing import Any

from playwright.sync_api import Page

_STOP = """() => {
    const words = one => (one.innerText ?? "").replace(/\\s+/g, " ").trim();
    const end = motion => { try { motion.finish(); } catch { motion.cancel(); } };
    const of = one => {
        one.getAnimations().forEach(end);  // a border on its way from one colour to the other is neither
        const style = getComputedStyle(one), outline = style.outlineStyle === "none" ? "none" :
            `${style.outlineStyle} ${style.outlineWidth} ${style.outlineColor}`;
        return `${outline}; ${style.boxShadow}; ${style.borderColor}`;
    };
    const look = one => [one, one.nextElementSibling, one.parentElement].filter(Boolean).map(of).join(" | ");
    const before = window.stopBefore, at = document.activeElement;
    const gone = before !== undefined && before.one.isConnected && before.one !== at;
    const seen = gone ? before.look !== look(before.one) : null, was = gone ? before.name : "";
    delete window.stopBefore;
    if (at === null || at === document.body || at.tagName === "IFRAME") return { stop: null, seen, was };
    const name = at.getAttribute("aria-label") ?? (at.labels?.length ? words(at.labels[0]) : words(at));
    const region = at.closest("section[aria-label], form[aria-label]")?.getAttribute("aria-label") ?? "";
    window.stopBefore = { one: at, look: look(at), name };
    return { seen, was, stop: { name, region, field: at.name ?? "", tag: at.tagName.toLowerCase() } };
}"""

_MOST_STOPS = 400
_TAKES_LETTERS = ("input", "textarea", "select")


@dataclass(frozen=True)
class Stop:
    """The focused control: its name, region, field in a form, and element."""

    name: str
    region: str
    field: str
    tag: str


class Keys:
    """The keyboard of a page; ``stops`` counts the controls with a visible focus."""

    def __init__(self, page: Page) -> None:
        self._page = page
        self.stops = 0

    def press(self, key: str, times: int = 1) -> None:
        """Press a key ``times`` times."""
        for _ in range(times):
            self._page.keyboard.press(key)

    def write(self, text: str) -> None:
        """Replace the text of the focused box."""
        self._page.keyboard.press("Control+A")
        self._page.keyboard.type(text)

    def shortcut(self, key: str, heading: str) -> None:
        """Open a page by its shortcut, after leaving any box that accepts letters."""
        while (stop := self._look()) is not None and stop.tag in _TAKES_LETTERS:
            self._page.keyboard.press("Tab")
        self._page.keyboard.press(key)
        self._page.get_by_role("heading", level=1, name=heading).wait_for(state="attached")

    def to(self, name: str | re.Pattern[str] = "", *, region: str = "", field: str = "", back: bool = False) -> Stop:
        """Press Tab until the named control has the focus, at most once around the page."""
        ends = 0
        for _ in range(_MOST_STOPS):
            self._page.keyboard.press("Shift+Tab" if back else "Tab")
            stop = self._look()
            if stop is None:
                ends += 1
                assert ends < 3, f"{name or field!r} in {region!r} is not reached by Tab"
                continue
            if _is(stop.name, name) and region in ("", stop.region) and field in ("", stop.field):
                return stop
        raise AssertionError(f"{name or field!r} in {region!r} is not reached in {_MOST_STOPS} stops")

    def use(self, name: str | re.Pattern[str], *, region: str = "", key: str = "Enter") -> None:
        """Move the focus to a control and press a key."""
        self.to(name, region=region)
        self._page.keyboard.press(key)

    def fill(self, values: dict[str, float | str], region: str) -> None:
        """Fill in the fields of a form in their Tab order."""
        for field, value in values.items():
            self.to(region=region, field=field)
            self.write(f"{value:g}" if isinstance(value, float | int) else value)

    def _look(self) -> Stop | None:
        told: dict[str, Any] = self._page.evaluate(_STOP)
        assert told["seen"] is not False, f"the focus on {told['was']!r} could not be seen"
        self.stops += told["seen"] is True
        return None if told["stop"] is None else Stop(**told["stop"])


def _is(name: str, wanted: str | re.Pattern[str]) -> bool:
    return bool(wanted.search(name)) if isinstance(wanted, re.Pattern) else wanted in ("", name)
