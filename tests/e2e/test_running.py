"""What runs is looked at on the page that started it: in words, with the time left, live, and with a soft way out."""

import math
import re
import time
from bisect import bisect
from collections.abc import Iterator
from typing import Any

import pytest
from playwright.sync_api import Browser, expect

from tests.e2e.operator import Operator
from tests.e2e.service import Service
from tests.e2e.sharing import SharedPage, bring_to_run, shared_page


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
  words: document.querySelector("output[aria-label='What runs now']")?.innerText,
  left: document.querySelector("output[aria-label='Time left']")?.innerText,
  planned: document.querySelector("figure[aria-label='Planned profile'] [role=img]")?.getAttribute("aria-label"),
}))"""
"""The service's state and what the page says in the same moment."""


def seconds(told: str) -> float:
    """Read a duration as the page writes it."""
    number, unit = told.rsplit(" ", 1)
    parts = [float(part) for part in number.split(":")]
    return parts[0] if unit == "s" else 60 * parts[0] + parts[1]


def test_a_run_is_followed_in_words_and_aborted_softly(operator: Operator) -> None:
    page = operator.page
    bring_to_run(operator.service)
    operator.go("Experiments")
    operator.fill("Time each position reference is held [s]", 4)
    operator.fill("Time each stiffness reference is held [s]", 4)
    operator.press("Start tracking of position and stiffness")
    operator.expect_mode("experiment")
    card = page.get_by_role("region", name="Running now", exact=True)
    expect(card.get_by_role("figure", name="Joint position")).to_be_visible()
    operator.wait(lambda: page.evaluate(SHOWN)["task"]["part"] is not None)
    expect(card.get_by_role("figure", name="Planned profile")).to_be_visible()
    begun, ends = time.monotonic(), dict[int, list[float]]()
    while len(ends.get(2, [])) < 4:  # well into the second part: where one ends the page is a message behind
        assert time.monotonic() - begun < 120
        shown = page.evaluate(SHOWN)
        task = shown["task"]
        words = re.fullmatch(rf"Tracking, run {task['run']}: part (\d+) of (\d+), (.+), (.+) left", shown["words"])
        assert words, shown
        assert abs(int(words[1]) - task["part"]["number"]) <= 1  # one may just be over
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
    now = math.degrees(planned["q_ref"][bisect(planned["t"], task["part"]["t"]) - 1])
    low, high = (math.degrees(value) for value in (min(planned["q_ref"]), max(planned["q_ref"])))
    assert shown["planned"] == f"q_ref from {low:.1f} to {high:.1f} deg, now {now:.1f}".replace("-", "−")
    assert now == pytest.approx(operator.reading("Joint position", "q_ref"), abs=0.1)
    assert all(max(told) - min(told) < 0.5 for told in ends.values())  # a part ends when it was said to

    card.get_by_role("button", name="Abort softly").click()
    operator.expect_mode("off")
    expect(card).to_be_hidden()
    run = stored(operator, task["run"])
    assert (run["end_state"], run["samples"] > 3000) == ("stopped", True)


def test_an_identification_shows_its_curves_while_it_runs(operator: Operator) -> None:
    page = operator.page
    bring_to_run(operator.service)
    operator.go("Identify")
    operator.press("Start identification")
    card = page.get_by_role("region", name="Running now", exact=True)
    expect(card.get_by_role("figure", name="Motor voltage")).to_be_visible()
    expect(card.get_by_role("status", name="What runs now")).to_contain_text("identification, run")
    card.get_by_role("button", name="Abort softly").click()
    operator.wait(lambda: operator.settled_mode() in ("off", "pretension"))
    expect(card).to_be_hidden()


def stored(operator: Operator, run: int) -> dict[str, Any]:
    return dict(operator.page.evaluate(f"fetch('./api/runs/{run}').then(answer => answer.json())"))
