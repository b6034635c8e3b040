"""Latency of STOP under generated requests from viewers and operators."""

import asyncio
import json
import random
import tempfile
import time
from pathlib import Path

import httpx
from rich.console import Console

from tests.soak.attack.costly import ROLES, store_costly_run
from tests.soak.attack.crowd import Crowd, Signals, running_clients
from tests.soak.attack.generated_requests import generated
from tests.soak.attack.stop_button import StopButton, rest, stop_and_check
from tests.soak.attack.tally import Tally
from tests.soak.live_service import Loop, bench_on

REQUESTS = 20_000
EACH = 100
"""Requests between two presses of STOP."""
CONNECTIONS = 4
"""Of each role."""
LEAVES_S = 5.0
"""So long whoever asked for a dry run waits: it may take minutes, and ends when they leave."""
STUCK_S = 300.0
TOLD = 1_000
"""Requests after which it is told how far it is."""


def ask(signals: Signals, url: str, token: str, seed: int) -> None:
    """Send generated requests. ``ever`` counts responses, ``failed`` status 500 and lost ones."""
    asyncio.run(_ask_all(signals, url, token, seed))


async def _ask_all(signals: Signals, url: str, token: str, seed: int) -> None:
    asking = [asyncio.create_task(_ask(signals, url, token, seed + number)) for number in range(CONNECTIONS)]
    signals.there.set()
    while not signals.over.is_set():
        await asyncio.sleep(0.05)
    for task in asking:
        task.cancel()
    await asyncio.gather(*asking, return_exceptions=True)


async def _ask(signals: Signals, url: str, token: str, seed: int) -> None:
    dice = random.Random(seed)
    headers = {"Authorization": f"Bearer {token}", "Content-Type": "application/json"}
    async with httpx.AsyncClient(base_url=url, headers=headers, timeout=120.0) as client:
        while True:
            method, path, body = generated(dice)
            content = None if body is None else json.dumps(body)
            leaves_s = LEAVES_S if path == "/api/experiments/dry-run" else httpx.USE_CLIENT_DEFAULT
            try:
                answer = await client.request(method, path, content=content, timeout=leaves_s)
            except httpx.HTTPError as error:
                if isinstance(error, httpx.ReadTimeout) and leaves_s == LEAVES_S:
                    signals.ever.value += 1
                    continue
                signals.failed.value += 1
                print(f"{method} {path[:80]}: {type(error).__name__}: {error}", flush=True)
                continue
            signals.ever.value += 1
            if answer.status_code == 500:
                signals.failed.value += 1
                print(f"{method} {path[:80]}: {answer.text[:200]}; {(content or '')[:400]}", flush=True)
            if answer.status_code == 429:
                await asyncio.sleep(0.05)


def under_generated_requests(requests: int, seed: int | None, console: Console) -> bool:
    """Press STOP every ``EACH`` generated requests; every request has a response, none a server error."""
    seed = random.SystemRandom().randrange(10**6) if seed is None else seed
    with tempfile.TemporaryDirectory() as folder:
        store_costly_run(Path(folder))
        with bench_on(Path(folder)) as bench:
            loop = Loop(bench.service.pid)
            tokens = [(bench.service.data / name).read_text("ascii").strip() for name in ("token", "viewer-token")]
            tally = Tally(f"STOP under generated requests, seed {seed}", console)
            buttons = [
                StopButton(bench, f"at the button, {role}", token) for role, token in zip(ROLES, tokens, strict=True)
            ]
            wanted: list[Crowd] = [
                (ask, (bench.service.url, token, 1000 * seed + 100 * number)) for number, token in enumerate(tokens)
            ]
            with running_clients(*wanted) as signals:
                due, begun, pressed = EACH, time.monotonic(), 0
                while due <= requests:
                    if sum(one.ever.value for one in signals) < due:
                        tally.lost(time.monotonic() - begun > STUCK_S, f"no {EACH} answers in {STUCK_S:g} s")
                        if time.monotonic() - begun > STUCK_S:
                            break
                        time.sleep(0.005)
                        continue
                    role = pressed % len(ROLES)
                    what = f"STOP as {ROLES[role]}"
                    stop_and_check(buttons[role], loop, tally, fresh=pressed // 2 % 2 == 1, what=what)
                    if due % TOLD == 0:
                        tally.note(f"{due} of {requests}")
                    due, begun, pressed = due + EACH, time.monotonic(), pressed + 1
                failed = sum(one.failed.value for one in signals)
                tally.note(f"{sum(one.ever.value for one in signals)} answers, {failed} failed")
                tally.lost(failed > 0, f"{failed} requests failed")
            for button in buttons:
                button.release()
            rest(bench)
            loop.close()
    return tally.close()
