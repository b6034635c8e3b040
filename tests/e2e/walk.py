"""Walk over a page: find every usable control anew after each action, and use it.

A control is identified by its role, its name, and its index among controls of that name. Using a control may change the
page; the walk continues with controls that it has not used, until none is left.
"""

from dataclasses import dataclass
from typing import Any

from playwright.sync_api import Error, Locator, Page

_FIND = """skipped => {
    const words = one => (one.innerText ?? "").replace(/\\s+/g, " ").trim();
    const seen = one => one.getClientRects().length > 0 && getComputedStyle(one).visibility !== "hidden";
    const nameOf = one => one.getAttribute("aria-label") ?? (one.labels?.length ? words(one.labels[0]) : words(one));
    const kinds = "button, a[href], input, select, textarea, summary, [role=slider], [role=menuitem], canvas[role=img]";
    const counts = new Map(), found = [];
    for (const one of document.querySelectorAll(kinds)) {
        if (!seen(one) || one.closest(skipped)) continue;
        const kind = one.getAttribute("role") ?? (one.tagName === "INPUT" ? one.type : one.tagName.toLowerCase());
        const key = `${kind} ${nameOf(one)}`, count = counts.get(key) ?? 0;
        counts.set(key, count + 1);
        one.dataset.walked = `${key} ${count}`;
        found.push({ key: one.dataset.walked, kind, name: nameOf(one), href: one.getAttribute("href"),
            enabled: !one.disabled && one.getAttribute("aria-disabled") !== "true",
            told: (one.title + " " + (one.getAttribute("aria-describedby") ?? "").split(" ")
                .map(id => document.getElementById(id)?.innerText ?? "").join(" ")).trim() });
    }
    return found;
}"""

OVERLAY = "[role=dialog], [role=menu]"
_SHORT_MS = 3000


@dataclass(frozen=True)
class Found:
    """A control that was found; ``told`` is the description that accompanies its name."""

    key: str
    kind: str
    name: str
    href: str | None
    enabled: bool
    told: str

    def on(self, page: Page) -> Locator:
        """Return the control on the page."""
        return page.locator(f'[data-walked="{self.key.replace(chr(34), chr(92) + chr(34))}"]').first


def controls(page: Page, skipped: str) -> list[Found]:
    """Return all visible controls outside of the selector ``skipped``."""
    found: list[dict[str, Any]] = page.evaluate(_FIND, skipped)
    return [Found(**one) for one in found]


def use(page: Page, control: Found) -> bool:
    """Use a control according to its kind; return whether it still existed."""
    place = control.on(page)
    try:
        match control.kind:
            case "text" | "search" | "textarea" | "number":
                place.fill("0.4" if control.name.endswith("]") else "word", timeout=_SHORT_MS)
                place.press("Enter", timeout=_SHORT_MS)
            case "date":
                place.fill("2001-01-01", timeout=_SHORT_MS)
            case "select":
                place.select_option(index=place.locator("option").count() - 1, timeout=_SHORT_MS)
            case "checkbox" | "switch" | "radio":
                place.press("Space", timeout=_SHORT_MS)
            case "slider":
                place.press("ArrowRight", timeout=_SHORT_MS)
            case "file":
                return False
            case _:
                place.click(timeout=_SHORT_MS)
    except Error:
        return False
    return True
