"""The loop of identification: cross-validation, comparison with other models and the geometry, application, undo.

The motors of the plant differ from the parameters of the controller; the identification has to correct this.
"""

import io
import re
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from playwright.sync_api import Locator, expect
from scipy.signal import lsim

from backend.experiments.library import IDENTIFICATIONS
from plant.parameters import load_parameters
from tests.e2e.forms import REPORT_TIMEOUT_MS, fill, pressed
from tests.e2e.operator import Operator
from tests.e2e.page_texts import load_texts
from tests.e2e.service import Service, running_service

TEXTS = load_texts("pages/identify")
SHARED = load_texts("components")

LAB = Path(__file__).parents[2] / "plant" / "parameters" / "lab.toml"
RUN_TIMEOUT_MS = 240_000
STEPS = {"u_low": 3.0, "levels": 3, "step_s": 1.5, "settle_s": 0.5}
OTHER_STEPS = {"u_low": 2.5, "levels": 2, "step_s": 1.5, "settle_s": 0.5}
TRUE_K_M = 2.3

Columns = Mapping[str, NDArray[np.float64]]


@pytest.fixture(scope="module")
def service(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Service]:
    folder = tmp_path_factory.mktemp("data")
    file = folder / "slower.toml"
    plant, known = LAB.read_text(encoding="utf-8").split("[identified]")
    assert plant.count("K_m = { value = 2.91") == 1
    slower = plant.replace("K_m = { value = 2.91", f"K_m = {{ value = {TRUE_K_M}")
    file.write_text(f"{slower}[identified]{known}", encoding="utf-8")
    with running_service(folder, params=str(file)) as running:
        yield running


@pytest.mark.timeout(900)  # three runs in real time; each wait has its own timeout
def test_an_identification_is_judged_applied_and_reverted(operator: Operator) -> None:
    operator.sign_in()
    operator.press("Pretension")
    expect(operator.page.get_by_role("status", name="Status", exact=True)).to_contain_text(SHARED["statusReady"])
    first = identified(operator, "motor", STEPS)
    second = identified(operator, "motor", OTHER_STEPS)
    compare_on_validation_data(operator, first, second)
    actuator = identified(operator, "actuator", {"bits": 6, "settle_s": 3.0})
    compare_with_geometry(operator, actuator)
    report_of_the_session(operator, [first, second, actuator])
    apply_and_undo(operator, first)


def report_of_the_session(operator: Operator, runs: list[int]) -> None:
    """Check the report of all three runs against the estimates of /api."""
    page = operator.page
    section = page.get_by_role("region", name=TEXTS["sessionReport"], exact=True)
    expect(section).to_contain_text(TEXTS["sessionRuns"].format(count=3))
    address = section.get_by_role("link", name="Report (HTML)").get_attribute("href")
    assert address == "./api/run-comparison/report.html?" + "&".join(f"run={run}" for run in runs)
    answer = page.request.get(f"{operator.service.url}/{address.removeprefix('./')}", timeout=REPORT_TIMEOUT_MS)
    assert answer.ok, answer.text()
    text = answer.text()
    for run in runs:
        found = get(operator, f"/api/identifications/{run}")
        for motor in found["motors"]:
            assert f"{motor['fitted']['K_m']:.3f} ±" in text
        for model in (found["G_q"], found["G_S"]):
            assert model is None or f"{model['T']:.4f} ±" in text


def identified(operator: Operator, name: str, settings: Mapping[str, float]) -> int:
    """Start an identification, wait for its result and return its run."""
    page = operator.page
    operator.go("Identify")
    page.get_by_role("radiogroup", name=TEXTS["kind"]).get_by_text(IDENTIFICATIONS[name].title).click()
    form = page.get_by_role("form", name=TEXTS["newIdentification"], exact=True)
    expect(form.locator(f"[name={next(iter(settings))}]")).to_be_visible()
    fill(form, settings)
    start = page.get_by_role("button", name=TEXTS["start"], exact=True)
    expect(start).not_to_have_attribute("aria-disabled", "true")
    run = int(pressed(page, start, "/api/identifications")[1]["id"])
    result = page.get_by_role("region", name=TEXTS["result"], exact=True)
    expect(result).to_contain_text(TEXTS["runLink"].format(run=run), timeout=RUN_TIMEOUT_MS)
    expect(result.get_by_role("table").first).to_be_visible(timeout=RUN_TIMEOUT_MS)
    return run


def choose(operator: Operator, run: int) -> None:
    """Open an identification run by its link in the list."""
    page = operator.page
    operator.go("Identify")
    link = TEXTS["runLink"].format(run=run)
    page.get_by_role("table", name=TEXTS["runs"]).get_by_role("link", name=link, exact=True).click()
    expect(page.get_by_role("region", name=TEXTS["result"], exact=True)).to_contain_text(
        TEXTS["runLink"].format(run=run)
    )


def compare_on_validation_data(operator: Operator, first: int, second: int) -> None:
    """Compare both motor models on the second record: table, /api, recording and SciPy agree."""
    page = operator.page
    choose(operator, first)
    card = page.get_by_role("region", name=TEXTS["validation"], exact=True)
    expect(card).to_contain_text(TEXTS["ownSteps"].format(run=first))
    card.get_by_role("combobox", name=TEXTS["validationData"]).select_option(TEXTS["runItem"].format(run=second))
    card.get_by_role("checkbox", name=TEXTS["compareRun"].format(run=second), exact=True).check()
    expect(card).to_contain_text(TEXTS["otherSteps"].format(run=second))
    expect(card).to_contain_text(TEXTS["ownSteps"].format(run=second))
    recorded = recording(operator, second)
    known = {run: get(operator, f"/api/identifications/{run}") for run in (first, second)}
    for side in "AB":
        title = TEXTS["comparedModels"].format(title=TEXTS["motor"].format(side=side))
        table = card.get_by_role("table", name=title, exact=True)
        told = {run: get_unverified_defaults(operator, run, second, side) for run in (first, second)}
        expect(table.get_by_role("row")).to_have_count(3)
        for run, row in zip((first, second), cells(table), strict=True):
            motor = known[run]["motors"]["AB".index(side)]
            assert row[0] == str(run)
            assert number(row[1]) == pytest.approx(motor["fitted"]["K_m"], rel=1e-3)
            assert number(row[4]) == pytest.approx(told[run]["fit_percent"], abs=0.006)
            assert number(row[5]) == pytest.approx(np.degrees(told[run]["rms"]), rel=6e-3)
            assert row[6] == motor["grade"]
        change = 100.0 * (gain(known[second], side) / gain(known[first], side) - 1.0)
        assert number(cells(table)[1][1].split()[-2]) == pytest.approx(change, abs=0.06)
        fit, rms = by_scipy(recorded, side, known[first]["motors"]["AB".index(side)], told[first])
        assert told[first]["fit_percent"] == pytest.approx(fit, abs=2e-3)
        assert told[first]["rms"] == pytest.approx(rms, rel=1e-3)


def by_scipy(recorded: Columns, side: str, motor: Mapping[str, Any], told: Mapping[str, Any]) -> tuple[float, float]:
    """Integrate the motor over each step of the recording; the drawn samples must equal the recorded ones."""
    u, theta = recorded[f"u_{side}"], recorded[f"theta_{side}"]
    open_loop = np.isnan(recorded["theta_A_ref"])
    K_m, T_m, u_c = motor["fitted"]["K_m"], motor["fitted"]["T_m"], motor["u_c"]
    error, motion = [], []
    steps = []
    for first in np.flatnonzero(np.diff(open_loop.astype(int)) == 1) + 1:  # zero volts, the step, zero, braking
        if np.any(driven := u[first : first + 500] != 0.0):
            begin = first + int(np.argmax(driven))
            steps.append(slice(begin, begin + int(np.argmax(u[begin:] != u[begin]))))
    assert len(steps) == len(told["stretches"])
    for step, drawn in zip(steps, told["stretches"], strict=True):
        t = np.arange(step.stop - step.start) * 1e-3
        voltage = u[step.start] - np.sign(u[step.start]) * u_c
        _, turn, _ = lsim(([K_m], [T_m, 1.0, 0.0]), np.full(t.size, voltage), t)
        measured = theta[step]
        at = np.round(np.array(drawn["t"]) / 1e-3).astype(int)
        assert drawn["measured"] == pytest.approx(measured[at], abs=1e-6)
        left = measured - turn
        assert drawn["predicted"] == pytest.approx((turn + np.mean(left))[at], abs=1e-5)
        error.append(left - np.mean(left))
        motion.append(measured - np.mean(measured))
    whole, moved = np.concatenate(error), np.concatenate(motion)
    fit = 100.0 * (1.0 - float(np.linalg.norm(whole)) / float(np.linalg.norm(moved)))
    return fit, float(np.sqrt(np.mean(whole**2)))


def compare_with_geometry(operator: Operator, run: int) -> None:
    """Compare the row of the run with /api and, for G_q, with the closed forms r_m/(2 r_j) and 4 λ + B_j/S."""
    page = operator.page
    (row,) = get(operator, "/api/identification-trend")["rows"]
    found = get(operator, f"/api/identifications/{run}")
    g = load_parameters("lab").geometry
    lam_motor = float(found["settings"]["lam_motor"])
    assert row["run"] == run
    assert row["S"] == found["S_nominal"]
    assert row["G_q"]["K"]["predicted"] == pytest.approx(g.r_m / (2.0 * g.r_j), rel=1e-4)
    assert row["G_q"]["T"]["predicted"] == pytest.approx(4.0 * lam_motor + g.B_j / row["S"], rel=1e-3)
    for channel in ("G_q", "G_S"):
        table = page.get_by_role("table", name=TEXTS["againstGeometry"].format(channel=channel), exact=True)
        (shown,) = cells(table)
        assert shown[0] == TEXTS["runLink"].format(run=run)
        assert number(shown[1]) == pytest.approx(row["S"], abs=0.006)
        for place, figure in ((2, "K"), (5, "T")):
            told = row[channel][figure]
            assert told["identified"] == found[channel][figure]
            assert number(shown[place]) == pytest.approx(told["identified"], rel=1e-3)
            assert number(shown[place + 1]) == pytest.approx(told["predicted"], rel=1e-3)
            off = 100.0 * (told["identified"] / told["predicted"] - 1.0)
            assert number(shown[place + 2]) == pytest.approx(off, abs=0.06)


def apply_and_undo(operator: Operator, run: int) -> None:
    """Refused in pretension; in off, the motor gains become active and the forecast improves."""
    page = operator.page
    found = get(operator, f"/api/identifications/{run}")
    recorded = recording(operator, run)
    fastest = max(float(np.max(np.abs(speed(recorded, side)))) for side in "AB")
    before = get(operator, "/api/parameters")
    foreseen = forecast(operator)
    choose(operator, run)
    section = page.get_by_role("region", name=TEXTS["applySection"], exact=True)
    table = section.get_by_role("table", name=TEXTS["proposedChanges"], exact=True)
    expect(table.get_by_role("row")).to_have_count(5)
    proposed = get(operator, f"/api/parameters?estimate={found['estimate']}")["proposal"]
    for row, change in zip(cells(table), proposed["changes"], strict=True):
        motor = found["motors"]["AB".index(change["side"])]
        assert (change["after"], change["before"]) == (motor["fitted"][change["name"]], motor["before"][change["name"]])
        assert number(row[1]) == pytest.approx(change["before"], rel=1e-4)
        assert number(row[2]) == pytest.approx(change["after"], rel=1e-4)
        assert number(row[4]) == pytest.approx(100.0 * (change["after"] / change["before"] - 1.0), abs=0.006)

    button = section.get_by_role("button", name=TEXTS["applyParameters"], exact=True)
    expect(button).to_have_attribute("aria-disabled", "true")
    refusal = section.get_by_role("status", name="Refusal")
    expect(refusal).to_contain_text(TEXTS["changeOff"].format(mode="Pretension"))

    operator.go("Operate")
    operator.press("Off")
    operator.expect_mode("off")
    choose(operator, run)
    expect(button).to_have_attribute("aria-disabled", "false")
    sent, _ = pressed(page, button, "/api/parameters")
    assert sent == {"estimate": found["estimate"]}
    card = page.get_by_role("region", name=TEXTS["activeParameters"], exact=True)
    expect(card).to_contain_text(TEXTS["version"].format(version=1))
    after = get(operator, "/api/parameters")
    newest = after["versions"][0]
    assert (newest["number"], newest["run"], newest["undone"]) == (1, run, False)
    assert newest["digest"] == proposed["digest"] != before["versions"][0]["digest"]
    assert newest["changes"] == proposed["changes"]
    expect(section).to_contain_text("nothing would change")
    version = cells(card.get_by_role("table", name=TEXTS["versions"], exact=True))[0]
    assert version[0] == "1"
    assert version[2] == newest["who"]
    assert version[3] == TEXTS["runLink"].format(run=run)
    now = forecast(operator)
    assert abs(now - fastest) < 0.25 * abs(foreseen - fastest)

    pressed(page, card.get_by_role("button", name=TEXTS["undo"].format(version=1), exact=True), "/api/parameters/undo")
    expect(card).to_contain_text(TEXTS["version"].format(version=2))
    undone = get(operator, "/api/parameters")["versions"]
    assert [one["number"] for one in undone] == [2, 1, 0]
    assert undone[0]["digest"] == before["versions"][0]["digest"]
    assert undone[0]["undone"]
    assert forecast(operator) == foreseen


def speed(recorded: Columns, side: str) -> NDArray[np.float64]:
    """Return the speed of a motor [rad/s] over 20 ms while a voltage drove it."""
    theta, driven = recorded[f"theta_{side}"], np.isnan(recorded["theta_A_ref"])
    rate = (theta[20:] - theta[:-20]) / 0.02
    return np.asarray(rate[driven[20:] & driven[:-20]])


def forecast(operator: Operator) -> float:
    """Return the forecast maximum speed [rad/s] of the same identification."""
    body = {"kind": "motor", **STEPS}
    answer = operator.page.request.post(f"{operator.service.url}/api/identifications/prediction", data=body)
    assert answer.ok, answer.text()
    return float(next(one["value"] for one in answer.json()["figures"] if one["name"] == "omega_max"))


def get_unverified_defaults(operator: Operator, run: int, of: int, name: str) -> Any:
    view = get(operator, f"/api/identifications/{run}/unseen?of={of}")
    assert (view["run"], view["of"], view["own"]) == (run, of, run == of)
    return next(output for output in view["outputs"] if output["name"] == name)


def gain(identification: Mapping[str, Any], side: str) -> float:
    return float(identification["motors"]["AB".index(side)]["fitted"]["K_m"])


def recording(operator: Operator, run: int) -> Columns:
    """Return all samples of a run from its data file."""
    answer = operator.page.request.get(f"{operator.service.url}/api/runs/{run}/data.csv", timeout=REPORT_TIMEOUT_MS)
    assert answer.ok, answer.text()
    lines = [line for line in answer.text().splitlines() if not line.startswith("#")]
    names = lines[0].split(",")
    values = np.genfromtxt(io.StringIO("\n".join(lines[1:])), delimiter=",")
    return dict(zip(names, values.T, strict=True))


def cells(table: Locator) -> list[list[str]]:
    return list(table.evaluate("table => [...table.tBodies[0].rows].map(row => [...row.cells].map(c => c.innerText))"))


def number(text: str) -> float:
    found = re.match(r"[+-]?[\d.]+(e[+-]?\d+)?", text.replace("\u2212", "-"))
    assert found is not None, text
    return float(found.group())


def get(operator: Operator, path: str) -> Any:
    answer = operator.page.request.get(f"{operator.service.url}{path}", timeout=REPORT_TIMEOUT_MS)
    assert answer.ok, answer.text()
    return answer.json()
