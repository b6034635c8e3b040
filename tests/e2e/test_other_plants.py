"""What is neither the simulator nor a rig, in the browser: a plant of an installed package, and a recording."""

from collections.abc import Iterator

import numpy as np
import pytest
from playwright.sync_api import expect

from plant.recording import UNITS
from tests.e2e.operator import MOTION_TIMEOUT_MS, Operator
from tests.e2e.service import Service, running_service
from tests.exports.written import to_csv
from tests.plant import example

SAMPLES = 2000


@pytest.fixture(scope="module")
def service(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Service]:
    folder = tmp_path_factory.mktemp("other")
    recording = folder / "slack.csv"
    still = dict.fromkeys(UNITS, np.zeros(SAMPLES))
    recording.write_bytes(to_csv({**still, "t": np.arange(SAMPLES) / 1000.0}))
    words = {"package": [example.NAME], "replay": ["replay", "--recording", str(recording)]}[request.param]
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("PYTHONPATH", str(example.installed_in(folder)))
        with running_service(folder / "data", params="ideal", plant=words) as running:
            yield running


@pytest.mark.parametrize("service", ["package"], indirect=True)
def test_a_plant_of_a_package_goes_by_its_name_and_is_driven(operator: Operator) -> None:
    operator.sign_in()
    expect(operator.page.get_by_role("img", name="Two-springs", exact=True)).to_have_text(example.NAME)
    operator.bring_up()
    assert operator.reading("Tendon force", "F_A") > 4.0
    operator.press("STOP")
    operator.expect_mode("tripped")


@pytest.mark.parametrize("service", ["replay"], indirect=True)
def test_a_recording_goes_by_its_kind_and_says_that_it_has_ended(operator: Operator) -> None:
    page = operator.page
    operator.sign_in()
    expect(page.get_by_role("img", name="Replay", exact=True)).to_have_text("REPLAY")
    ended = page.get_by_text(f"the recording has ended after {SAMPLES} samples").first
    expect(ended).to_be_visible(timeout=MOTION_TIMEOUT_MS)
    operator.expect_mode("tripped")
