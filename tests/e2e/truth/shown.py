"""All that a page shows at one moment, as text, by accessible names.

One call reads the complete page, so that all values are of the same moment.
"""

from dataclasses import dataclass
from typing import Any

from playwright.sync_api import Page

_READ = """() => {
    const seen = one => one.getClientRects().length > 0 && getComputedStyle(one).visibility !== "hidden";
    const all = selector => [...document.querySelectorAll(selector)].filter(seen);
    const words = one => (one.innerText ?? "").replace(/\\s+/g, " ").trim();
    const label = one => one.getAttribute("aria-label");
    const nameOf = one => label(one) ?? (one.labels?.length ? words(one.labels[0]) : words(one));
    const around = "section[aria-label], form[aria-label], [role=alert][aria-label], header, nav, main";
    const common = one => {
        const region = one.closest(around), enabled = !one.disabled && one.getAttribute("aria-disabled") !== "true";
        return { name: nameOf(one), region: region && (label(region) ?? region.tagName.toLowerCase()), enabled };
    };
    const valueOf = one => ["checkbox", "radio"].includes(one.type) ? String(one.checked) :
        one.tagName === "SELECT" ? one.selectedOptions[0]?.text ?? "" : one.value;
    const byLabel = (selector, of, before = "") => {
        const found = {};
        for (const one of all(selector)) found[before + label(one)] ??= of(one);
        return found;
    };
    const figure = one => ({
        unit: /\\[(.*?)\\]/.exec(words(one.querySelector("figcaption")))?.[1] ?? "1",
        values: Object.fromEntries([...one.querySelectorAll("[data-role^='value-']")].map(value =>
            [value.dataset.role.slice(6), value.getAttribute("role") === "img" ? null : words(value)])),
    });
    const aside = one => {
        const head = one.querySelector("h2");
        return head === null ? "" : words(head.parentElement).slice(words(head).length).trim();
    };
    const badge = document.querySelector("header [role=img]");
    return {
        hash: location.hash,
        buttons: all("button").map(one => ({
            ...common(one), value: one.getAttribute("aria-pressed"), busy: one.dataset.loading !== undefined })),
        boxes: all("input:not([type=file]), select").map(one => ({ ...common(one), value: valueOf(one) })),
        sliders: all("[role=slider]").map(one => ({ ...common(one), value: one.getAttribute("aria-valuetext") ?? "" })),
        told: {
            ...byLabel("output[aria-label], [role=status][aria-label], [role=alert][aria-label]", words),
            ...byLabel("[role=group][aria-label]", words, "group "),
        },
        tables: byLabel("table[aria-label]", one => [...one.tBodies[0].rows].map(row => [...row.cells].map(words))),
        heads: byLabel("table[aria-label]", one => [...(one.tHead?.rows[0]?.cells ?? [])].map(words)),
        heading: all("h1").map(words)[0] ?? null,
        ends: all("[data-state]").map(words),
        unsent: all("input[data-unsent]").map(nameOf),
        figures: byLabel("main figure[data-panel]", figure),
        asides: byLabel("main section[aria-label]", aside),
        lists: byLabel("ol[aria-label], ul[aria-label]", one => [...one.children].map(words)),
        refusals: Object.fromEntries(all("output[id]").map(one => [one.id, words(one)])),
        facts: Object.fromEntries(all("main dl").flatMap(one => [...one.querySelectorAll("dt")].map(
            term => [words(term), words(term.nextElementSibling)]))),
        metrics: [...document.querySelectorAll("header [aria-label='Loop timing'] > span")].map(words),
        dry_run: all("main section[aria-label='Dry run']").map(words)[0] ?? null,
        staged: JSON.parse(localStorage.getItem("sinew-staged-tuning") ?? "{}").values ?? {},
        badge: badge === null ? null : [words(badge), label(badge)],
        images: all("header [role=img]").map(nameOf),
        link: document.querySelector("[role=status][aria-label=Link]")?.dataset.health ?? null,
        stale: document.querySelector("[role=status][aria-label=Mode]")?.dataset.stale ?? null,
    };
}"""


@dataclass(frozen=True)
class Control:
    """A displayed button, box or slider; ``value`` is its text, or whether a button is pressed."""

    name: str
    region: str | None
    enabled: bool
    value: str | None
    busy: bool = False


class Shown:
    """One reading of a page; ``all`` contains it by kind."""

    def __init__(self, read: dict[str, Any]) -> None:
        self.all = read
        self.place: str = read["hash"].removeprefix("#/").split("/")[0] or "operate"
        self.told: dict[str, str] = read["told"]
        self.tables: dict[str, list[list[str]]] = read["tables"]
        self.buttons, self.boxes, self.sliders = (
            [Control(**one) for one in read[kind]] for kind in ("buttons", "boxes", "sliders")
        )

    @property
    def is_busy(self) -> bool:
        """Return whether a request is in progress."""
        return any(one.busy for one in self.buttons)

    def button(self, name: str, region: str | None = None) -> Control | None:
        """Return the first button of this name, or None."""
        return _first(self.buttons, name, region)

    def box(self, name: str, region: str | None = None) -> Control | None:
        """Return the first box, switch or choice of this name."""
        return _first(self.boxes, name, region)

    def slider(self, name: str) -> Control | None:
        """Return the first slider of this name."""
        return _first(self.sliders, name, None)

    def offers(self, name: str, region: str | None = None) -> bool:
        """Return whether a button, box or slider of this name is enabled."""
        found = [one for one in (*self.buttons, *self.boxes, *self.sliders) if one.name == name]
        return any(one.enabled and not one.busy and region in (None, one.region) for one in found)


def read(page: Page) -> Shown:
    """Read the current page."""
    return Shown(page.evaluate(_READ))


def _first(controls: list[Control], name: str, region: str | None) -> Control | None:
    return next((one for one in controls if one.name == name and region in (None, one.region)), None)
