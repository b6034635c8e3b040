"""A complete session in real time: sign-in, motion, tuning, identification, bank, tracking, report, STOP."""

import io

import pytest
from playwright.sync_api import expect
from pypdf import PdfReader

from tests.e2e.forms import pressed
from tests.e2e.operator import MOTION_TIMEOUT_MS, Operator
from tests.e2e.page_texts import load_texts
from tests.e2e.service import Service

IDENTIFY_TEXTS = load_texts("pages/identify")
BANKS = load_texts("pages/banks")
OPERATE = load_texts("pages/operate")
SHARED = load_texts("components")

IDENTIFICATION_TIMEOUT_MS = 90_000
TRACKING_TIMEOUT_MS = 150_000


@pytest.fixture(scope="module")
def service(fresh_service: Service) -> Service:
    return fresh_service


def test_an_operator_signs_in_tunes_identifies_tracks_and_stops(operator: Operator) -> None:
    page = operator.page
    operator.sign_in()
    assert "token" not in page.url
    expect(page.get_by_role("img", name="Simulator", exact=True)).to_be_visible()
    operator.expect_mode("off")

    operator.bring_up()
    see_curves_move(operator)
    step_the_joint(operator)
    move_lambda(operator)
    run = identify(operator)
    build_and_activate_a_bank(operator, run)
    track(operator)
    check_the_report(operator)
    press_stop(operator)


def see_curves_move(operator: Operator) -> None:
    """Check that the charts scroll: the picture changes with time."""
    before = operator.picture("Joint position")
    for figure in ("Joint stiffness", "Tendon force", "Motor voltage"):
        expect(operator.page.get_by_role("figure", name=figure, exact=True).locator("canvas").first).to_be_visible()
    operator.wait(lambda: operator.picture("Joint position") != before)
    assert operator.reading("Tendon force", "F_A") > 4.0
    assert operator.reading("Tendon force", "F_B") > 4.0


def step_the_joint(operator: Operator) -> None:
    operator.enter("q_ref value [°]", 20.0)
    operator.wait(lambda: operator.reading("Joint position", "q") == pytest.approx(20.0, abs=0.2))
    assert operator.reading("Joint position", "q_ref") == pytest.approx(20.0, abs=0.01)


def move_lambda(operator: Operator) -> None:
    page = operator.page
    with page.expect_response(lambda answer: answer.request.method == "PUT" and answer.url.endswith("/api/tuning")):
        operator.enter("λ_q value [s]", 0.45)
    expect(page.get_by_role("group", name=OPERATE["preview"].format(symbol="λ_q"), exact=True)).to_contain_text(
        OPERATE["sensitivityPeak"]
    )
    page.reload()
    box = page.get_by_role("textbox", name="λ_q value [s]", exact=True)
    expect(box).to_have_value("0.450", timeout=MOTION_TIMEOUT_MS)
    operator.wait(lambda: operator.reading("Joint position", "q") == pytest.approx(20.0, abs=0.2))


def identify(operator: Operator) -> str:
    """Run a short identification at 20 N and return the name of its run."""
    page = operator.page
    operator.go("Identify")
    operator.fill(IDENTIFY_TEXTS["bits"], 6)
    prediction = page.get_by_role("status", name=IDENTIFY_TEXTS["forecastStatus"], exact=True)
    expect(prediction).to_contain_text("encoder counts", timeout=MOTION_TIMEOUT_MS)
    operator.press(IDENTIFY_TEXTS["start"])
    # the status line of every page has one, and so has the card of the running identification
    expect(page.get_by_role("progressbar", name=SHARED["taskProgress"], exact=True)).to_have_count(
        2, timeout=MOTION_TIMEOUT_MS
    )
    result = page.get_by_role("region", name="Result", exact=True)
    expect(result).to_contain_text("Gq", timeout=IDENTIFICATION_TIMEOUT_MS)
    expect(result).to_contain_text("GS")
    link = page.get_by_role("table", name=IDENTIFY_TEXTS["runs"], exact=True).get_by_role("link").first
    return link.inner_text()


def build_and_activate_a_bank(operator: Operator, run: str) -> None:
    page = operator.page
    page.get_by_role("checkbox", name=IDENTIFY_TEXTS["useRun"].format(run=run.split()[-1]), exact=True).check()
    page.get_by_role("textbox", name=IDENTIFY_TEXTS["bankName"], exact=True).fill("bench")
    expect(page.get_by_role("button", name=IDENTIFY_TEXTS["buildBank"], exact=True)).to_be_in_viewport(ratio=1)
    sent, built = pressed(page, page.get_by_role("button", name=IDENTIFY_TEXTS["buildBank"], exact=True), "/api/banks")
    number = int(run.split()[-1])
    assert sent == {"name": "bench", "identifications": [number]}
    found = page.request.get(f"{operator.service.url}/api/identifications/{number}").json()
    (entry,) = built["entries"]
    assert (built["name"], entry["identification"], entry["tension_N"]) == ("bench", number, 20.0)
    for channel in ("q", "S"):
        model = found[f"G_{channel}"]
        assert (entry[f"K_{channel}"], entry[f"T_{channel}"]) == (model["K"], model["T"])
    expect(page.get_by_role("link", name="bench v1", exact=True)).to_be_visible()
    operator.press(IDENTIFY_TEXTS["activateBank"].format(bank="bench v1"))
    expect(page.get_by_role("region", name=IDENTIFY_TEXTS["bankFromRuns"], exact=True)).to_contain_text(
        IDENTIFY_TEXTS["bankActive"]
    )
    operator.go("Banks")
    row = page.get_by_role("table", name=BANKS["table"], exact=True).get_by_role("row").filter(has_text="bench v1")
    expect(row).to_contain_text(BANKS["activeBank"])
    entries = page.get_by_role("table", name=BANKS["operatingPoints"], exact=True)
    expect(entries.get_by_role("link", name=BANKS["identification"].split(" {")[0])).to_have_count(1)


def track(operator: Operator) -> None:
    """Run tracking with shorter holds than in the paper; every criterion is met."""
    page = operator.page
    operator.go("Experiments")
    operator.fill("Hold time of each position reference [s]", 4)
    operator.fill("Hold time of each stiffness reference [s]", 4)
    operator.press("Start tracking of position and stiffness")
    operator.expect_mode("experiment")
    criteria = page.get_by_role("table", name="Criteria", exact=True)
    expect(criteria).to_be_visible(timeout=TRACKING_TIMEOUT_MS)
    expect(criteria).to_contain_text("pass")
    expect(criteria).not_to_contain_text("fail")
    expect(criteria).not_to_contain_text("not measured")


def check_the_report(operator: Operator) -> None:
    content = operator.download("Report (PDF)").read_bytes()
    assert content.startswith(b"%PDF-")
    reader = PdfReader(io.BytesIO(content))
    assert len(reader.pages) >= 2
    text = "\n".join(page.extract_text() for page in reader.pages)
    for expected in ("Tracking", "lab", "bench", "Overshoot"):
        assert expected.lower() in text.lower(), f"the report does not mention {expected}"
    lines = operator.download("Data (CSV)").read_text(encoding="utf-8").splitlines()
    header = next(line for line in lines if not line.startswith("#"))
    assert header.startswith("t,q,q_ref,S,S_ref,theta_A,theta_B,F_A,F_B,u_A,u_B")


def press_stop(operator: Operator) -> None:
    """Check that STOP states the tick with zero outputs, and is latched until Reset."""
    page = operator.page
    operator.bring_up()
    page.get_by_role("button", name="STOP", exact=True).click()
    expect(page.get_by_role("status", name="Stop result", exact=True)).to_contain_text("Zero volts in")
    operator.expect_mode("tripped")
    expect(page.get_by_role("alert", name="Fault", exact=True)).to_contain_text("STOP was pressed")
    operator.wait(lambda: operator.reading("Motor voltage", "u_A") == 0.0)
    assert operator.reading("Motor voltage", "u_B") == 0.0
    page.reload()
    operator.expect_mode("tripped")
    operator.press("Reset")
    operator.expect_mode("off")
