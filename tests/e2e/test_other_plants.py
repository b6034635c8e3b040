"""Other plants in the browser: a plant of an installed package, and a replayed recording."""

import os
from collections.abc import Iterator

import numpy as np
import pytest
from playwright.sync_api import expect

from plant.replay import UNITS
from tests.e2e.operator import MOTION_TIMEOUT_MS, Operator
from tests.e2e.page_texts import load_texts
from tests.e2e.service import Service, running_service
from tests.exports.written import to_csv
from tests.plant import example

OPERATE = load_texts("pages/operate")

SAMPLES = 2001
DURATION_S = 2.0
U_A = 3.25
"""Voltage [V] of motor A in the recording, from 0.5 s on."""


@pytest.fixture(scope="module")
def service(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Service]:
    folder = tmp_path_factory.mktemp("other")
    recording = folder / "slack.csv"
    still, t = dict.fromkeys(UNITS, np.zeros(SAMPLES)), np.arange(SAMPLES) / 1000.0
    runs = np.where(t >= 0.5, 1.0, 0.0)
    recording.write_bytes(to_csv({**still, "t": t, "u_A": U_A * runs, "mode": 2.0 * runs}))
    words = {"package": [example.NAME], "replay": ["replay", "--recording", str(recording)]}[request.param]
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("PYTHONPATH", str(example.installed_in(folder)), prepend=os.pathsep)
        with running_service(folder / "data", params="ideal", plant=words) as running:
            yield running


@pytest.mark.parametrize("service", ["package"], indirect=True)
def test_the_plant_of_a_package_is_shown_by_name_and_accepts_commands(operator: Operator) -> None:
    operator.sign_in()
    expect(operator.page.get_by_role("img", name="Two-springs", exact=True)).to_have_text(example.NAME)
    operator.bring_up()
    assert operator.reading("Tendon force", "F_A") > 4.0
    operator.press("STOP")
    operator.expect_mode("tripped")


@pytest.mark.parametrize("service", ["replay"], indirect=True)
def test_a_replayed_recording_has_a_player_and_its_end_raises_no_alarm(operator: Operator) -> None:
    page = operator.page
    operator.sign_in()
    expect(page.get_by_role("img", name="Replay", exact=True)).to_have_text("REPLAY")
    status, position = (page.get_by_role("status", name=name) for name in ("Status", OPERATE["playbackPosition"]))
    expect(status).to_have_text("Replay of samples, 0:02 of 0:02, ended.", timeout=MOTION_TIMEOUT_MS)
    operator.expect_mode("off")
    expect(page.get_by_role("alert", name="Fault")).to_have_count(0)
    expect(page.get_by_role("group", name="Change mode")).to_have_count(0)

    player = page.get_by_role("region", name="Player")
    player.get_by_role("combobox", name=OPERATE["playbackSpeed"]).select_option("0.25")
    operator.wait(lambda: operator.state()["player"]["speed"] == 0.25)
    operator.press("Play")
    expect(status).to_contain_text("playing at 0.25×")
    operator.press("STOP")
    expect(status).to_contain_text("paused")
    expect(page.get_by_role("status", name="Stop result")).to_contain_text("Playback paused")
    operator.expect_mode("off")
    player.get_by_role("button", name="off → run").click()
    expect(position).to_have_text(f"0:00.5 of 0:0{DURATION_S:.1f}")
    operator.wait(lambda: abs(operator.reading("Motor voltage", "u_A") - U_A) < 0.01)
    assert operator.state()["fault"] is None
