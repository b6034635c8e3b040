"""The chart workspace: displayed values agree with the service and the recordings."""

import math
import re
from functools import partial
from typing import Any
from xml.etree import ElementTree

import pytest
from playwright.sync_api import Locator, Page, expect
from pypdf import PdfReader

from plant.interface import T_s
from tests.e2e.operator import MOTION_TIMEOUT_MS, Operator, kept
from tests.e2e.page_texts import load_texts

RUNS = load_texts("pages/runs")
CHARTS = load_texts("charts")
THEME = load_texts("theme")

DEGREES = 180.0 / math.pi
AT_S = 2.5
SMOOTH_SEGMENT_S = 15.0

READINGS = """names => Object.fromEntries(names.map(name => [name, Number(
    document.querySelector(`[data-role="value-${name}"]`).textContent.replace("\\u2212", "-"))]))"""
SVG = "{http://www.w3.org/2000/svg}"


@pytest.fixture
def laid_out(same_operator: Operator) -> Operator:
    """An operator in mode Run with an own layout of charts."""
    operator, page = same_operator, same_operator.page
    page.mouse.move(5, 5)
    operator.be_in_run()
    page.get_by_role("combobox", name="Layout", exact=True).select_option("Standard")
    edit = page.get_by_role("button", name=CHARTS["editLayout"], exact=True)
    if edit.get_attribute("aria-pressed") != "true":
        edit.click()
    custom = f"optgroup[label={CHARTS['custom']}] option"
    for old in page.get_by_role("combobox", name="Layout", exact=True).locator(custom).all():
        page.get_by_role("combobox", name="Layout", exact=True).select_option(old.inner_text())
        page.get_by_role("button", name=CHARTS["removeLayout"], exact=True).click()
    editor = page.get_by_role("region", name=CHARTS["editor"], exact=True)
    editor.get_by_role("textbox", name=CHARTS["searchSignals"], exact=True).fill("")
    editor.get_by_role("button", name="New panel with q - q_ref", exact=True).click()
    editor.get_by_role("button", name="New panel with S", exact=True).click()
    editor.get_by_role("combobox", name="Axis of Joint stiffness 2", exact=True).select_option("q")
    for title in (THEME["force"], THEME["voltage"], THEME["externalForce"]):
        editor.get_by_role("button", name=f"Remove {title}", exact=True).click()
    name = editor.get_by_role("textbox", name=CHARTS["layoutName"], exact=True)
    name.fill("Mine")
    with page.expect_response(kept("layout", "Mine")):
        name.press("Enter")
    return operator


def panels(page: Page) -> list[str]:
    return [str(one.get_attribute("aria-label")) for one in page.locator("figure[data-panel]").all()]


def test_an_own_layout_shows_the_live_values_and_is_restored_after_a_reload(laid_out: Operator) -> None:
    page = laid_out.page
    wanted = ["Joint position", "Joint stiffness", "q - q_ref", "Joint stiffness 2"]
    expect(page.get_by_role("figure", name="Joint stiffness 2", exact=True)).to_be_visible()
    assert panels(page) == wanted
    laid_out.enter("q_ref value [°]", 12.0)
    laid_out.wait(lambda: abs(laid_out.reading("Joint position", "q") - 12.0) < 0.3)

    told = laid_out.state()["references"]
    read = page.evaluate(READINGS, ["q", "q_ref", "q - q_ref", "S", "S_ref"])
    assert read["q_ref"] == pytest.approx(told["q_ref"] * DEGREES, abs=0.005001)
    assert read["S_ref"] == pytest.approx(told["S_ref"], abs=0.0005001)
    assert read["q - q_ref"] == pytest.approx(read["q"] - read["q_ref"], abs=0.0106)
    over = page.get_by_role("figure", name="Joint stiffness 2", exact=True).locator("[data-role=over]")
    laid_out.wait(lambda: abs(float(over.inner_text().replace("\u2212", "-")) - 12.0) < 0.3)

    page.reload()
    expect(page.get_by_role("figure", name="q - q_ref", exact=True)).to_be_visible(timeout=MOTION_TIMEOUT_MS)
    assert panels(page) == wanted
    expect(page.get_by_role("combobox", name="Layout", exact=True)).to_have_value("Mine")


def test_a_signal_of_another_unit_is_refused_and_the_layout_is_unchanged(laid_out: Operator) -> None:
    page = laid_out.page
    before = page.request.get(f"{laid_out.service.url}/api/preferences").json()
    editor = page.get_by_role("region", name=CHARTS["editor"], exact=True)
    editor.get_by_role("combobox", name="Add a signal to Joint position", exact=True).select_option("u_A")
    expect(editor.get_by_role("alert")).to_have_text(
        THEME["oneUnit"].format(signal="u_A", unit="V", title=THEME["position"], shown="rad")
    )
    assert page.request.get(f"{laid_out.service.url}/api/preferences").json() == before


def drag(page: Page, what: Locator, onto: Locator) -> None:
    """Drag between two visible points, because scrolling would interrupt the drag."""
    what.hover()
    there = onto.bounding_box()
    assert there is not None
    page.mouse.down()
    page.mouse.move(there["x"] + there["width"] / 2, there["y"] + there["height"] / 2, steps=8)
    page.mouse.up()


def test_signals_are_searched_and_dragged_onto_panels(laid_out: Operator) -> None:
    page = laid_out.page
    editor = page.get_by_role("region", name=CHARTS["editor"], exact=True)
    editor.get_by_role("textbox", name=CHARTS["searchSignals"], exact=True).fill("deviation")
    tree = editor.get_by_role("region", name="Signals", exact=True)
    expect(tree.get_by_role("button", name="New panel with F_A", exact=True)).to_have_count(0)
    editor.get_by_role("textbox", name=CHARTS["searchSignals"], exact=True).fill("S_")
    figure = page.get_by_role("figure", name="Joint stiffness", exact=True)
    own = page.get_by_role("button", name="New panel with S_true", exact=True)
    shown = tree.locator("[draggable]", has=own).locator(".symbol")
    drag(page, shown, editor.get_by_role("listitem", name="Joint stiffness", exact=True))
    expect(figure.get_by_role("button", name="S_true", exact=True)).to_be_visible()

    drag(page, shown, editor.get_by_role("listitem", name="Joint position", exact=True))
    expect(editor.get_by_role("alert")).to_have_text(
        THEME["oneUnit"].format(signal="S_true", unit="N·m/rad", title=THEME["position"], shown="rad")
    )


def test_panels_are_moved_and_resized_with_the_keyboard(laid_out: Operator) -> None:
    page = laid_out.page
    editor = page.get_by_role("region", name=CHARTS["editor"], exact=True)
    down = editor.get_by_role("button", name="Move Joint position down", exact=True)
    down.focus()
    page.keyboard.press("Enter")
    expect(down).to_be_focused()
    expect(page.locator("figure[data-panel]").first).to_have_attribute("aria-label", "Joint stiffness")
    figure = page.get_by_role("figure", name="Joint position", exact=True)
    height = figure.evaluate("one => one.clientHeight / one.parentElement.clientHeight")
    editor.get_by_role("button", name=CHARTS["higher"].replace("{panel}", THEME["position"]), exact=True).focus()
    for _ in range(2):
        page.keyboard.press("Enter")
    expect(editor.get_by_role("status", name="Height of Joint position", exact=True)).to_have_text("× 2.0")
    laid_out.wait(lambda: figure.evaluate("one => one.clientHeight / one.parentElement.clientHeight") > height)


def test_a_panel_is_resized_by_dragging_its_edge(laid_out: Operator) -> None:
    page = laid_out.page
    figure = page.get_by_role("figure", name="Joint position", exact=True)
    figure.scroll_into_view_if_needed()
    box = figure.bounding_box()
    assert box is not None
    x, bottom = box["x"] + box["width"] / 2, box["y"] + box["height"]
    page.mouse.move(x, bottom - 1.0)
    page.mouse.down()
    page.mouse.move(x, bottom + 0.9 * box["height"], steps=8)
    page.mouse.up()
    height = page.get_by_role("status", name="Height of Joint position", exact=True)
    expect(height).to_have_text("× 2.0")


def recorded(operator: Operator, run: int, **asked: Any) -> dict[str, Any]:
    answer = operator.page.request.get(f"{operator.service.url}/api/runs/{run}/samples", params=asked)
    assert answer.ok, answer.text()
    found: dict[str, Any] = answer.json()
    return found


def test_a_replay_uses_the_same_layout_and_shows_the_recorded_values(laid_out: Operator) -> None:
    page, run = laid_out.page, finished_run(laid_out)
    length = page.request.get(f"{laid_out.service.url}/api/runs/{run}").json()["duration_s"]
    page.goto(f"{laid_out.service.url}/#/runs/{run}@{AT_S}")
    chart = page.get_by_role("figure", name="q - q_ref", exact=True)
    expect(chart).to_be_visible(timeout=MOTION_TIMEOUT_MS)
    chart.press("Home")  # shows the complete recording
    assert panels(page) == ["Joint position", "Joint stiffness", "q - q_ref", "Joint stiffness 2"]
    expect(page.get_by_role("status", name=RUNS["resolution"], exact=True)).not_to_have_text(RUNS["loading"])

    raw = every_sample(laid_out, run, length, "q", "q_ref", "q - q_ref", "S", "lam_q", "lam_S")
    for q, q_ref, error in zip(raw["q"], raw["q_ref"], raw["q - q_ref"], strict=True):
        assert (error is None) == (q_ref is None)
        assert error is None or error == pytest.approx(q - q_ref, abs=1e-6)

    page.mouse.move(5, 5)
    at = page.get_by_role("slider", name=RUNS["replayPosition"]).get_attribute("aria-valuenow")
    assert float(str(at)) == pytest.approx(AT_S)
    for name, digits in (("q", 2), ("q - q_ref", 3)):
        laid_out.wait(partial(reads, page, name, raw[name][round(AT_S / T_s)] * DEGREES, digits))

    page.get_by_role("button", name=CHARTS["savePicture"], exact=True).click()
    with page.expect_download() as download:
        page.get_by_role("menuitem", name=CHARTS["svg"], exact=True).click()
    drawing = ElementTree.fromstring(download.value.path().read_text(encoding="utf-8"))
    foot = [one.text or "" for one in drawing.iter(f"{SVG}text") if one.get("data-role") == "foot"]
    settings = page.request.get(f"{laid_out.service.url}/api/runs/{run}").json()["settings"]
    assert next(one["value"] for one in settings if one["name"] == "bank") == 0
    lam_q, lam_S = raw["lam_q"][-1], raw["lam_S"][-1]
    assert foot[0] == f"run {run} · SIM (simulator) · λ_q {lam_q:.4g} s · λ_S {lam_S:.4g} s · geometric gains"
    assert foot[1].startswith("0:00.000 to ")
    for name, factor in (("q", DEGREES), ("q - q_ref", DEGREES), ("S", 1.0)):
        values = [factor * one for one in raw[name] if one is not None]
        drawn = drawn_values(drawing, name)
        assert min(drawn) == pytest.approx(min(values), abs=0.005 * (max(values) - min(values)) + 1e-3)
        assert max(drawn) == pytest.approx(max(values), abs=0.005 * (max(values) - min(values)) + 1e-3)
    told = next(one.text or "" for one in drawing.iter(f"{SVG}text") if one.get("data-signal") == "q - q_ref")
    errors = [DEGREES * one for one in raw["q - q_ref"] if one is not None]
    read = [float(one.replace("\u2212", "-")) for one in re.findall(r"[\u2212\d.]+(?= to |$)", told)]
    assert read == pytest.approx([min(errors), max(errors)], abs=0.00051)
    is_printed_as_drawn(page, drawing)


def is_printed_as_drawn(page: Page, drawing: ElementTree.Element) -> None:
    """Check the PDF of the same view: size of the sheet, all texts as characters, no dots."""
    page.get_by_role("button", name=CHARTS["savePicture"], exact=True).click()
    with page.expect_download() as download:
        page.get_by_role("menuitem", name=CHARTS["pdf"], exact=True).click()
    assert download.value.suggested_filename.endswith(".pdf")
    (printed,) = PdfReader(download.value.path()).pages
    for side, points in (("width", printed.mediabox.width), ("height", printed.mediabox.height)):
        assert float(points) * 25.4 / 72.0 == pytest.approx(float(str(drawing.get(side)).removesuffix("mm")), abs=0.1)
    # except the time of saving
    drawn = [one.text or "" for one in drawing.iter(f"{SVG}text") if " · saved " not in (one.text or "")]
    assert any(one.startswith("run ") for one in drawn)
    assert CHARTS["timeSinceStart"] in drawn
    letters = "".join(printed.extract_text().split())  # gaps do not indicate the ends of words
    assert [one for one in drawn if "".join(one.split()) not in letters] == []
    assert not printed.images


def every_sample(operator: Operator, run: int, length: float, *names: str) -> dict[str, list[float]]:
    """Return columns of the complete recording, requested in parts that the service does not reduce."""
    raw: dict[str, list[float]] = {name: [] for name in names}
    for piece in range(math.ceil(length / SMOOTH_SEGMENT_S)):
        asked = {"from": piece * SMOOTH_SEGMENT_S, "to": (piece + 1) * SMOOTH_SEGMENT_S, "points": 20_000}
        found = recorded(operator, run, signals=",".join(names), **asked)
        assert found["raw"]
        for name in names:
            raw[name] += found["signals"][name]["minimum"]
    return raw


def finished_run(operator: Operator) -> int:
    """Record a manual session of some seconds with a step, and wait until it is stored."""
    page = operator.page
    operator.press("Pretension")
    operator.expect_mode("pretension")
    operator.press("Run")
    operator.expect_mode("run")
    operator.wait(lambda: operator.state()["recording_run"] is not None)
    run = int(operator.state()["recording_run"])
    operator.wait_for_samples(500)
    target = 10.0 if abs(operator.reading("Joint position", "q_ref")) < 5.0 else 0.0
    operator.enter("q_ref value [°]", target)
    operator.wait(lambda: abs(operator.reading("Joint position", "q") - target) < 0.3)
    operator.wait_for_samples(1500)
    operator.press("Pretension")
    operator.wait(lambda: page.request.get(f"{operator.service.url}/api/runs/{run}").json()["end_state"] != "running")
    return run


def reads(page: Page, name: str, value: float, digits: int) -> bool:
    found = float(page.evaluate(READINGS, [name])[name])
    return abs(found - value) <= 0.51 * 10.0**-digits


def drawn_values(drawing: ElementTree.Element, name: str) -> list[float]:
    """Return the values of a drawn curve, computed from the ends of its axis."""
    curve = next(one for one in drawing.iter(f"{SVG}path") if one.get("data-curve") == name)
    low, high = (float(part) for part in str(curve.get("data-y")).split())
    _, top, _, height = (float(part) for part in str(curve.get("data-box")).split())
    points = re.findall(r"[ML][\d.-]+ ([\d.-]+)", str(curve.get("d")))
    return [high - (float(y) - top) / height * (high - low) for y in points]
