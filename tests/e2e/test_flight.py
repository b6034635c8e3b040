"""The flight record of a trip, from the banner that tells of it into charts and 3D: what is shown is what was kept."""

import csv
import math
import re

import httpx
import pytest
from playwright.sync_api import expect

from tests.e2e.operator import Operator
from tests.e2e.service import Service


@pytest.fixture(scope="module")
def service(fresh_service: Service) -> Service:
    return fresh_service


def test_the_banner_of_a_trip_leads_to_its_tick_in_charts_and_3d(operator: Operator) -> None:
    page = operator.page
    operator.sign_in()
    operator.be_in_run()
    operator.enter("q_ref value [deg]", 15.0)
    operator.wait(lambda: abs(operator.reading("Joint position", "q") - 15.0) < 0.3)
    page.get_by_role("button", name=re.compile("^STOP")).click()
    operator.expect_mode("tripped")
    page.get_by_role("link", name="Flight record", exact=True).click()  # there once its seconds are over
    expect(page.get_by_role("heading", level=1)).to_contain_text("Flight record")

    state = page.evaluate("fetch('./api/state').then(answer => answer.json())")
    [flight] = page.evaluate("fetch('./api/flights').then(answer => answer.json())")["flights"]
    assert flight["tick"] == state["fault"]["tick"]
    assert page.url.endswith(f"/#/flights/{flight['id']}")
    facts = page.get_by_role("region", name="Trip", exact=True)
    expect(facts).to_contain_text(f"tick {flight['tick']}")
    expect(facts).to_contain_text(f"{flight['before_s']:.3f} s before to {flight['after_s']:.3f} s after")

    cookies = {cookie["name"]: cookie["value"] for cookie in page.context.cookies()}
    address = f"{operator.service.url}/api/flights/{flight['id']}/data.csv"
    text = httpx.get(address, cookies=cookies, timeout=60.0).raise_for_status().text
    samples = list(csv.DictReader(line for line in text.splitlines() if not line.startswith("#")))
    at_trip = min(samples, key=lambda row: abs(float(row["t"])))
    assert float(at_trip["t"]) == 0.0
    assert len(samples) == round((flight["before_s"] + flight["after_s"]) * 1e3)

    replay = page.get_by_role("region", name="Replay", exact=True)
    expect(replay.get_by_role("status", name="Replay time", exact=True)).to_have_text("0:00.00")
    operator.wait(lambda: not math.isnan(operator.reading("Joint position", "q")))
    deg = 180.0 / math.pi
    assert operator.reading("Joint position", "q") == pytest.approx(float(at_trip["q"]) * deg, abs=0.006)
    assert operator.reading("Tendon force", "F_A") == pytest.approx(float(at_trip["F_A"]), abs=0.006)
    position = replay.get_by_role("slider", name="Replay position", exact=True)
    position.press("Home")
    first = samples[0]
    operator.wait(lambda: abs(operator.reading("Tendon force", "F_A") - float(first["F_A"])) < 0.006)

    def shown() -> bool:
        found = page.evaluate(
            "([id, t]) => fetch(`./api/flights/${id}/replay`, {method: 'POST', body: JSON.stringify({t}),"
            " headers: {'content-type': 'application/json'}}).then(answer => answer.status)",
            [flight["id"], 0.0],
        )
        return bool(found == 204)

    assert shown()
    with page.expect_response(re.compile(rf"/api/flights/{flight['id']}/replay$")) as answered:
        replay.get_by_role("button", name="Show in 3D", exact=True).click()
    assert answered.value.status == 204
    assert answered.value.request.post_data_json == {"t": pytest.approx(float(first["t"]))}
    replay.get_by_role("button", name="Show flat", exact=True).click()

    page.goto(f"{operator.service.url}/#/log")
    page.get_by_role("link", name="charts of the trip").first.click()
    expect(page.get_by_role("region", name="Trip", exact=True)).to_contain_text(f"tick {flight['tick']}")
