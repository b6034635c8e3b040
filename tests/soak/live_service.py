"""A real service under test: operated over HTTP, with its loop process observed from outside."""

import os
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import httpx

from backend.realtime.ring_buffer import Ring
from backend.sample import INDEX
from plant.safety_card import Card
from tests.e2e.service import Service, running_service

PATIENCE_S = 60.0


class Loop:
    """The loop process of a service: its id, and its ring buffer and card, which outlive it here."""

    def __init__(self, service_pid: int) -> None:
        self.pid, ring_fd, card_fd = _worker_of(service_pid)
        self.ring = Ring.attach(os.open(f"/proc/{self.pid}/fd/{ring_fd}", os.O_RDWR))
        self.card = Card(os.open(f"/proc/{self.pid}/fd/{card_fd}", os.O_RDWR))
        self.ended = os.pidfd_open(self.pid)

    def newest(self, signal: str) -> float:
        row = self.ring.newest()
        return float("nan") if row is None else float(row[INDEX[signal]])

    def close(self) -> None:
        self.ring.close()
        self.card.close()
        os.close(self.ended)


class Bench:
    """Commands of an operator, by a script."""

    def __init__(self, service: Service) -> None:
        token = (service.data / "token").read_text(encoding="ascii").strip()
        self.service = service
        self.client = httpx.Client(
            base_url=service.url, headers={"Authorization": f"Bearer {token}"}, timeout=PATIENCE_S
        )

    def state(self) -> dict[str, Any]:
        return dict(self.client.get("/api/state").raise_for_status().json())

    def run(self) -> int:
        """Change to mode Run; return the number of the run."""
        self.client.post("/api/mode", json={"mode": "pretension"}).raise_for_status()
        wait_until(lambda: bool(self.state()["pretension_done"]), "pretension")
        self.client.post("/api/mode", json={"mode": "run"}).raise_for_status()
        wait_until(lambda: self.state()["recording_run"] is not None, "recording")
        return int(self.state()["recording_run"])

    def step(self, q_ref: float) -> None:
        """Send a reference step to the joint."""
        self.client.put("/api/references", json={"q_ref": q_ref, "S_ref": 11.0}).raise_for_status()


@contextmanager
def bench_on(data: Path, log: Path | None = None, plant: Sequence[str] = ("simulator",)) -> Iterator[Bench]:
    """Start a service on the data folder with ``plant`` after ``--plant``; end it if it still runs."""
    with running_service(data, log=log, plant=plant) as service:
        bench = Bench(service)
        try:
            yield bench
        finally:
            bench.client.close()


def wait_until(reached: Callable[[], bool], what: str, timeout_s: float = PATIENCE_S) -> float:
    """Wait for a condition; return the duration [s]."""
    begun = time.monotonic()
    while not reached():
        if time.monotonic() - begun > timeout_s:
            raise TimeoutError(f"{what}: not reached within {timeout_s:g} s")
        time.sleep(0.005)
    return time.monotonic() - begun


def _worker_of(service_pid: int) -> tuple[int, int, int]:
    for thread in Path(f"/proc/{service_pid}/task").iterdir():
        for child in map(int, (thread / "children").read_text(encoding="ascii").split()):
            words = Path(f"/proc/{child}/cmdline").read_bytes().split(b"\0")
            if b"backend.realtime.process" in words:
                ring_fd, _, card_fd = (int(word) for word in words[words.index(b"backend.realtime.process") + 1 :][:3])
                return child, ring_fd, card_fd
    raise LookupError(f"process {service_pid} has no loop process")
