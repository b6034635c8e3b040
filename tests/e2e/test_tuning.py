"""Tuning on the page: staged edits, a trial after its page is closed, saving and undo, connection losses."""

import math
import re
from collections.abc import Iterator
from functools import partial

import httpx
import pytest
from playwright.sync_api import Browser, Locator, Route, expect

from backend.tuning.gains import make_motor_loops, motor_model
from backend.tuning.robustness import motor_robustness
from plant.parameters import load_parameters
from tests.api.conftest import client_with, until, until_state
from tests.e2e.browser import DESKTOP
from tests.e2e.operator import MOTION_TIMEOUT_MS, Operator, kept
from tests.e2e.page_texts import load_texts
from tests.e2e.relay import Relay, relayed
from tests.e2e.service import Service
from tests.e2e.sharing import SharedPage, bring_to_run, shared_page

EXPERIMENT_TEXTS = load_texts("pages/experiments")
OPERATE = load_texts("pages/operate")

DISCONNECTIONS = 10
WINDOW_S = 30
COUNT_LOSSES = """() => {
    const link = document.querySelector("[role=status][aria-label=Link]");
    Object.assign(window, { losses: 0, connections: 0 });
    new MutationObserver(() => { window.losses += link.dataset.health === "down"; })
        .observe(link, { attributes: true, attributeFilter: ["data-health"] });
    window.WebSocket = class extends WebSocket {
        constructor(...to) {
            super(...to);
            this.addEventListener("message", () => { window.connections += 1; }, { once: true });
        }
    };
}"""
"""A connection counts once something has come through it: on a busy machine one may be tried twice before."""
COUNTED = "[losses, connections]"

FIGURES = re.compile(r"/api/tuning/(motor|preview)\?")


@pytest.fixture(scope="module")
def shared(browser: Browser, service: Service) -> Iterator[SharedPage]:
    with shared_page(browser, service, "operate") as shared:
        yield shared


@pytest.fixture
def tuning(shared: SharedPage, service: Service, request: pytest.FixtureRequest) -> Iterator[Operator]:
    """The page Operate with the saved tuning active."""
    put_back(service)
    with shared.turn_of(request) as operator:
        operator.go("Operate")
        expect(table(operator)).to_be_visible(timeout=MOTION_TIMEOUT_MS)
        yield operator


def show_saved(operator: Operator) -> None:
    """Sign in and open the tuning card."""
    operator.sign_in()
    operator.go("Operate")
    expect(table(operator)).to_be_visible(timeout=MOTION_TIMEOUT_MS)


def put_back(service: Service) -> None:
    """End a trial and restore the saved tuning."""
    with client_with(service, "token") as script:
        until(
            lambda: script.get("/api/state").raise_for_status().json()["holder"] is None
        )  # pages of earlier tests are closed
        if script.get("/api/state").raise_for_status().json()["trial"] is not None:
            script.delete("/api/tuning/trial").raise_for_status()
        saved = script.get("/api/tuning/saved").raise_for_status().json()
        parts = {name: saved[name] for name in ("lam_q", "lam_S", "lam_motor", "b", "interpolate", "motion", "u_plan")}
        script.put("/api/tuning", json=parts).raise_for_status()
        script.delete("/api/control").raise_for_status()


def table(operator: Operator) -> Locator:
    return operator.page.get_by_role("table", name=OPERATE["tuningTable"], exact=True)


def height_of_changes(operator: Operator) -> float:
    """Return the distance from the top of the table to the next card [px], independent of scrolling."""
    top, below = table(operator).bounding_box(), operator.page.get_by_role("region", name="Touch", exact=True)
    next_card = below.bounding_box()
    assert top is not None
    assert next_card is not None
    return next_card["y"] - top["y"]


def data_in_sight(operator: Operator) -> tuple[float, float]:
    """Return the times of the oldest and the newest visible sample [s of the loop], from the saved data."""
    page = operator.page
    page.get_by_role("combobox", name=OPERATE["timeWindow"], exact=True).select_option(str(WINDOW_S))
    with page.expect_download() as download:
        page.get_by_role("button", name="Save data", exact=True).click()
    lines = download.value.path().read_text(encoding="utf-8").splitlines()
    return float(lines[1].split(",")[0]), float(lines[-1].split(",")[0])


def cells(operator: Operator, symbol: str) -> list[str]:
    """Return the saved, active and staged value of a λ."""
    row = table(operator).get_by_role("row").filter(has=operator.page.get_by_role("rowheader", name=symbol))
    return [cell.inner_text() for cell in row.get_by_role("cell").all()]


def test_ten_connection_losses_send_no_command_and_the_charts_are_refilled(operator: Operator) -> None:
    put_back(operator.service)
    bring_to_run(operator.service, math.radians(15.0))
    with relayed(operator.service) as (operator.service, relay):
        show_saved(operator)
        lose_ten_links(operator, relay)
        operator.page.close()  # before the relay ends, so that no request fails


def lose_ten_links(tuning: Operator, relay: Relay) -> None:
    """Interrupt the connection ten times; control is free, because its holder would be detected as lost."""
    page = tuning.page
    tuning.wait(lambda: abs(tuning.reading("Joint position", "q") - 15.0) < 0.3)
    page.get_by_role("switch", name="Stage changes").check()
    tuning.enter("λ_q value [s]", 0.66)
    with page.expect_response(kept("window_s", WINDOW_S)):
        oldest, _ = data_in_sight(tuning)
    page.evaluate(COUNT_LOSSES)
    sent: list[str] = []
    page.on("request", lambda request: sent.append(request.method) if request.method != "GET" else None)
    link = page.get_by_role("status", name="Link", exact=True)

    def another(before: list[int]) -> bool:
        return all(now > then for now, then in zip(page.evaluate(COUNTED), before, strict=True))

    for _ in range(DISCONNECTIONS):
        before = page.evaluate(COUNTED)
        relay.cut("/api/live")
        tuning.wait(partial(another, before))
        expect(link).to_have_attribute("data-health", "live")
    assert sent == []
    tuning.expect_mode("run")
    tuning.wait(lambda: tuning.reading("Joint position", "q_ref") == pytest.approx(15.0, abs=0.01))
    assert cells(tuning, "λq")[2] == "0.660 s"
    # each loss was shown and followed by one connection; a busy machine may lose one more
    losses, connections = page.evaluate(COUNTED)
    assert losses == connections >= DISCONNECTIONS
    first, last = data_in_sight(tuning)
    assert first < max(oldest, last - WINDOW_S) + 1.0
    page.get_by_role("button", name="Discard", exact=True).click()
    page.get_by_role("switch", name="Stage changes").uncheck()


def test_a_trial_reverts_after_its_page_is_closed(operator: Operator, browser: Browser, service: Service) -> None:
    put_back(service)
    show_saved(operator)
    page = operator.page
    page.get_by_role("switch", name="Stage changes").check()
    operator.enter("λ_S value [s]", 0.8)
    page.get_by_role("textbox", name=OPERATE["trialDuration"], exact=True).fill("12")
    before = height_of_changes(operator)
    page.get_by_role("button", name="Try for", exact=True).click()
    expect(page.get_by_role("status", name="Trial", exact=True)).to_contain_text(
        OPERATE["trialReverts"].partition("{others}")[0].format(lam_q="0.500", lam_S="0.420")
    )
    assert abs(height_of_changes(operator) - before) < 1.0
    page.close()
    with client_with(service, "token") as script:
        until_state(script, lambda told: told["trial"] is None, "the trial does not end")

    context = browser.new_context(viewport=DESKTOP)
    other = Operator(context.new_page(), service)
    other.sign_in()
    other.wait(lambda: table(other).is_visible() and cells(other, "λS")[1] == "0.420 s")
    expect(other.page.get_by_role("status", name="Trial", exact=True)).to_be_hidden()
    context.close()


def test_staged_edits_survive_a_reload_and_are_sent_only_when_applied(tuning: Operator) -> None:
    page = tuning.page
    page.get_by_role("switch", name="Stage changes").check()
    tuning.enter("λ_q value [s]", 0.7)
    tuning.wait(lambda: cells(tuning, "λq") == ["0.500 s", "0.500 s", "0.700 s"])
    page.reload()
    expect(table(tuning)).to_contain_text("0.700", timeout=MOTION_TIMEOUT_MS)
    tuning.wait(lambda: cells(tuning, "λq") == ["0.500 s", "0.500 s", "0.700 s"])

    page.get_by_role("button", name="Apply", exact=True).click()
    tuning.wait(lambda: cells(tuning, "λq") == ["0.500 s", "0.700 s", "–"])
    page.get_by_role("switch", name="Stage changes").uncheck()
    page.get_by_role("button", name="Revert to saved", exact=True).click()
    tuning.wait(lambda: cells(tuning, "λq") == ["0.500 s", "0.500 s", "–"])


def test_buttons_do_not_move_while_figures_are_computed(tuning: Operator) -> None:
    page, held, asked = tuning.page, list[Route](), set[str]()
    margins = page.get_by_role("status", name="Motor loop")
    preview = page.get_by_role("group", name=OPERATE["preview"].format(symbol="λ_q"), exact=True)
    expect(preview).to_contain_text(OPERATE["sensitivityPeak"])
    expect(margins).to_contain_text("phase margin")

    def hold(route: Route) -> None:
        found = FIGURES.search(route.request.url)
        assert found is not None
        held.append(route)
        asked.add(found[1])

    page.route(FIGURES, hold)
    page.reload()
    switch = page.get_by_role("switch", name="Stage changes")
    switch.check()
    tuning.wait(lambda: asked == {"motor", "preview"})
    before = switch.bounding_box()
    page.route(FIGURES, lambda route: route.continue_())
    for one in held:
        one.continue_()
    expect(preview).to_contain_text(OPERATE["sensitivityPeak"])
    expect(margins).to_contain_text("phase margin")
    assert switch.bounding_box() == before
    tuning.enter("λ_q value [s]", 0.7)
    tuning.wait(lambda: cells(tuning, "λq")[2] == "0.700 s")
    of_motors: list[str] = []
    page.on("request", lambda request: of_motors.append(request.url) if "/tuning/motor" in request.url else None)
    apply = page.get_by_role("button", name="Apply", exact=True)
    apply.hover()
    page.mouse.down()  # the focus scrolls the complete button into view
    before = switch.bounding_box()
    page.mouse.up()  # the staged preview becomes the active one
    tuning.wait(lambda: cells(tuning, "λq") == ["0.500 s", "0.700 s", "–"])
    assert of_motors == []  # the margins of the motor loop depend on another λ
    assert switch.bounding_box() == before
    page.unroute(FIGURES)
    switch.uncheck()


def test_the_margins_of_the_motor_loop_are_shown_next_to_its_lambda(tuning: Operator) -> None:
    """For the active λ on Operate, and for the entered λ in the form of an experiment."""
    page = tuning.page
    expect(page.get_by_role("status", name="Motor loop")).to_contain_text(shown(0.0854))
    tuning.go("Experiments")
    form = page.get_by_role("form").first
    form.get_by_text(EXPERIMENT_TEXTS["loopSettings"].split(":")[0]).click()
    margins = form.get_by_role("status", name="Motor loop")
    expect(margins).to_contain_text(shown(0.0854))
    form.locator("[name=lam_motor]").fill("0.05")
    expect(margins).to_contain_text(shown(0.05))


def shown(lam_motor: float) -> str:
    """Return M_s and margins of the less robust motor of the tested set, as the page formats them."""
    parameters, gains = load_parameters("lab"), make_motor_loops(load_parameters("lab"), lam_motor)
    loops = [
        motor_robustness(motor_model(parameters, "A"), gains.A),
        motor_robustness(motor_model(parameters, "B"), gains.B),
    ]
    worst = max(loops, key=lambda loop: loop.M_s)
    up = f"{worst.gain_margin:.1f} ({20.0 * math.log10(worst.gain_margin):.1f} dB)"
    gain = f"{worst.gain_reduction:.3f} to {up}" if worst.gain_reduction else up
    phase = math.degrees(worst.phase_margin)
    return f"M_s {worst.M_s:.3f}, gain margin {gain}, phase margin {phase:.0f}°"


def test_the_printed_formula_is_labelled_as_a_comparison(tuning: Operator) -> None:
    page = tuning.page
    printed = page.get_by_role("checkbox", name=OPERATE["compare"])
    printed.check()
    preview = page.get_by_role("group", name=OPERATE["preview"].format(symbol="λ_q"), exact=True)
    expect(preview).to_contain_text(
        OPERATE["asPrinted"].partition(" (")[0].format(value=OPERATE["unstable"]), timeout=MOTION_TIMEOUT_MS
    )
    forecast = page.get_by_role("status", name=OPERATE["forecastOfQ"], exact=True)
    expect(forecast).to_contain_text(re.compile(r"peak \d+\.\d of 10 V, tension ≥ \d+\.\d N"))
    printed.uncheck()


PREVIEWS = re.compile(r"/api/tuning/preview\?")


@pytest.mark.parametrize(("motion", "lam_q"), [("lambda", 1.3), ("time-optimal", 1.4)])
def test_an_outdated_preview_is_grey_until_the_new_one_is_computed(
    tuning: Operator, service: Service, motion: str, lam_q: float
) -> None:
    """The state is also announced; afterwards, each number agrees with the service."""
    page, held = tuning.page, list[Route]()
    with client_with(service, "token") as script:
        script.put("/api/tuning", json={"motion": motion, "u_plan": 8.5}).raise_for_status()
    shown_parts = {
        "loop": page.get_by_role("group", name=OPERATE["preview"].format(symbol="λ_q"), exact=True),
        "step": page.get_by_role("status", name=OPERATE["forecastOfQ"], exact=True),
        "push": page.get_by_role("status", name=OPERATE["pushForecast"], exact=True),
    }
    trajectory = OPERATE["timeOptimalStep"] if motion == "time-optimal" else ""
    expect(shown_parts["step"]).to_contain_text(f"N·m/rad{trajectory}: 90 %", timeout=MOTION_TIMEOUT_MS)
    for part in shown_parts.values():
        expect(part).to_have_attribute("aria-busy", "false")
    before = {name: part.inner_text() for name, part in shown_parts.items()}
    figures = {name: part.locator("dd").first if name == "loop" else part for name, part in shown_parts.items()}
    colours = {name: figure.evaluate("one => getComputedStyle(one).color") for name, figure in figures.items()}

    page.get_by_role("switch", name="Stage changes").check()
    page.route(PREVIEWS, lambda route: held.append(route))
    tuning.enter("λ_q value [s]", lam_q)
    tuning.wait(lambda: len(held) > 0)
    for name, part in shown_parts.items():
        expect(part).to_have_attribute("aria-busy", "true")
        expect(figures[name]).not_to_have_css("color", colours[name])
        assert part.inner_text().startswith(before[name])
    page.route(PREVIEWS, lambda route: route.continue_())
    for route in held:
        route.continue_()
    for name, part in shown_parts.items():
        expect(part).to_have_attribute("aria-busy", "false", timeout=MOTION_TIMEOUT_MS)
        expect(figures[name]).to_have_css("color", colours[name])
    query = httpx.URL(held[-1].request.url).params
    assert float(query["lam_q"]) == lam_q
    with client_with(service, "token") as script:
        told = script.get("/api/tuning/preview", params=query).raise_for_status().json()
    push, step = told["pushed"]["without"], told["step_q"]
    time_s = push["back_s"] if trajectory else step["rise_s"]
    expect(shown_parts["loop"]).to_contain_text(re.compile(rf"{told['position']['M_s']:.2f}.*{time_s:.2f}", re.S))
    expect(shown_parts["step"]).to_contain_text(
        f"90 % after {step['rise_s']:.2f} s, within 2 % after {step['settling_s']:.2f} s"
    )
    expect(shown_parts["step"]).to_contain_text(f"tension ≥ {step['F_min_N']:.1f} N")
    expect(shown_parts["push"]).to_contain_text(f": {push['back_s']:.2f} s")
    page.unroute(PREVIEWS)
    page.get_by_role("button", name="Discard", exact=True).click()
    page.get_by_role("switch", name="Stage changes").uncheck()


WRITTEN_ANEW = """() => new Promise((resolve) => {
  const found = [];
  const watch = new MutationObserver((changes) => found.push(...changes.map(({ target }) => target.outerHTML)));
  watch.observe(document.body, { subtree: true, attributes: true, attributeFilter: ["name", "type"] });
  setTimeout(() => { watch.disconnect(); resolve(found); }, 2000);
})"""
"""React writes these of each box that it renders, changed or not."""


def test_unchanged_fields_are_not_rendered_again(tuning: Operator) -> None:
    bring_to_run(tuning.service)  # so that the references are constant
    tuning.be_in_run()
    tuning.wait_for_samples(1000)
    assert tuning.page.evaluate(WRITTEN_ANEW) == []
