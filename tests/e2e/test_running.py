"""The page that started a run shows its progress: description, remaining time, live values, soft abort."""

import math
import re
import time
from bisect import bisect
from collections.abc import Callable, Iterator
from typing import Any

import pytest
from playwright.sync_api import Browser, ViewportSize, expect

from tests.e2e.layout import document_scrolls_by
from tests.e2e.operator import MOTION_TIMEOUT_MS, Operator
from tests.e2e.page_texts import load_texts
from tests.e2e.service import Service
from tests.e2e.sharing import SharedPage, bring_to_run, shared_page

IDENTIFY_TEXTS = load_texts("pages/identify")
OPERATE = load_texts("pages/operate")

PHONE = ViewportSize(width=390, height=844)


@pytest.fixture(scope="module")
def shared(browser: Browser, service: Service) -> Iterator[SharedPage]:
    with shared_page(browser, service, "experiments") as shared:
        yield shared


@pytest.fixture
def operator(shared: SharedPage, request: pytest.FixtureRequest) -> Iterator[Operator]:
    with shared.turn_of(request) as operator:
        yield operator


SHOWN = """() => fetch('./api/state').then(answer => answer.json()).then(state => ({
  task: state.task,
  words: document.querySelector("output[aria-label='CURRENT_RUN']")?.innerText,
  left: document.querySelector("output[aria-label='TIME_LEFT']")?.innerText,
  planned: document.querySelector("figure[aria-label='Planned profile'] [role=img]")?.getAttribute("aria-label"),
}))""".replace("CURRENT_RUN", OPERATE["currentRun"]).replace("TIME_LEFT", OPERATE["timeLeft"])
"""The service's state and what the page says in the same moment."""


def seconds(told: str) -> float:
    """Return a displayed duration in seconds."""
    number, unit = told.rsplit(" ", 1)
    parts = [float(part) for part in number.split(":")]
    return parts[0] if unit == "s" else 60 * parts[0] + parts[1]


def test_the_progress_of_a_run_is_shown_and_the_run_is_aborted_softly(operator: Operator) -> None:
    page = operator.page
    bring_to_run(operator.service)
    operator.go("Experiments")
    operator.fill("Hold time of each position reference [s]", 4)
    operator.fill("Hold time of each stiffness reference [s]", 4)
    operator.press("Start tracking of position and stiffness")
    operator.expect_mode("experiment")
    card = page.get_by_role("region", name=OPERATE["running"], exact=True)
    expect(card.get_by_role("figure", name="Joint position")).to_be_visible()
    operator.wait(lambda: page.evaluate(SHOWN)["task"]["part"] is not None)
    expect(card.get_by_role("figure", name="Planned profile")).to_be_visible()
    begun, ends = time.monotonic(), dict[int, list[float]]()
    while len(ends.get(2, [])) < 4:  # well into the second part: at the end of a part the page is one message late
        assert time.monotonic() - begun < 120
        shown = page.evaluate(SHOWN)
        task = shown["task"]
        words = re.fullmatch(rf"Tracking, run {task['run']}: part (\d+) of (\d+), (.+), (.+) left", shown["words"])
        assert words, shown
        assert abs(int(words[1]) - task["part"]["number"]) <= 1  # a part may just have ended
        assert int(words[2]) == task["part"]["of"]
        if int(words[1]) == task["part"]["number"]:
            assert words[3] == task["part"]["title"]
            assert seconds(words[4]) == pytest.approx(task["part"]["left_s"], abs=2.0)
        told = re.fullmatch(r"(.+) left of (.+)", shown["left"])
        assert told, shown
        assert seconds(told[1]) == pytest.approx(task["duration_s"] - task["elapsed_s"], abs=2.0)
        assert seconds(told[2]) == pytest.approx(task["duration_s"], abs=1.0)
        ends.setdefault(task["part"]["number"], []).append(task["elapsed_s"] + task["part"]["left_s"])
        page.wait_for_timeout(300)
    planned = page.evaluate(f"fetch('./api/runs/{task['run']}/planned').then(answer => answer.json())")
    assert [line["name"] for line in planned["lines"]] == ["q_ref", "S_ref"]
    q_ref = planned["lines"][0]["values"]
    now = math.degrees(q_ref[bisect(planned["t"], task["part"]["t"]) - 1])
    low, high = (math.degrees(value) for value in (min(q_ref), max(q_ref)))
    assert shown["planned"] == f"q_ref from {low:.1f} to {high:.1f}°, now {now:.1f}°".replace("-", "−")
    assert now == pytest.approx(operator.reading("Joint position", "q_ref"), abs=0.1)
    assert all(max(told) - min(told) < 0.5 for told in ends.values())  # the part ends at the stated time

    card.get_by_role("button", name=OPERATE["softAbort"]).click()
    operator.expect_mode("off")
    expect(card).to_be_hidden()
    run = stored(operator, task["run"])
    assert (run["end_state"], run["samples"] > 3000) == ("stopped", True)


def test_an_identification_shows_progress_pauses_between_tensions_and_aborts_softly(operator: Operator) -> None:
    page = operator.page
    bring_to_run(operator.service)
    operator.go("Identify")
    page.get_by_role("textbox", name=IDENTIFY_TEXTS["tensionList"]).fill("12, 20")
    operator.fill(IDENTIFY_TEXTS["bits"], 6)
    operator.fill(f"{IDENTIFY_TEXTS['settle_s']} [s]", 3)
    operator.press(IDENTIFY_TEXTS["start"])
    card = page.get_by_role("region", name=OPERATE["running"], exact=True)
    expect(card.get_by_role("figure", name="Motor voltage")).to_be_visible()
    card.get_by_role("button", name=OPERATE["pauseAfter"], exact=True).click()
    go_on = card.get_by_role("button", name=OPERATE["resume"], exact=True)
    expect(go_on).to_be_visible(timeout=MOTION_TIMEOUT_MS)
    expect(card.get_by_role("figure", name="Planned profile")).to_be_visible(timeout=MOTION_TIMEOUT_MS)
    seen = observed_progress(operator, until=lambda shown: shown["task"]["part"]["doing"] == "exciting")
    first = seen[0]["task"]["run"]
    expect(go_on).to_be_visible()
    expect(card.get_by_role("status", name=OPERATE["currentRun"])).to_have_text(
        f"Actuator identification, run {first}, 1 of 2: paused", timeout=MOTION_TIMEOUT_MS
    )
    operator.wait(lambda: bool(operator.state()["pretension_done"]))
    assert operator.state()["task"]["run"] == first  # nothing has started in the meantime
    took_s = stored(operator, first)["samples"] / 1000.0
    for shown in seen:  # the displayed remaining time, compared with the recording
        left_s = seconds(shown["left"].split(" left")[0])
        assert left_s == pytest.approx(took_s - shown["task"]["part"]["t"], abs=max(1.0, 0.05 * took_s))

    go_on.click()
    operator.wait(lambda: page.evaluate(SHOWN)["task"]["number"] == 2)
    seen = observed_progress(operator, until=lambda shown: shown["task"]["part"]["doing"] == "exciting")
    task = seen[-1]["task"]
    assert task["run"] == first + 1
    assert card.get_by_role("button", name=OPERATE["pauseAfter"], exact=True).count() == 0
    planned = page.evaluate(f"fetch('./api/runs/{task['run']}/planned').then(answer => answer.json())")
    assert [line["name"] for line in planned["lines"]] == ["theta_A_ref", "theta_B_ref"]
    card.get_by_role("button", name=OPERATE["softAbort"]).click()
    operator.expect_mode("off")
    expect(card).to_be_hidden()
    run = stored(operator, task["run"])
    assert (run["end_state"], run["samples"] > 1000 * task["part"]["t"]) == ("stopped", True)
    assert stored(operator, first)["end_state"] == "completed"
    # the planned profile, compared with the recording: the force loop adjusts the voltages
    recorded = operator.page.evaluate(
        f"fetch('./api/runs/{task['run']}/samples?signals=theta_B_ref').then(answer => answer.json())"
    )
    values, t = recorded["signals"]["theta_B_ref"]["maximum"], recorded["t"]
    asked = planned["lines"][1]["values"]
    for place in range(0, len(t), max(1, len(t) // 50)):
        if t[place] < task["part"]["t"]:
            at = asked[max(0, bisect(planned["t"], t[place]) - 1)]
            assert values[place] == pytest.approx(at, abs=0.2)


def test_a_phone_shows_the_planned_voltages_of_a_motor_identification(operator: Operator) -> None:
    page = operator.page
    bring_to_run(operator.service)
    size = page.viewport_size
    page.set_viewport_size(PHONE)
    operator.go("Identify")
    page.get_by_text("Motors", exact=True).click()
    operator.fill(f"{IDENTIFY_TEXTS['u_low']} [V]", 3)
    operator.fill(f"{IDENTIFY_TEXTS['u_high']} [V]", 6)
    operator.fill(IDENTIFY_TEXTS["levels"], 2)
    operator.press(IDENTIFY_TEXTS["start"])
    card = page.get_by_role("region", name=OPERATE["running"], exact=True)
    expect(card).to_be_visible()
    seen = observed_progress(operator, until=lambda shown: shown["task"]["part"]["number"] == 2)
    assert {shown["task"]["part"]["of"] for shown in seen} == {4}
    assert seen[-1]["planned"].startswith("u_A from −6.0 to 6.0 V, now ")
    page.get_by_role("main").evaluate("main => main.scrollTo(0, 0)")
    for what in (
        card.get_by_role("status", name=OPERATE["currentRun"]),
        card.get_by_role("button", name=OPERATE["softAbort"]),
    ):
        expect(what).to_be_in_viewport(ratio=1.0)
    expect(page.get_by_role("button", name=re.compile("^STOP"))).to_be_in_viewport()
    assert document_scrolls_by(page) == 0
    assert page.get_by_role("main").evaluate("main => main.scrollWidth <= main.clientWidth")
    card.get_by_role("button", name=OPERATE["softAbort"]).click()
    operator.expect_mode("off")
    expect(card).to_be_hidden()
    assert size is not None
    page.set_viewport_size(size)


def observed_progress(operator: Operator, until: Callable[[dict[str, Any]], bool]) -> list[dict[str, Any]]:
    """Read the card of an identification a few times per second, with the state of the same moment."""
    seen: list[dict[str, Any]] = []
    begun = time.monotonic()
    agreed = 0
    while agreed < 4 or not until(seen[-1]):
        assert time.monotonic() - begun < 120
        shown = operator.page.evaluate(SHOWN)
        task = shown["task"]
        if task is not None and task["part"] is not None and shown["words"] is not None:
            words = re.fullmatch(
                rf".+ identification, run {task['run']}: (\d+) of (\d+): (.+), (.+), (.+) left", shown["words"]
            )
            part = task["part"]
            if words and (int(words[1]), words[4]) == (part["number"], part["doing"]):
                agreed += 1
                assert (int(words[2]), words[3]) == (part["of"], part["title"])
                assert seconds(words[5]) == pytest.approx(part["left_s"], abs=2.0)
                told = re.fullmatch(r"(.+) left of (.+?)(, then 1 more run)?", shown["left"])
                assert told, shown
                assert bool(told[3]) == (task["following"] == 1)
                assert seconds(told[1]) == pytest.approx(task["duration_s"] - task["elapsed_s"], abs=2.0)
                seen.append(shown)
        operator.page.wait_for_timeout(300)
    return seen


def stored(operator: Operator, run: int) -> dict[str, Any]:
    return dict(operator.page.evaluate(f"fetch('./api/runs/{run}').then(answer => answer.json())"))
