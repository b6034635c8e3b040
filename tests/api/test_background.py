"""The complete service in this process, so that each of its tasks and threads can be killed."""

import asyncio
import ctypes
import threading
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from types import CodeType, CoroutineType
from typing import TypeVar

import httpx
import pytest
import uvicorn

from backend import main
from backend.realtime.heartbeat import HeartbeatSender
from backend.settings import Settings
from backend.supervision import SupervisedTask
from tests.api.conftest import PATIENCE_S, ended, until, wait_for

T = TypeVar("T")
TIMEOUT_S = 60.0
OWN = str(Path(main.__file__).parent)
TASKS = {
    "The monitor of lost pages",
    "The live stream",
    "The event log",
    "The flight recorder",
    "The monitor of the control loop",
    "The liveness signal to the control loop",
}
HEARTBEAT = "The heartbeat to the control loop"
THREADS = {"The recorder", "A 3D view", HEARTBEAT, "The renewal of the database claim"}
FOREIGN_THREADS = ("MainThread", "the service", "asyncio", "ThreadPoolExecutor", "QueueFeederThread", "Thread-")
"""Tasks and threads of this test, of awaited calls and of libraries."""


class CreatedObjects:
    """Objects of some classes that the service creates.

    They are not taken from the garbage collector: a reader of its objects in another thread may hold a tuple that is
    still being built, and its builder then fails with a bad argument.
    """

    def __init__(self, patch: pytest.MonkeyPatch, *kinds: type) -> None:
        self._made: list[object] = []
        for kind in kinds:
            patch.setattr(kind, "__init__", self._kept(vars(kind)["__init__"]))

    def of(self, kind: type[T]) -> list[T]:
        return [made for made in self._made if isinstance(made, kind)]

    def _kept(self, begin: Callable[..., None]) -> Callable[..., None]:
        def begun(made: object, *args: object, **named: object) -> None:
            begin(made, *args, **named)
            self._made.append(made)

        return begun


def kill(thread: threading.Thread) -> None:
    """Raise an unexpected exception in a thread at its next step in Python."""
    ctypes.pythonapi.PyThreadState_SetAsyncExc(ctypes.c_ulong(thread.ident or 0), ctypes.py_object(SystemExit))


@dataclass(frozen=True)
class Running:
    loop: asyncio.AbstractEventLoop
    client: httpx.Client
    made: CreatedObjects

    def call(self, work: Callable[[], T]) -> T:
        """Call ``work`` in the service's event loop."""

        async def called() -> T:
            return work()

        return asyncio.run_coroutine_threadsafe(called(), self.loop).result(TIMEOUT_S)

    def tasks(self) -> dict[str, "asyncio.Task[object]"]:
        return self.call(lambda: {task.get_name(): task for task in asyncio.all_tasks()})

    def problems(self) -> list[str]:
        return list(self.client.get("/api/state").raise_for_status().json()["problems"])

    def read_problem(self, name: str) -> str:
        return until(lambda: next((text for text in self.problems() if text.startswith(f"{name} failed")), ""))


@pytest.fixture(scope="module")
def inside(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Running]:
    ready: list[tuple[str, asyncio.AbstractEventLoop, str]] = []

    def announce(address: str, tokens: object) -> None:
        ready.append((address, asyncio.get_running_loop(), getattr(tokens, "operator", "")))

    settings = Settings(data=tmp_path_factory.mktemp("inside"), params="ideal", port=0)
    serving = threading.Thread(target=main.serve, args=(settings, announce), name="the service")
    with pytest.MonkeyPatch.context() as patch:
        made = CreatedObjects(patch, SupervisedTask, HeartbeatSender, uvicorn.Server)
        serving.start()
        until(lambda: ready or not serving.is_alive())
        address, loop, token = ready[0]
        with httpx.Client(base_url=address, headers={"Authorization": f"Bearer {token}"}, timeout=PATIENCE_S) as client:
            yield Running(loop, client, made)
        (server,) = made.of(uvicorn.Server)
        server.should_exit = True
        serving.join(TIMEOUT_S)
    assert not serving.is_alive()


@pytest.fixture
def moving(inside: Running) -> Running:
    """The service in pretension, so that a stop is visible."""
    inside.client.post("/api/stop").raise_for_status()
    inside.client.post("/api/reset").raise_for_status()
    inside.client.post("/api/mode", json={"mode": "pretension"}).raise_for_status()
    wait_for(inside.client, "mode", "pretension")
    return inside


def test_every_task_and_thread_is_supervised(inside: Running) -> None:
    """Add a new task or thread to the supervision or to the lists of this file."""
    tasks = inside.tasks()
    assert set(tasks) >= TASKS
    supervised = {supervised._task for supervised in inside.made.of(SupervisedTask)}
    own = {name for name, task in tasks.items() if OWN in code_of(task).co_filename and task not in supervised}
    assert {code_of(tasks[name]).co_name for name in own} == {"_serve"}  # asyncio.run's own: its end ends the service
    threads = {thread.name for thread in threading.enumerate()}
    assert threads >= THREADS
    threads.discard(main.LIBRARIES_PART.name)  # until they are loaded
    assert {name for name in threads if not name.startswith(FOREIGN_THREADS)} == THREADS


def code_of(task: "asyncio.Task[object]") -> CodeType:
    coroutine = task.get_coro()
    assert isinstance(coroutine, CoroutineType)
    return coroutine.cr_code


def test_each_killed_task_is_reported_and_restarted(inside: Running) -> None:
    supervised = {supervised._task for supervised in inside.made.of(SupervisedTask)}
    victims = {name: task for name, task in inside.tasks().items() if task in supervised}
    assert set(victims) >= TASKS
    for victim in victims.values():
        inside.call(victim.cancel)
    for name, victim in victims.items():
        assert "it was cancelled" in inside.read_problem(name)
        until(lambda name=name, victim=victim: inside.tasks().get(name, victim) is not victim)  # type: ignore[misc] # defaults bind the loop's names
        until(lambda name=name: "was restarted" in inside.read_problem(name))  # type: ignore[misc] # defaults bind the loop's names
    assert inside.client.get("/api/health").json()["alive"]


@pytest.mark.parametrize("name", ["The recorder", "A 3D view"])
def test_a_killed_thread_is_reported_and_restarted(inside: Running, name: str) -> None:
    victims = {thread for thread in threading.enumerate() if thread.name == name}
    for thread in victims:
        kill(thread)
    assert "SystemExit" in inside.read_problem(name)

    def again() -> bool:
        present = {thread for thread in threading.enumerate() if thread.name == name}
        return len(present) == len(victims) and not present & victims

    until(again)


def test_death_of_the_page_monitor_causes_a_soft_stop(moving: Running) -> None:
    moving.call(moving.tasks()["The monitor of lost pages"].cancel)
    state = wait_for(moving.client, "mode", "tripped")
    assert isinstance(state["fault"], dict)
    assert state["fault"]["code"] == "operator_lost"


def test_the_loop_stops_if_the_heartbeat_task_keeps_dying(moving: Running) -> None:
    def stop_beating() -> bool:
        for heart in moving.made.of(HeartbeatSender):
            heart._words[0] = 1  # ends a thread of compiled code
        return bool(moving.client.get("/api/state").json()["mode"] == "tripped")

    until(stop_beating)
    state = moving.client.get("/api/state").json()
    assert state["fault"]["code"] == "service_lost"
    assert "ended without a request" in moving.read_problem(HEARTBEAT)
    # otherwise the restarted loop stops too
    until(lambda: "was restarted" in moving.read_problem(HEARTBEAT))
    until(lambda: moving.client.post("/api/reset").is_success)
    assert wait_for(moving.client, "mode", "off")


def test_an_experiment_without_its_task_is_stopped_and_reported(moving: Running) -> None:
    segments = '[{"duration_s": 60, "q_ref": 0.1, "S_ref": 10}]'
    body = {"name": "sequence", "settings": {"segments": segments}}
    run = moving.client.post("/api/experiments", json=body).raise_for_status().json()["id"]
    wait_for(moving.client, "mode", "experiment")
    for task in moving.tasks().values():
        if "_run_all" in str(task.get_coro()):
            moving.call(task.cancel)
    wait_for(moving.client, "mode", "tripped")
    state = wait_for(moving.client, "task", None)
    assert any(f"run {run}" in text.lower() for text in state["problems"])
    assert moving.client.get(f"/api/runs/{run}").json()["end_state"] == "service_died"


def test_a_trial_reverts_although_its_timer_task_is_killed(inside: Running) -> None:
    inside.client.post("/api/stop").raise_for_status()
    inside.client.post("/api/reset").raise_for_status()
    before = inside.client.get("/api/tuning").json()["lam_q"]
    inside.client.post("/api/tuning/trial", json={"lam_q": before + 0.1, "duration_s": 5.0}).raise_for_status()
    inside.call(inside.tasks()["The timer of a tuning trial"].cancel)
    wait_for(inside.client, "trial", None)
    assert inside.client.get("/api/tuning").json()["lam_q"] == before


def test_a_run_lacks_no_sample_after_a_restart_of_the_recorder(moving: Running) -> None:
    until(lambda: moving.client.get("/api/state").json()["pretension_done"])
    moving.client.post("/api/mode", json={"mode": "run"}).raise_for_status()
    state = wait_for(moving.client, "mode", "run")
    run = until(lambda: moving.client.get("/api/state").json()["recording_run"])
    (recording,) = (thread for thread in threading.enumerate() if thread.name == "The recorder")
    kill(recording)
    until(lambda: any(thread.name == "The recorder" and thread is not recording for thread in threading.enumerate()))
    until(lambda: int(str(moving.client.get("/api/state").json()["tick"])) > int(str(state["tick"])) + 2000)
    moving.client.post("/api/stop").raise_for_status()
    view = ended(moving.client, run)
    assert view["missing_samples"] == 0
    assert int(str(view["samples"])) > 1000
