"""The flight record of a trip, from the banner to charts and 3D view: the page shows the stored samples."""

import csv
import math
import re

import pytest
from playwright.sync_api import expect

from tests.api.conftest import client_with
from tests.e2e.operator import Operator
from tests.e2e.page_texts import load_texts
from tests.e2e.sharing import bring_to_run, sign_in_at

RUNS = load_texts("pages/runs")

DEG = 180.0 / math.pi


def test_the_banner_of_a_trip_opens_its_flight_record_in_charts_and_3d(operator: Operator) -> None:
    page, service = operator.page, operator.service
    bring_to_run(service, 15.0 / DEG)
    sign_in_at(page, service, "studies")  # every page shows the banner
    operator.wait_for_samples(6000)  # the record of an earlier trip covers the 5 s after it
    page.get_by_role("button", name=re.compile("^STOP")).click()
    operator.expect_mode("tripped")
    page.get_by_role("link", name="Flight record", exact=True).click()  # written after its interval
    expect(page.get_by_role("heading", level=1)).to_contain_text(RUNS["flightRecord"].split(" {")[0])

    state = page.evaluate("fetch('./api/state').then(answer => answer.json())")
    flights = page.evaluate("fetch('./api/flights').then(answer => answer.json())")["flights"]
    [flight] = [one for one in flights if one["tick"] == state["fault"]["tick"]]
    assert page.url.endswith(f"/#/flights/{flight['id']}")
    facts = page.get_by_role("region", name=RUNS["trip"], exact=True)
    expect(facts).to_contain_text(f"tick {flight['tick']}")
    expect(facts).to_contain_text(f"{flight['before_s']:.3f} s before to {flight['after_s']:.3f} s after")

    with client_with(service, "token") as script:
        text = script.get(f"/api/flights/{flight['id']}/data.csv").raise_for_status().text
    samples = list(csv.DictReader(line for line in text.splitlines() if not line.startswith("#")))
    at_trip = min(samples, key=lambda row: abs(float(row["t"])))
    assert float(at_trip["t"]) == 0.0
    assert float(at_trip["q"]) * DEG > 10.0  # the joint was at this angle only in this interval
    assert len(samples) == round((flight["before_s"] + flight["after_s"]) * 1e3)

    replay = page.get_by_role("region", name=RUNS["replay"], exact=True)
    expect(replay.get_by_role("status", name=RUNS["replayTime"], exact=True)).to_have_text("0:00.00")
    operator.wait(lambda: not math.isnan(operator.reading("Joint position", "q")))
    assert operator.reading("Joint position", "q") == pytest.approx(float(at_trip["q"]) * DEG, abs=0.006)
    assert operator.reading("Tendon force", "F_A") == pytest.approx(float(at_trip["F_A"]), abs=0.006)
    position = replay.get_by_role("slider", name=RUNS["replayPosition"], exact=True)
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
        replay.get_by_role("button", name=RUNS["showIn3D"], exact=True).click()
    assert answered.value.status == 204
    assert answered.value.request.post_data_json == {"t": pytest.approx(float(first["t"]))}
    replay.get_by_role("button", name=RUNS["showFlat"], exact=True).click()

    page.goto(f"{service.url}/#/log")
    page.get_by_role("link", name=load_texts("pages/log")["chartsOfTrip"]).first.click()
    expect(page.get_by_role("region", name=RUNS["trip"], exact=True)).to_contain_text(f"tick {flight['tick']}")
