"""Latency of STOP while people send the most costly requests: each kind alone, then all together."""

import asyncio
import json
import tempfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import httpx
from rich.console import Console

from backend.reports import sheet
from backend.schemas.run import LONGEST_SHEET
from backend.storage import runs
from backend.storage.database import open_database
from backend.storage.runs import EndState, NewRun, RunKind
from plant.parameters import load_parameters
from tests.soak.attack.crowd import Crowd, Signals, running_clients
from tests.soak.attack.stop_button import StopButton, stop_and_check, wind_up
from tests.soak.attack.tally import Tally
from tests.soak.live_service import Loop, bench_on

CONNECTIONS = 6
"""Of each costly request and role."""

HOLDING = "round(1, -1000000000)"
"""Computes a power of ten with a billion digits, where whole numbers are taken as they are."""

MOST = 56
"""Connections of a crowd: fewer than the places of guests, as all are guests until their first request is read."""

APART_S = 0.02
"""Between two connections that are opened: more guests than there are places at once would be sent away."""

ROLES = ("operator", "viewer")
"""Who presses STOP, in turn; in the order of the tokens."""

LONGEST_PREDICTION = {"kind": "actuator", "chip_s": 0.29, "bits": 9, "periods": 4}
"""An identification of nearly ten minutes."""

_RUN = "run"
"""Stands for the number of the imported run in a path."""

Request = tuple[str, str, Mapping[str, Any] | None]
"""Method, path and JSON body."""


def text_of(duration: str) -> dict[str, Any]:
    """Return the document of an experiment that holds for a duration."""
    parts = [{"do": "hold", "duration_s": duration}]
    return {
        "format": 1,
        "name": "costly",
        "title": "Costly",
        "description": "",
        "phases": [{"name": "a", "title": "A", "parts": parts}],
    }


def long_text() -> str:
    """Return the most costly known text of an experiment: as many small mappings as the limit allows."""
    return "format: 1\nname: a\ntitle: a\ndescription: d\nphases: [" + "{}," * 33_000 + "]"


def largest_sheet() -> str:
    """Return a chart sheet at its limits."""
    head = '<svg xmlns="http://www.w3.org/2000/svg" width="180mm" height="90mm" viewBox="0 0 900 450">'
    long = sheet.MOST_LETTERS // sheet.MOST_LETTERS_OF_A_TEXT - 10
    texts = f'<text x="9" y="9">{"ab c" * (sheet.MOST_LETTERS_OF_A_TEXT // 4)}</text>' * long
    texts += '<text x="9" y="9">a</text>' * (sheet.MOST_TEXTS - long)
    path = f'<path d="M0 0{"h1v1" * (sheet.MOST_OF_A_PATH // 4 - 1)}" fill="none" stroke="#0072B2"/>' * 2
    rects = '<rect width="1" height="2"/>' * (sheet.MOST_ELEMENTS - sheet.MOST_TEXTS - 3)
    drawn = f"{head}{texts}{path}{rects}</svg>"
    assert len(drawn) < LONGEST_SHEET
    return drawn


def long_letters() -> str:
    """Return a chart sheet with one text of a million characters."""
    head = '<svg xmlns="http://www.w3.org/2000/svg" width="180mm" height="90mm" viewBox="0 0 900 450">'
    return f"{head}<text>{'a' * 1_000_000}</text></svg>"


def costly_requests() -> dict[str, list[Request]]:
    """Return the requests of each attack by name."""
    check = "/api/experiments/check"
    preview = "/api/tuning/preview?lam_q=0.5&lam_S=0.5&printed=true"
    return {
        "texts that hold the interpreter": [("POST", check, {"text": json.dumps(text_of(HOLDING)), "play": False})],
        "texts of 100 000 characters": [("POST", check, {"text": long_text(), "play": False})],
        "imported runs that hold the interpreter": [("GET", f"/api/runs/{_RUN}/planned", None)],
        "sheets of a million letters": [("POST", "/api/chart-sheet.pdf", {"svg": long_letters()})],
        "sheets at their bounds": [("POST", "/api/chart-sheet.pdf", {"svg": largest_sheet()})],
        "previews of the tuning": [("GET", preview, None)],
        "previews at 10 s": [("GET", preview.replace("=0.5", "=10"), None)],
        "predictions": [("POST", "/api/identifications/prediction", LONGEST_PREDICTION)],
        "bodies of unknown names": [("PUT", "/api/preferences", {f"a{number}": 1 for number in range(20_000)})],
    }


def store_costly_run(data: Path) -> int:
    """Store a run with a plan that blocks the interpreter, as if imported from an earlier version."""
    database = open_database(data)
    written = json.dumps(text_of(HOLDING))
    new = NewRun(
        RunKind.EXPERIMENT,
        "simulator",
        "lab",
        load_parameters("lab").to_document(),
        "Ana",
        "1.0.0",
        {"plan": {"experiment": written}},
    )
    with database.session() as session:
        run = runs.create(session, new)
        runs.end(session, run.id, EndState.COMPLETED, "")
    database.close()
    return run.id


def ask(signals: Signals, url: str, tokens: list[str], wanted: list[Request], connections: int) -> None:
    """Repeat requests. ``now`` counts waiting requests, ``ever`` responses, ``failed`` status 500 and lost ones."""
    asyncio.run(_ask_all(signals, url, tokens, wanted, connections))


async def _ask_all(signals: Signals, url: str, tokens: list[str], wanted: list[Request], connections: int) -> None:
    each = [(token, one) for token in tokens for one in wanted * connections]
    asking = [
        asyncio.create_task(_ask(signals, url, token, one, APART_S * number))
        for number, (token, one) in enumerate(each)
    ]
    while not signals.over.is_set():
        await asyncio.sleep(0.05)
        if signals.ever.value > 0:  # its process exists
            signals.there.set()
    for task in asking:
        task.cancel()
    await asyncio.gather(*asking, return_exceptions=True)


async def _ask(signals: Signals, url: str, token: str, wanted: Request, begins_s: float) -> None:
    await asyncio.sleep(begins_s)
    method, path, body = wanted
    content = None if body is None else json.dumps(body)
    headers = {"Authorization": f"Bearer {token}", "Content-Type": "application/json"}
    async with httpx.AsyncClient(base_url=url, headers=headers, timeout=120.0) as client:
        while True:
            signals.now.value += 1
            try:
                answer = await client.request(method, path, content=content)
                signals.ever.value += 1
                signals.failed.value += answer.status_code == 500
                if answer.status_code == 429:
                    await asyncio.sleep(0.2)
            except httpx.HTTPError as error:
                signals.failed.value += 1
                print(f"{method} {path[:80]}: {type(error).__name__}: {error}", flush=True)
                await asyncio.sleep(0.2)
            finally:
                signals.now.value -= 1


def under_costly_requests(presses: int, console: Console) -> bool:
    """Press STOP ``presses`` times under each costly request, then under all, from viewers and operators."""
    whole = True
    with tempfile.TemporaryDirectory() as folder:
        run = store_costly_run(Path(folder))
        with bench_on(Path(folder)) as bench:
            loop = Loop(bench.service.pid)
            tokens = [(bench.service.data / name).read_text("ascii").strip() for name in ("token", "viewer-token")]
            wanted = costly_requests()
            for name, requests in {**wanted, "all of them": [one for all_ in wanted.values() for one in all_]}.items():
                tally = Tally(f"STOP under {name}", console)
                buttons = [
                    StopButton(bench, f"at the button, {role}", token)
                    for role, token in zip(ROLES, tokens, strict=True)
                ]
                here = [
                    (method, path.replace(_RUN + "/planned", f"{run}/planned"), body) for method, path, body in requests
                ]
                connections = min(CONNECTIONS, max(1, MOST // (len(tokens) * len(here))))
                crowd: Crowd = (ask, (bench.service.url, tokens, here, connections))
                with running_clients(crowd) as (signals,):
                    for turn in range(presses):
                        wind_up(bench, loop)
                        role = turn % len(ROLES)
                        what = f"STOP as {ROLES[role]}"
                        stop_and_check(buttons[role], loop, tally, fresh=turn // 2 % 2 == 1, what=what)
                    tally.note(f"{signals.ever.value} answers, {signals.failed.value} failed")
                    tally.lost(signals.failed.value > 0, f"{signals.failed.value} requests failed")
                for button in buttons:
                    button.release()
                whole &= tally.close()
            loop.close()
    return whole
