"""``sinew foxglove`` with a running service: samples, token, service failure."""

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
from tests.foxglove.client import PATIENCE_S, Message, subscribe

SHORT = {"name": "sequence", "settings": {"segments": '[{"duration_s": 0.5, "q_ref": 0.1, "S_ref": 10}]'}}
UNITS = {field.name: field.unit for field in FIELDS}


@contextmanager
def run_foxglove(data: Path, *words: str) -> Iterator[tuple[str, IO[str], subprocess.Popen[str]]]:
    """Run the command and yield its address, its output and its process."""
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
    with run_foxglove(service.data) as (address, _, _):
        yield address


@pytest.mark.parametrize("protocol", ["foxglove.sdk.v1", "foxglove.websocket.v1"])
def test_a_client_receives_the_samples_that_the_run_records(
    address: str, operator: httpx.Client, protocol: str
) -> None:
    with subscribe(address, protocol) as client:
        run = operator.post("/api/experiments", json=SHORT).raise_for_status().json()["id"]
        received: list[dict[str, float]] = []
        marks: list[bytes] = []
        for message in client.receive_all():
            assert isinstance(message, Message), message
            if message.topic == "/log":
                marks.append(message.content)
                continue
            sample = json.loads(message.content)
            if sample["run"] == run:
                received.append(sample)
                assert message.time_ns == pytest.approx(time.time_ns(), abs=30e9)
            elif received:
                break
    while operator.get(f"/api/runs/{run}").json()["end_state"] != "completed":
        time.sleep(0.05)
    stored = pq.read_table(io.BytesIO(operator.get(f"/api/runs/{run}/data.parquet").raise_for_status().content))
    assert len(received) == stored.num_rows
    for name in ORDER:
        values = np.array([sample[name] for sample in received], np.float64)
        if name == "t":  # the message has the time of the control loop, the recording that of the run
            np.testing.assert_allclose(values - values[0], stored["t"].to_numpy(), atol=1e-9)
        else:
            np.testing.assert_array_equal(values.astype(np.float32), stored[name].to_numpy(), err_msg=name)
    assert any(b"experiment" in mark for mark in marks)


def test_the_time_of_a_message_is_the_time_of_its_sample(address: str) -> None:
    with subscribe(address) as client:
        samples = client.messages("/sample")
        received = [next(samples) for _ in range(500)]
        began_ns = np.array([message.time_ns - json.loads(message.content)["t"] * 1e9 for message in received])
        # After an overrun the control loop moves its time by far more than the rounding of t.
        moved = np.abs(np.diff(began_ns))
        assert np.all((moved < 1e3) | (moved > 50e6)), moved.max()
        assert np.count_nonzero(moved < 1e3) > 400
        assert abs(time.time_ns() - received[-1].time_ns) < PATIENCE_S * 1e9


def test_the_gateway_accepts_no_commands_and_publishes_type_and_unit_of_each_signal(address: str) -> None:
    with subscribe(address) as client:
        assert client.info["capabilities"] == []
        schema = json.loads(client.channels["/sample"]["schema"])
        # Lichtblick requires one word as the type of a property.
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


def test_the_gateway_accepts_only_the_viewer_token(service: Service, address: str) -> None:
    gateway, _, key = address.partition("?token=")
    assert key == (service.data / "viewer-token").read_text().strip()
    operator_token = (service.data / "token").read_text().strip()
    for words in ("", "?token=", "?token=wrong", f"?token={operator_token}", f"?token={key}&token=x", "?token=%ff"):
        with pytest.raises(InvalidStatus) as refused, connect(gateway + words, subprotocols=["foxglove.sdk.v1"]):  # type: ignore[list-item]  # a plain string
            pass
        assert refused.value.response.status_code == 401


def test_the_internal_port_sends_only_slot_numbers(service: Service) -> None:
    with run_foxglove(service.data) as (address, _, process), subscribe(address) as client:
        next(client.messages("/sample"))
        port = int(address.split(":")[2].split("/")[0])
        (other,) = listening_ports(process.pid) - {port}
        with subscribe(f"ws://127.0.0.1:{other}/") as internal_client:
            for number, message in zip(range(300), internal_client.messages("/sample"), strict=False):
                assert len(message.content) == 8, number  # a sample has some hundred characters


def listening_ports(pid: int) -> set[int]:
    """Return the IPv4 ports that a process listens on (proc(5): net/tcp, state 0A)."""
    sockets = {os.readlink(link) for link in Path(f"/proc/{pid}/fd").iterdir() if link.is_symlink()}
    rows = [line.split() for line in Path(f"/proc/{pid}/net/tcp").read_text().splitlines()[1:]]
    return {int(row[1].split(":")[1], 16) for row in rows if row[3] == "0A" and f"socket:[{row[9]}]" in sockets}


def test_clients_are_closed_after_a_token_rotation_and_informed_of_a_service_failure(tmp_path: Path) -> None:
    with (
        running_service(tmp_path / "first", params="ideal") as first,
        run_foxglove(first.data) as (address, output, _),
    ):
        with subscribe(address) as client:
            subprocess.run(
                [sys.executable, "-m", "backend", "token", "rotate", "--role", "viewer", "--data", str(first.data)],
                check=True,
            )
            with pytest.raises(ConnectionClosedError, match="1008"):
                for _ in client.receive_all():
                    pass
        again = address_in(next(line for line in output if "ws://" in line))
        assert again != address
        with subscribe(again) as client:
            next(client.messages("/sample"))
            os.kill(first.pid, signal.SIGKILL)
            warning = next(message for message in client.receive_all() if isinstance(message, dict))
            assert (warning["op"], warning["level"]) == ("status", 2)
            assert "no new data is shown until the service responds" in warning["message"]
            assert "retried" in output.readline()
            with running_service(first.data, params="ideal"):
                removal = next(
                    message
                    for message in client.receive_all()
                    if isinstance(message, dict) and message["op"] != "status"
                )
                assert removal == {"op": "removeStatus", "statusIds": [warning["id"]]}
                assert json.loads(next(client.messages("/sample")).content)["t"] < PATIENCE_S


def test_the_command_reports_a_missing_service_and_an_occupied_port(
    service: Service, tmp_path: Path, address: str
) -> None:
    def stderr_of(*words: str) -> str:
        command = [sys.executable, "-m", "backend", "foxglove", *words]
        ended = subprocess.run(command, capture_output=True, text=True, timeout=PATIENCE_S, check=False)
        assert ended.returncode == 1, ended.stdout
        return ended.stderr

    assert "start it with `sinew serve`" in stderr_of("--data", str(tmp_path))
    taken = address.split(":")[2].split("/")[0]
    assert f"port {taken}" in stderr_of("--data", str(service.data), "--port", taken)
