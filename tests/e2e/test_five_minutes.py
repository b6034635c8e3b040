"""The example of the README with the mouse: λ_q dragged from 0.5 to 1.0 s doubles the duration of a recorded step."""

import math
import re
from functools import partial

import httpx
import numpy as np
import pytest
from playwright.sync_api import expect

from tests.api.conftest import client_with
from tests.e2e.operator import Operator
from tests.e2e.page_texts import load_texts
from tests.e2e.service import Service

OPERATE = load_texts("pages/operate")

REACHED = 0.9
STEP_DEG = 30.0
WAIT_S = 4.0
"""Added once the joint is within 0.3° of its reference, so that each step begins at rest."""


@pytest.fixture(scope="module")
def service(fresh_service: Service) -> Service:
    return fresh_service


@pytest.mark.timeout(300)
def test_doubling_lambda_doubles_the_duration_of_a_step(operator: Operator) -> None:
    operator.sign_in()
    operator.page.get_by_role("button", name="Skip tour", exact=True).click()
    operator.bring_up()
    operator.enter("S_ref value [N·m/rad]", 12)
    operator.enter("λ_q value [s]", 0.5)
    operator.wait(lambda: operator.state()["tuning"]["lam_q"] == 0.5)
    rest(operator)
    steps = []
    for lam in (0.5, 1.0):
        drag_lambda(operator, lam)
        in_force = operator.state()["tuning"]["lam_q"]
        assert in_force == pytest.approx(lam, rel=0.03)
        previewed = previewed_t90(operator)
        for target in (STEP_DEG, 0.0):
            operator.enter("q_ref value [°]", target)
            operator.wait(partial(is_at, operator, target))
            rest(operator)
        steps.append((in_force, previewed))
    operator.press("STOP")
    operator.wait(lambda: operator.state()["recording_run"] is None)
    measured = recorded_t90(operator.service)
    fast, slow = steps
    for at_half, at_one in zip(measured[:2], measured[2:], strict=True):
        assert at_one / at_half == pytest.approx(slow[0] / fast[0], rel=0.1)
    for (_, previewed), reached in zip((fast, fast, slow, slow), measured, strict=True):
        assert reached == pytest.approx(previewed, rel=0.1)


def is_at(operator: Operator, angle_deg: float) -> bool:
    return abs(operator.reading("Joint position", "q") - angle_deg) < 0.3


def rest(operator: Operator) -> None:
    operator.page.wait_for_timeout(WAIT_S * 1000)


def drag_lambda(operator: Operator, lam: float) -> None:
    """Drag the thumb of λ_q with the mouse until its text shows the value."""
    page, thumb = operator.page, operator.page.get_by_role("slider", name="λ_q", exact=True)
    thumb.scroll_into_view_if_needed()
    box = thumb.bounding_box()
    assert box is not None
    x, y = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2
    page.mouse.move(x, y)
    page.mouse.down()
    shown = value_of(operator)
    while abs(shown - lam) > 0.02 * lam:
        x += math.copysign(1.0, lam - shown)
        page.mouse.move(x, y)
        shown = value_of(operator)
    page.mouse.up()
    operator.wait(lambda: math.isclose(operator.state()["tuning"]["lam_q"], value_of(operator), abs_tol=6e-4))


def value_of(operator: Operator) -> float:
    text = operator.page.get_by_role("slider", name="λ_q", exact=True).get_attribute("aria-valuetext")
    assert text is not None
    return float(text.removesuffix(" s"))


def previewed_t90(operator: Operator) -> float:
    """Return the rise time to 90 % on the card of λ_q [s]."""
    preview = operator.page.get_by_role("group", name=OPERATE["preview"].format(symbol="λ_q"))
    expect(preview).to_have_attribute("aria-busy", "false")
    term = preview.locator("div", has_text=OPERATE["timeTo90"]).last
    figure = re.search(r"(\d+\.\d+)\s*s", term.inner_text())
    assert figure is not None, term.inner_text()
    return float(figure[1])


def recorded_t90(service: Service) -> list[float]:
    """Return the times from each change of q_ref to 90 % of its step in the recording [s]."""
    with client_with(service, "token") as script:
        (run,) = script.get("/api/runs").raise_for_status().json()["runs"]
        text = samples_of(script, run["id"])
    names = text.splitlines()[0].split(",")
    data = np.loadtxt(text.splitlines()[1:], delimiter=",", usecols=[names.index(n) for n in ("t", "q_ref", "q")])
    t, q_ref, q = data.T
    changes = [int(at) for at in np.flatnonzero(np.diff(q_ref)) + 1]
    reached = []
    for begin, end in zip(changes, [*changes[1:], len(t)], strict=True):
        start, size = q_ref[begin - 1], q_ref[begin] - q_ref[begin - 1]
        within = np.flatnonzero((q[begin:end] - start) / size >= REACHED)
        reached.append(float(t[begin + within[0]] - t[begin - 1]))
    return reached


def samples_of(script: httpx.Client, run: int) -> str:
    """Return the exported samples of a run without the header comments."""
    text = script.get(f"/api/runs/{run}/data.csv", timeout=60.0).raise_for_status().text
    return "\n".join(line for line in text.splitlines() if not line.startswith("#"))
