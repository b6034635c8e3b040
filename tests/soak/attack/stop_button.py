"""A signed-in client that presses STOP: latency of the response, and outputs at zero at that time."""

import http.client
import json
import time
from dataclasses import dataclass
from urllib.parse import urlsplit

import httpx

from tests.soak.attack.tally import STOP_S, Tally
from tests.soak.live_service import Bench, Loop, wait_until

TIMEOUT_S = 15.0
WOUND_V = 0.05
"""Volts on a motor that is being wound up."""

_CLOSED = (http.client.RemoteDisconnected, ConnectionResetError, BrokenPipeError)


@dataclass(frozen=True)
class Press:
    """One STOP: response, latency [s], and the confirmation of the loop [ms], None without one."""

    status: int
    latency_s: float
    proof_ms: float | None


class StopButton:
    """Presses STOP with the session cookie, on a kept connection or a new one each time.

    ``token``: the token of the session; the operator's by default.
    """

    def __init__(self, bench: Bench, name: str = "at the button", token: str = "") -> None:
        self._address = urlsplit(bench.service.url)
        self._kept: http.client.HTTPConnection | None = None
        token = token or bench.client.headers["Authorization"].removeprefix("Bearer ")
        with httpx.Client(base_url=bench.service.url, timeout=TIMEOUT_S) as page:
            page.post("/api/session", json={"token": token, "name": name}).raise_for_status()
            self._cookie = "; ".join(f"{cookie}={value}" for cookie, value in page.cookies.items())
        self._kept = self._connection()
        self._kept.request("GET", "/api/session", headers={"Cookie": self._cookie})
        self._kept.getresponse().read()

    def press(self, *, fresh: bool = False) -> Press:
        """Press STOP; a kept connection that the service has closed is reopened, as a browser does."""
        begun = time.perf_counter()
        if fresh:
            connection = self._connection()
            try:
                return self._ask(connection, begun)
            except _CLOSED:
                return Press(0, time.perf_counter() - begun, None)
            finally:
                connection.close()
        for _ in range(2):
            self._kept = connection = self._kept or self._connection()
            try:
                return self._ask(connection, begun)
            except _CLOSED:
                self.release()
        return Press(0, time.perf_counter() - begun, None)

    def get(self, path: str) -> int:
        """Send a GET as the page does; return the status."""
        connection = self._connection()
        try:
            connection.request("GET", path, headers={"Cookie": self._cookie})
            return connection.getresponse().status
        finally:
            connection.close()

    def release(self) -> None:
        """Close the kept connection."""
        if self._kept is not None:
            self._kept.close()
            self._kept = None

    def _connection(self) -> http.client.HTTPConnection:
        return http.client.HTTPConnection(str(self._address.hostname), self._address.port, timeout=TIMEOUT_S)

    def _ask(self, connection: http.client.HTTPConnection, begun: float) -> Press:
        try:
            connection.request("POST", "/api/stop", headers={"Cookie": self._cookie, "Content-Length": "0"})
            answer = connection.getresponse()
            content = answer.read()
        except (TimeoutError, ConnectionRefusedError):
            return Press(0, time.perf_counter() - begun, None)
        latency_s = time.perf_counter() - begun
        proof_ms = json.loads(content)["milliseconds"] if answer.status == 200 else None
        return Press(answer.status, latency_s, proof_ms)


def stop_and_check(button: StopButton, loop: Loop, tally: Tally, *, fresh: bool = False, what: str = "STOP") -> None:
    """Press STOP while service and loop run; the response must be in time, confirmed, with zero volts."""
    press = button.press(fresh=fresh)
    card = loop.card.state()
    tally.take(f"{what} [s]", press.latency_s, STOP_S)
    tally.lost(press.status != 200, f"{what} answered {press.status}")
    if press.proof_ms is not None:
        tally.take("its proof [ms]", press.proof_ms, 2.0)
        tally.lost((card.u_A, card.u_B) != (0.0, 0.0), f"{card.u_A:.2f} V, {card.u_B:.2f} V after the proof")


def rest(bench: Bench) -> None:
    """Change to mode Off from any mode."""
    mode = bench.state()["mode"]
    if mode != "off":
        if mode != "tripped":
            bench.client.post("/api/stop").raise_for_status()
        bench.client.post("/api/reset").raise_for_status()


def wind_up(bench: Bench, loop: Loop) -> None:
    """Apply voltages to the motors, from rest."""
    rest(bench)
    bench.client.post("/api/mode", json={"mode": "pretension"}).raise_for_status()
    wait_until(lambda: abs(loop.card.state().u_A) > WOUND_V, "volts on the motors")
