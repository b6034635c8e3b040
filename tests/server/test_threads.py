"""Plain routes run in a few threads and do not delay pages and coroutine routes."""

import asyncio
import threading
from inspect import iscoroutinefunction
from pathlib import Path

import httpx
from fastapi import APIRouter, FastAPI
from fastapi.staticfiles import StaticFiles

from backend.api import dependencies
from backend.server.threads import THREADS, ThreadRoute
from tests.docs.test_security import calls, routes


async def _request_both(application: FastAPI, count: int, release: threading.Event) -> tuple[list[int], list[int]]:
    transport = httpx.ASGITransport(application)
    async with httpx.AsyncClient(transport=transport, base_url="http://here", timeout=60.0) as client:
        slow = [asyncio.create_task(client.get("/slow")) for _ in range(count)]
        try:
            async with asyncio.timeout(30.0):
                quick = [await client.get(path) for path in ("/quick", "/page.html", "/quick")]
        finally:
            release.set()
        return [one.status_code for one in quick], [one.status_code for one in await asyncio.gather(*slow)]


def test_routes_in_threads_do_not_block_other_requests(tmp_path: Path) -> None:
    (tmp_path / "page.html").write_text("page")
    release, counting, active, most = threading.Event(), threading.Lock(), 0, 0
    router = APIRouter(route_class=ThreadRoute)

    @router.get("/slow")
    def slow() -> str:
        nonlocal active, most
        with counting:
            active += 1
            most = max(most, active)
        assert release.wait(60.0)
        with counting:
            active -= 1
        return threading.current_thread().name

    @router.get("/quick")
    async def quick() -> str:
        return threading.current_thread().name

    application = FastAPI()
    application.include_router(router)
    application.mount("/", StaticFiles(directory=tmp_path))
    quick_statuses, slow_statuses = asyncio.run(_request_both(application, 50, release))
    assert (quick_statuses, slow_statuses) == ([200] * 3, [200] * 50)
    assert most == THREADS


def test_plain_routes_use_ThreadRoute_and_commands_are_coroutines() -> None:
    commands = {dependencies._get_control_holder, dependencies._get_stop_requester}
    for route in routes():
        assert iscoroutinefunction(route.endpoint), f"{route.path}: its router is without ThreadRoute"
        if calls(route.dependant) & commands:
            assert not hasattr(route.endpoint, "__wrapped__"), f"{route.path} commands: it has to be a coroutine"
