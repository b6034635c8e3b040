"""Homing on the page, on a virtual card whose wiring file defines the end switch."""

from collections.abc import Iterator
from contextlib import closing
from pathlib import Path

import pytest
from playwright.sync_api import expect

import plant
from backend.commissioning.procedure import StepFinding
from backend.commissioning.status import store_result
from backend.commissioning.steps import StepId
from backend.storage.database import open_database
from plant.calibration import CellCalibration
from plant.wiring import load_wiring
from tests.e2e.operator import Operator
from tests.e2e.page_texts import load_texts
from tests.e2e.service import Service, running_service
from tests.e2e.test_bring_up import figures, play, told

TEXTS = load_texts("pages/bringUp")

POSITION_RAD = 0.12
"""Near: the joint goes there at 0.15 rad/s."""


@pytest.fixture(scope="module")
def service(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Service]:
    """A rig whose commissioning has reached the step of homing."""
    folder = tmp_path_factory.mktemp("data")
    said = (Path(plant.__file__).parent / "wirings" / "pcie-6323.toml").read_text(encoding="utf-8")
    section = "[end_switch]\n"
    assert said.count(section) == 1
    position = f'position = {{ value = {POSITION_RAD}, unit = "rad", source = "measured" }}\n'
    file = folder / "rig.toml"
    file.write_text(said.replace(section, section + position), encoding="utf-8")
    wiring = load_wiring(str(file))
    cells = tuple(CellCalibration(tendon, 10.0, 0.0, "calibrated") for tendon in "AB")
    with closing(open_database(folder)) as database:
        for step in (StepId.WIRING_TEST, StepId.TARE, StepId.CALIBRATE, StepId.DIRECTION):
            store_result(database, step, wiring, StepFinding(True, "well", (), cells), "Ada")
    with running_service(folder, plant=("rig", "--virtual-card", "--wiring", str(file))) as running:
        yield running


def test_the_motors_find_the_zero_at_the_end_switch(operator: Operator, service: Service) -> None:
    page = operator.page
    operator.sign_in()
    operator.go("Bring-up")
    expect(page.get_by_role("main")).to_contain_text(TEXTS["someDone"].format(done=4, count=8))
    play(operator, 6, "Homing")
    steps = {step["id"]: step for step in told(page, service)["steps"]}
    assert steps["home"]["result"]["passed"], steps["home"]
    found = dict(figures(steps["home"]))
    assert 0.9 * POSITION_RAD < found["motion of the joint"] < POSITION_RAD + 0.3
    assert found["largest voltage"] <= 1.5
    assert abs(found["current joint position"]) < 0.05
    # The manual zero is accepted too.
    zero = page.get_by_role("region", name="4. Zero", exact=True)
    expect(zero).to_contain_text("Homing has set the zero")
    expect(page.get_by_role("main")).to_contain_text(TEXTS["someDone"].format(done=6, count=8))
