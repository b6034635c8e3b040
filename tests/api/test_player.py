"""A replay over HTTP: angle of the obstacle, player commands and their refusals."""

from collections.abc import Iterator
from contextlib import closing
from pathlib import Path
from typing import Any

import httpx
import numpy as np
import pytest

from backend.exports.base import export_run
from backend.exports.formats import DataFormat, stream_export
from backend.faults import EXPLANATIONS, FAULT_CODE, Fault
from backend.services.player import describe_recording
from backend.storage import events, recordings, runs
from backend.storage.database import open_database
from backend.storage.events import EventKind
from plant.replay import UNITS
from tests.api.conftest import client_with, problem, until, until_state
from tests.e2e.service import Service, running_service
from tests.exports.stored import tracked
from tests.exports.written import to_csv

SAMPLES = 4001
DURATION_S = 4.0


def recorded() -> dict[str, np.ndarray]:
    """Four seconds with a run from 1 s to 3 s, and a trip of the safety module there."""
    t = np.arange(SAMPLES) / 1000.0
    still = dict.fromkeys(UNITS, np.zeros(SAMPLES))
    mode = np.select([t < 1.0, t < 3.0], [0.0, 2.0], 7.0)
    fault = np.where(t < 3.0, 0.0, FAULT_CODE[Fault.SAFETY_MODULE])
    return {
        **still,
        "t": t,
        "q": t / 10.0,
        "u_A": 2.0 * t,
        "mode": mode,
        "fault": fault,
        "q_ref": np.full(SAMPLES, 0.4),
    }


@pytest.fixture(scope="module")
def replaying(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Service]:
    folder = tmp_path_factory.mktemp("replay")
    (folder / "run-12.csv").write_bytes(to_csv(recorded()))
    words = ["replay", "--recording", str(folder / "run-12.csv")]
    with running_service(folder / "data", params="ideal", plant=words) as running:
        yield running


@pytest.fixture
def ended(replaying: Service) -> Iterator[httpx.Client]:
    """The operator, with the player at the end of the recording."""
    with client_with(replaying, "token") as client:
        client.put("/api/player", json={"playing": True, "speed": 4.0}).raise_for_status()
        wait_for_player(client, ended=True)
        yield client


def wait_for_player(client: httpx.Client, **wanted: Any) -> dict[str, Any]:
    """Wait until the player has these values; return the state."""

    def stands(state: dict[str, Any]) -> bool:
        player = state["player"]
        return player is not None and all(player[name] == value for name, value in wanted.items())

    return until_state(client, stands, f"the player never stood at {wanted}")


def test_the_end_of_a_replay_causes_no_trip_alarm_or_flight_record(ended: httpx.Client) -> None:
    state = wait_for_player(ended, ended=True)
    assert state["player"]["t"] == state["player"]["duration_s"] == DURATION_S
    assert (state["player"]["playing"], state["mode"], state["fault"], state["problems"]) == (False, "off", None, [])
    assert ended.get("/api/flights").json()["flights"] == []
    kinds = {entry["kind"] for entry in ended.get("/api/log").json()["entries"]}
    assert not kinds & {"trip", "fault"}


def test_the_player_seeks_pauses_and_plays_at_the_set_speed(ended: httpx.Client) -> None:
    ended.put("/api/player", json={"t": 1.25, "playing": False, "speed": 0.5}).raise_for_status()
    state = wait_for_player(ended, t=1.25, playing=False)
    assert (state["player"]["speed"], state["player"]["ended"]) == (0.5, False)
    assert state["references"]["q_ref"] == pytest.approx(0.4)
    assert not state["references"]["in_force"]
    ended.put("/api/player", json={"playing": True}).raise_for_status()
    first, second = (until_state(ended, lambda one: one["player"]["playing"], "it never played") for _ in range(2))
    moved_s = second["player"]["t"] - first["player"]["t"]
    ticks = second["player"]["tick"] - first["player"]["tick"]
    assert moved_s == pytest.approx(0.5 * ticks / 1000.0, abs=0.0011)


def test_stop_pauses_the_player_without_latching_and_is_logged(ended: httpx.Client) -> None:
    ended.put("/api/player", json={"t": 0.0, "playing": True, "speed": 0.25}).raise_for_status()
    proof = ended.post("/api/stop").raise_for_status().json()
    assert proof["paused_recording"] is True
    state = wait_for_player(ended, playing=False)
    assert state["player"]["ended"] is False
    assert (state["mode"], state["fault"], state["stop_proof"]) == ("off", None, proof)
    newest = until(lambda: [one for one in ended.get("/api/log").json()["entries"] if "STOP" in one["text"]])
    assert newest[0]["kind"] == "note"
    ended.put("/api/player", json={"playing": True}).raise_for_status()
    assert wait_for_player(ended, playing=True)["stop_proof"] is None


@pytest.mark.parametrize(
    ("method", "path", "body"),
    [
        ("POST", "/api/mode", {"mode": "pretension"}),
        ("POST", "/api/mode", {"mode": "run"}),
        ("PUT", "/api/references", {"q_ref": 0.1, "S_ref": 9.0}),
        ("POST", "/api/push", {"F_push": 1.0}),
        ("PUT", "/api/wall", {"wall": None}),
        ("PUT", "/api/touch", {"learn": True}),
        ("PUT", "/api/tuning", {"lam_q": 1.0}),
        ("POST", "/api/identifications", {"kind": "motor"}),
        ("POST", "/api/experiments", {"name": "tracking"}),
        ("POST", "/api/banks/geometry/activate", None),
        ("DELETE", "/api/faults/injection", None),
    ],
)
def test_an_invalid_player_command_is_rejected_with_the_reason(
    ended: httpx.Client, method: str, path: str, body: object
) -> None:
    answer = ended.request(method, path, json=body)
    assert (answer.status_code, problem(answer)["code"]) == (409, "recording_played")


@pytest.mark.parametrize(
    ("order", "quantity"), [({"speed": 0.1}, "speed"), ({"speed": 5.0}, "speed"), ({"t": 4.5}, "t"), ({"t": -1.0}, "t")]
)
def test_a_seek_beyond_the_recording_names_its_bounds(
    ended: httpx.Client, order: dict[str, float], quantity: str
) -> None:
    refused = problem(ended.put("/api/player", json=order))
    assert refused["quantity"] == quantity
    assert (refused["minimum"], refused["maximum"]) == {"speed": (0.25, 4.0), "t": (0.0, DURATION_S)}[quantity]


def test_the_player_view_has_the_events_of_the_recording(ended: httpx.Client, replaying: Service) -> None:
    with client_with(replaying, "viewer-token") as viewer:
        played = viewer.get("/api/player").raise_for_status().json()
        assert viewer.put("/api/player", json={"playing": True}).status_code == 403
    assert (played["title"], played["run"], played["duration_s"]) == ("samples", None, DURATION_S)
    assert [(mark["t"], mark["kind"], mark["text"]) for mark in played["marks"]] == [
        (1.0, "mode", "off → run"),
        (3.0, "mode", "run → tripped"),
        (3.0, "trip", EXPLANATIONS[Fault.SAFETY_MODULE].message),
    ]


def test_a_plant_has_no_player(operator: httpx.Client) -> None:
    assert operator.get("/api/state").json()["player"] is None
    assert problem(operator.get("/api/player"))["code"] == "no_recording"


@pytest.mark.parametrize("format", [DataFormat.CSV, DataFormat.PARQUET])
def test_events_come_from_the_log_of_the_run_or_from_the_columns(tmp_path: Path, format: DataFormat) -> None:
    with closing(open_database(tmp_path / "here")) as here, closing(open_database(tmp_path / "there")) as there:
        run = tracked(here)
        with here.session() as session:
            begun, first = runs.get(session, run).started_at, recordings.span(session, run).first_tick
            events.add(session, EventKind.NOTE, "the tendon creaks", who="Mara", tick=first + 250, at=begun)
        file = tmp_path / f"run.{format}"
        file.write_bytes(b"".join(stream_export(export_run(here, run), format, tmp_path)))
        played, elsewhere = describe_recording(file, here), describe_recording(file, there)
    assert (played.title, played.run) == (elsewhere.title, elsewhere.run) == (f"run {run}", run)
    assert [(mark.t, mark.text, mark.who) for mark in played.marks] == [(0.25, "the tendon creaks", "Mara")]
    assert all(mark.kind in (EventKind.MODE, EventKind.TRIP) for mark in elsewhere.marks)


def test_a_file_without_metadata_is_named_by_its_file_name(tmp_path: Path) -> None:
    (tmp_path / "bench.csv").write_bytes(b"".join(to_csv(recorded()).splitlines(keepends=True)[-SAMPLES - 1 :]))
    with closing(open_database(tmp_path)) as database:
        assert describe_recording(tmp_path / "bench.csv", database).title == "bench.csv"
