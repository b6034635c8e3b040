"""Read a form as a person sees it, the request that its button sends, and the result.

Fields are found by their name in the form; label, unit and value are read as displayed.
"""

import math
import re
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from playwright.sync_api import Browser, Locator, Page

Values = dict[str, bool | float | str]

TO_SI = {
    "°": ("rad", math.pi / 180.0),
    "°/s": ("rad/s", math.pi / 180.0),
    "": ("1", 1.0),
}
"""Units that a person is shown in place of the one that is sent, with the factor between both."""

REPORT_TIMEOUT_MS = 120_000
"""The first report of a service starts the process that draws it."""

ROUNDED = 6e-6
"""Numbers in reports and tables have six significant digits, and so have angles that nobody typed in their boxes."""

_UNIT = re.compile(r"^(?P<words>.*?)(?: \[(?P<unit>[^\]]+)\])?$", re.DOTALL)
_FIELDS = """form => [...form.elements].filter(box => box.name !== "").map(box => ({
    name: box.name,
    words: box.labels?.[0]?.innerText ?? box.getAttribute("aria-label"),
    text: box.type === "checkbox" ? box.checked : box.tagName === "SELECT" ? box.selectedOptions[0].text : box.value,
    value: box.type === "checkbox" ? box.checked : box.value,
    about: [...box.getAttribute("aria-describedby")?.split(" ") ?? []]
        .map(id => document.getElementById(id)?.innerText ?? "").join("; "),
    disabled: box.disabled,
}))"""


@dataclass(frozen=True)
class Field:
    """One displayed field: label, unit, text, value in SI, and the text below it."""

    words: str
    unit: str
    text: str | bool
    value: bool | float | str
    about: str
    disabled: bool


def fields(form: Locator) -> dict[str, Field]:
    """Return the fields of a form by name; collapsed settings are expanded first."""
    for folded in form.locator("details:not([open]) > summary").all():
        folded.click()
    found = {}
    for box in form.evaluate(_FIELDS):
        shown = _UNIT.match(box["words"])
        assert shown is not None
        unit = shown["unit"] or ""
        value = _in_si(box["value"], unit)
        found[box["name"]] = Field(shown["words"], unit, box["text"], value, box["about"], box["disabled"])
    return found


def shown(form: Locator) -> Values:
    """Return all values that a form shows, by name, in SI."""
    return {name: field.value for name, field in fields(form).items()}


def fill(form: Locator, changes: Mapping[str, bool | float | str]) -> None:
    """Fill in fields by name: numbers in SI, converted to the unit of the field."""
    standing = fields(form)
    for name, value in changes.items():
        box = form.locator(f"[name={name}]")
        if isinstance(value, bool):
            box.set_checked(value)
        elif box.evaluate("box => box.tagName") == "SELECT":
            box.select_option(f"{value:g}" if isinstance(value, float) else str(value))
        else:
            assert isinstance(value, int | float)
            _, factor = TO_SI.get(standing[name].unit, ("", 1.0))
            box.fill(f"{value / factor:.12g}")


def pressed(page: Page, button: Locator, path: str) -> tuple[Any, Any]:
    """Press a button; return the request that the browser sent to ``path``, and the response."""
    with page.expect_request(lambda request: request.method != "GET" and request.url.endswith(path)) as caught:
        button.click()
    answer = caught.value.response()
    assert answer is not None
    assert answer.ok, answer.text()
    return caught.value.post_data_json, answer.json()


def reported(browser: Browser, page: Page, url: str) -> list[tuple[str, Any]]:
    """Return the settings in the report of a run, in SI, with their labels."""
    context = browser.new_context(storage_state=page.context.storage_state())
    report = context.new_page()
    report.goto(url, wait_until="domcontentloaded", timeout=REPORT_TIMEOUT_MS)
    settings = _rows(report, "Settings of the run.")
    context.close()
    return [(words, _in_si(text, unit)) for words, _symbol, text, unit in settings[1:]]


def _rows(report: Page, caption: str) -> list[list[str]]:
    """Return the cells of the table with this caption, heading first; empty without such a table."""
    return [
        cells
        for table in report.locator("table", has=report.locator("caption", has_text=caption)).all()
        for cells in table.evaluate("table => [...table.rows].map(row => [...row.cells].map(cell => cell.innerText))")
    ]


def same(one: object, other: object, relative: float = 1e-9) -> bool:
    """Return whether two values are equal."""
    if isinstance(one, bool) or isinstance(other, bool) or isinstance(one, str) or isinstance(other, str):
        return one == other
    if not (isinstance(one, int | float) and isinstance(other, int | float)):
        return one == other
    return math.isclose(one, other, rel_tol=relative, abs_tol=1e-12)


SETTLED = {"seed": 0}
"""Settings with one possible value on a service that runs: a form offers no field for them, and sends the value."""


def as_sent(shown: Mapping[str, object], sent: Mapping[str, object]) -> dict[str, object]:
    """Return the values of a form, with the fixed settings that it sends without showing them."""
    return {**{name: value for name, value in SETTLED.items() if name in sent}, **shown}


def differences(one: Mapping[str, object], other: Mapping[str, object], relative: float = 1e-9) -> list[str]:
    """Return the names of values that differ or are missing in one of two sets."""
    return [
        f"{name}: {one.get(name, 'missing')!r} and {other.get(name, 'missing')!r}"
        for name in sorted(one.keys() | other.keys())
        if name not in one or name not in other or not same(one[name], other[name], relative)
    ]


def _in_si(text: str | bool, unit: str) -> bool | float | str:
    value = _value(text)
    return value * TO_SI.get(unit, (unit, 1.0))[1] if isinstance(value, float) else value


def _value(text: str | bool) -> bool | float | str:
    if isinstance(text, bool):
        return text
    if text in ("yes", "no"):
        return text == "yes"
    try:
        return float(text.replace("\u2212", "-"))
    except ValueError:
        return text
