"""A real service for the fuzz tests: with stored data, reset between requests, and monitored."""

import socket
import subprocess
import sys
import time
from collections import Counter
from pathlib import Path
from typing import Any, ClassVar, Literal

import httpx
import requests

from backend.faults import Fault
from tests.e2e.service import Service

Role = Literal["operator", "viewer"]
TOKEN_FILE: dict[Role, str] = {"operator": "token", "viewer": "viewer-token"}
TIMEOUT_S = 600.0
"""As long as a dry run may take: on a busy machine one of the longest experiments takes minutes."""


def store_runs(data: Path) -> None:
    """Store a short identification and a short experiment in the data folder, by the command line."""
    for words in (
        ["identify", "actuator", "--set", "bits=6", "--set", "periods=2"],
        ["experiment", "tracking", "--set", "q_duration_s=0.5", "--set", "S_duration_s=0.5"],
    ):
        command = [sys.executable, "-m", "backend", *words, "--params", "ideal", "--data", str(data)]
        subprocess.run(command, check=True, stdout=subprocess.DEVNULL, timeout=300)


class Target:
    """The service, its clients and the counts of its responses."""

    summary: ClassVar[list[str]] = []

    def __init__(self, service: Service) -> None:
        self.service = service
        self.answers: Counter[tuple[str, int]] = Counter()
        self.sent: Counter[str] = Counter()
        self.memory: list[tuple[int, float]] = []
        self.harmless: list[requests.PreparedRequest] = []
        self.accepted: Counter[tuple[str, Role]] = Counter()
        self.sessions: dict[Role, requests.Session] = {role: requests.Session() for role in TOKEN_FILE}
        self._loop = self._loop_process()
        # One client, because each new one would first load the certificates of the system.
        self._beside = httpx.Client(base_url=service.url, timeout=TIMEOUT_S)
        self.ask("POST", "/api/banks", {"name": "bench", "identifications": [1]}).raise_for_status()

    def close(self) -> None:
        self._beside.close()
        for session in self.sessions.values():
            session.close()
        kinds = sorted({kind for kind, _ in self.answers})
        for kind in kinds:
            by_status = {status: n for (k, status), n in sorted(self.answers.items()) if k == kind}
            shown = ", ".join(f"{status or 'none'}: {n}" for status, n in by_status.items())
            self.summary.append(f"{kind}: {sum(by_status.values())}; by status: {shown}")
        memory = ", ".join(f"{at} requests: {MB:.0f}" for at, MB in self.memory)
        self.summary.append(f"memory of the service [MB] after {memory}")

    @property
    def address(self) -> tuple[str, int]:
        host, port = self.service.url.removeprefix("http://").split(":")
        return host, int(port)

    def authorization(self, role: Role) -> dict[str, str]:
        """Return the header with the current token, because a request of the fuzz may have changed it."""
        return {"Authorization": f"Bearer {(self.service.data / TOKEN_FILE[role]).read_text(encoding='ascii').strip()}"}

    def connect(self) -> socket.socket:
        return socket.create_connection(self.address, timeout=10.0)

    def ask(self, method: str, path: str, body: dict[str, Any] | None = None) -> httpx.Response:
        """Send a request as the operator, outside of the fuzz."""
        headers = self.authorization("operator")
        return self._beside.request(method, path, headers=headers, json=body)

    def state(self) -> dict[str, Any]:
        return dict(self.ask("GET", "/api/state").raise_for_status().json())

    def reset_activity(self) -> None:
        """Undo the effects of an accepted request: a motion, a run, a queue, an injected fault, a control lease.

        This allows requests that start a motion, without refusals of the following requests.
        """
        state = self.state()
        if state["mode"] != "off" or state["task"] is not None:
            self.ask("POST", "/api/experiments/queue/hold").raise_for_status()
            self.ask("DELETE", "/api/faults/injection")
            self.ask("POST", "/api/stop").raise_for_status()
            until = time.monotonic() + TIMEOUT_S
            while (answer := self.ask("POST", "/api/reset")).status_code == 409:
                assert time.monotonic() < until, answer.text
                time.sleep(0.05)
            answer.raise_for_status()
            if state["fault"] is not None and state["fault"]["code"] == Fault.WATCHDOG_DEAD:
                self._loop = self._loop_process()  # an injected fault, whose reset starts another loop

    def be_in_run(self) -> None:
        """Change to mode Run, in which the loop accepts references and starts experiments."""
        self.reset_activity()
        self.ask("POST", "/api/mode", {"mode": "pretension"}).raise_for_status()
        until = time.monotonic() + TIMEOUT_S
        while not self.state()["pretension_done"]:
            assert time.monotonic() < until, "pretension was not reached"
            time.sleep(0.05)
        self.ask("POST", "/api/mode", {"mode": "run"}).raise_for_status()

    def log_size(self) -> int:
        return self.service.log.stat().st_size

    def log_since(self, position: int) -> str:
        with self.service.log.open("rb") as log:
            log.seek(position)
            return log.read().decode(errors="replace")

    def alive(self) -> bool:
        """Return whether service and loop are the original processes and the service responds."""
        return self._loop_process() == self._loop and self.ask("GET", "/api/health").status_code == 200

    def memory_MB(self) -> float:
        """Return the private memory of the service process [MB], without its code and shared memory."""
        fields = dict(line.split(":", 1) for line in Path(f"/proc/{self.service.pid}/status").read_text().splitlines())
        return int(fields["RssAnon"].split()[0]) / 1024.0

    def note_memory(self) -> None:
        """Record the memory of the service after the current number of requests."""
        self.memory.append((sum(self.answers.values()), self.memory_MB()))

    def _loop_process(self) -> int | None:
        for thread in Path(f"/proc/{self.service.pid}/task").iterdir():
            for child in (thread / "children").read_text(encoding="ascii").split():
                if b"backend.realtime.process" in Path(f"/proc/{child}/cmdline").read_bytes():
                    return int(child)
        return None
