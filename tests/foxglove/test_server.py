"""``sinew foxglove`` beside a real service: what is heard is what is recorded, and only with the token is it heard."""

import io
import json
import os
import re
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import IO

import httpx
import numpy as np
import pyarrow.parquet as pq
import pytest
from websockets.exceptions import ConnectionClosedError, InvalidStatus
from websockets.sync.client import connect

from backend.exports.base import ORDER
from backend.sample import FIELDS
from tests.e2e.service import Service, running_service
from tests.foxglove.client import PATIENCE_S, Message, watching

SHORT = {"name": "sequence", "settings": {"segments": '[{"duration_s": 0.5, "q_ref": 0.1, "S_ref": 10}]'}}
UNITS = {field.name: field.unit for field in FIELDS}


@contextmanager
def foxglove_beside(data: Path, *words: str) -> Iterator[tuple[str, IO[str], subprocess.Popen[str]]]:
    """Run the command; give the address it prints, what it says afterwards, and its process."""
    command = [sys.executable, "-u", "-m", "backend", "foxglove", "--data", str(data), "--port", "0", *words]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)
    assert process.stdout is not None
    try:
        yield address_in(process.stdout.readline()), process.stdout, process
    finally:
        process.send_signal(signal.SIGINT)
        assert process.wait(PATIENCE_S) == 130
        process.stdout.close()


def address_in(line: str) -> str:
    found = re.search(r"ws://127\.0\.0\.1:\d+/\?token=\S+", line)
    assert found, line
    return found[0]


@pytest.fixture(scope="module")
def service(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Service]:
    with running_service(tmp_path_factory.mktemp("foxglove"), params="ideal") as running:
        yield running


@pytest.fixture(scope="module")
def operator(service: Service) -> Iterator[httpx.Client]:
    token = (service.data / "token").read_text().strip()
    with httpx.Client(base_url=service.url, headers={"Authorization": f"Bearer {token}"}, timeout=PATIENCE_S) as client:
        yield client


@pytest.fixture(scope="module")
def address(service: Service) -> Iterator[str]:
    with foxglove_beside(service.data) as (address, _, _):
        yield address


@pytest.mark.parametrize("protocol", ["foxglove.sdk.v1", "foxglove.websocket.v1"])
def test_what_a_client_hears_of_an_experiment_is_what_is_recorded(
    address: str, operator: httpx.Client, protocol: str
) -> None:
    with watching(address, protocol) as client:
        run = operator.post("/api/experiments", json=SHORT).raise_for_status().json()["id"]
        heard: list[dict[str, float]] = []
        marks: list[bytes] = []
        for message in client.heard():
            assert isinstance(message, Message), message
            if message.topic == "/log":
                marks.append(message.content)
                continue
            sample = json.loads(message.content)
            if sample["run"] == run:
                heard.append(sample)
                assert message.time_ns == pytest.approx(time.time_ns(), abs=30e9)
            elif heard:
                break
    while operator.get(f"/api/runs/{run}").json()["end_state"] != "completed":
        time.sleep(0.05)
    stored = pq.read_table(io.BytesIO(operator.get(f"/api/runs/{run}/data.parquet").raise_for_status().content))
    assert len(heard) == stored.num_rows
    for name in ORDER:
        values = np.array([sample[name] for sample in heard], np.float64)
        if name == "t":  # of the loop here, of the run there
            np.testing.assert_allclose(values - values[0], stored["t"].to_numpy(), atol=1e-9)
        else:
            np.testing.assert_array_equal(values.astype(np.float32), stored[name].to_numpy(), err_msg=name)
    assert any(b"experiment" in mark for mark in marks)


def test_the_time_of_a_message_is_that_of_its_sample(address: str) -> None:
    with watching(address) as client:
        samples = client.messages("/sample")
        heard = [next(samples) for _ in range(500)]
        began_ns = np.array([message.time_ns - json.loads(message.content)["t"] * 1e9 for message in heard])
        # a loop that a busy machine held up has its times counted anew, by far more than the rounding of t
        moved = np.abs(np.diff(began_ns))
        assert np.all((moved < 1e3) | (moved > 50e6)), moved.max()
        assert np.count_nonzero(moved < 1e3) > 400
        assert abs(time.time_ns() - heard[-1].time_ns) < PATIENCE_S * 1e9


def test_nothing_can_be_sent_and_each_signal_has_one_type_and_its_unit(address: str) -> None:
    with watching(address) as client:
        assert client.info["capabilities"] == []
        schema = json.loads(client.channels["/sample"]["schema"])
        # What Lichtblick's reader of schemas takes: one word for the type of a property.
        assert {name: (part["type"], part["unit"]) for name, part in schema["properties"].items()} == {
            name: ("number", UNITS[name]) for name in ORDER
        }
        assert (client.channels["/log"]["encoding"], client.channels["/log"]["schemaName"]) == (
            "protobuf",
            "foxglove.Log",
        )
        client.socket.send(json.dumps({"op": "advertise", "channels": [{"id": 1, "topic": "/mode"}]}))
        client.socket.send(b"\x01\x01\x00\x00\x00off")
        client.socket.send("[]")
        samples = client.messages("/sample")
        assert [next(samples).topic for _ in range(100)] == ["/sample"] * 100
        client.socket.send("stop!")
        with pytest.raises(ConnectionClosedError, match="1008"):
            list(samples)


def test_only_the_viewers_token_opens_the_door(service: Service, address: str) -> None:
    door, _, key = address.partition("?token=")
    assert key == (service.data / "viewer-token").read_text().strip()
    operators = (service.data / "token").read_text().strip()
    for words in ("", "?token=", "?token=wrong", f"?token={operators}", f"?token={key}&token=x", "?token=%ff"):
        with pytest.raises(InvalidStatus) as refused, connect(door + words, subprotocols=["foxglove.sdk.v1"]):  # type: ignore[list-item]  # a plain word
            pass
        assert refused.value.response.status_code == 401


def test_the_vendors_own_port_tells_numbers_only(service: Service) -> None:
    with foxglove_beside(service.data) as (address, _, process), watching(address) as client:
        next(client.messages("/sample"))
        door = int(address.split(":")[2].split("/")[0])
        (other,) = listening_ports(process.pid) - {door}
        with watching(f"ws://127.0.0.1:{other}/") as intruder:
            for number, message in zip(range(300), intruder.messages("/sample"), strict=False):
                assert len(message.content) == 8, number  # a sample has some hundred characters


def listening_ports(pid: int) -> set[int]:
    """Ports of IPv4 that a process listens on (proc(5): net/tcp, state 0A)."""
    sockets = {os.readlink(link) for link in Path(f"/proc/{pid}/fd").iterdir() if link.is_symlink()}
    rows = [line.split() for line in Path(f"/proc/{pid}/net/tcp").read_text().splitlines()[1:]]
    return {int(row[1].split(":")[1], 16) for row in rows if row[3] == "0A" and f"socket:[{row[9]}]" in sockets}


def test_a_replaced_token_ends_what_it_opened_and_a_service_that_dies_is_told_and_heard_again(tmp_path: Path) -> None:
    with (
        running_service(tmp_path / "first", params="ideal") as first,
        foxglove_beside(first.data) as (address, says, _),
    ):
        with watching(address) as client:
            subprocess.run(
                [sys.executable, "-m", "backend", "token", "rotate", "--role", "viewer", "--data", str(first.data)],
                check=True,
            )
            with pytest.raises(ConnectionClosedError, match="1008"):
                for _ in client.heard():
                    pass
        again = address_in(next(line for line in says if "ws://" in line))
        assert again != address
        with watching(again) as client:
            next(client.messages("/sample"))
            os.kill(first.pid, signal.SIGKILL)
            told = next(said for said in client.heard() if isinstance(said, dict))
            assert (told["op"], told["level"]) == ("status", 2)
            assert "no new data is shown until the service responds" in told["message"]
            assert "retried" in says.readline()
            with running_service(first.data, params="ideal"):
                gone = next(said for said in client.heard() if isinstance(said, dict) and said["op"] != "status")
                assert gone == {"op": "removeStatus", "statusIds": [told["id"]]}
                assert json.loads(next(client.messages("/sample")).content)["t"] < PATIENCE_S


def test_without_a_service_or_a_port_it_says_what_to_do(service: Service, tmp_path: Path, address: str) -> None:
    def said(*words: str) -> str:
        command = [sys.executable, "-m", "backend", "foxglove", *words]
        ended = subprocess.run(command, capture_output=True, text=True, timeout=PATIENCE_S, check=False)
        assert ended.returncode == 1, ended.stdout
        return ended.stderr

    assert "start it with `sinew serve`" in said("--data", str(tmp_path))
    taken = address.split(":")[2].split("/")[0]
    assert f"port {taken}" in said("--data", str(service.data), "--port", taken)
