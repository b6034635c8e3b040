"""viser without a network: its page and its connections."""

import asyncio
import os
import re
import threading
import time
from collections.abc import Awaitable, Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest
import viser
from numpy.typing import NDArray
from viser.infra import _messages

from backend.sample import FIELDS, INDEX
from backend.scene.messages import viewer_opens_port, viewer_thread_ended
from backend.scene.model import SCENE_PART, SceneMirror
from backend.scene.proxy import POLICY, page
from backend.scene.server import PortlessServer, SceneEndedError
from backend.supervision import Supervision
from plant.parameters import load_parameters
from tests.api.processes import children, held

# viser's page as the dashboard serves it.


def test_the_page_is_one_file_that_reconnects_without_focus() -> None:
    html = page()
    assert html.index("document.hasFocus = () => true") < html.index("</head>")
    assert 'src="http' not in html


@pytest.mark.parametrize("directive", ["default-src 'none'", "connect-src 'self'", "frame-ancestors 'self'"])
def test_the_page_cannot_load_external_resources(directive: str) -> None:
    assert directive in POLICY
    assert "http" not in POLICY


def test_the_view_of_the_camera_stays_in_the_address() -> None:
    assert 'name.startsWith("initialCamera")' in page()


def test_the_dashboard_has_texts_for_all_reported_stages() -> None:
    reported = set(re.findall(r'tell\("(\w+)"\)', page()))
    source = (Path(__file__).parents[2] / "frontend" / "src" / "components" / "SceneFrame.tsx").read_text()
    (known,) = re.findall(r"const STAGES = \[(.*?)\]", source)
    assert reported == set(re.findall(r"\w+", known))


# viser without a network: who is handed to it is served as viser serves a browser, and nothing else gets near it.

TIMEOUT_S = 20.0


def swinging() -> NDArray[np.float64]:
    row = np.zeros(len(FIELDS))
    row[INDEX["q"]] = np.sin(3.0 * time.monotonic())
    row[INDEX["S"]] = 10.0
    return row


@contextmanager
def running_mirror() -> Iterator[SceneMirror]:
    mirror = SceneMirror(load_parameters("ideal"), swinging)
    thread = threading.Thread(target=mirror.run)
    thread.start()
    yield mirror
    mirror.end()
    thread.join()
    mirror.close()


@pytest.fixture(scope="module")
def scene() -> Iterator[SceneMirror]:
    with running_mirror() as mirror:
        yield mirror


class Viewer:
    """Accepts the messages sent to it, while it may."""

    def __init__(self) -> None:
        self.messages: list[bytes] = []
        self.may = asyncio.Event()
        self.may.set()

    async def take(self, message: bytes) -> None:
        await self.may.wait()
        self.messages.append(message)


def run(session: Callable[[], Awaitable[None]]) -> None:
    async def whole() -> None:
        await asyncio.wait_for(session(), TIMEOUT_S)

    asyncio.run(whole())


async def until(reached: Callable[[], bool]) -> None:
    while not reached():
        await asyncio.sleep(0.005)


def sockets() -> set[str]:
    """Sockets of this process except the pairs by which event loops wake themselves."""
    return {link for link in held(os.getpid()) if link.startswith(("listening ", "connected tcp"))}


def test_no_socket_is_opened_for_any_environment(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("_VISER_PORT_OVERRIDE", "8080")
    before = sockets()
    server = PortlessServer()
    assert server.is_alive
    assert sockets() == before
    server.stop()
    assert not server.is_alive


def test_viewers_receive_the_whole_scene_first_and_then_the_moving_parts(scene: SceneMirror) -> None:
    async def session() -> None:
        viewer = Viewer()
        looking = asyncio.create_task(scene.show(viewer.take))
        await until(lambda: len(viewer.messages) > 30)
        assert sum(map(len, viewer.messages[:4])) > 1_000_000
        assert max(map(len, viewer.messages[10:])) < 20_000
        looking.cancel()
        await until(lambda: scene.server.viewers == 0)

    run(session)


def test_a_slow_viewer_gets_the_newest_state_and_delays_no_other_viewer(scene: SceneMirror) -> None:
    async def session() -> None:
        slow, quick = Viewer(), Viewer()
        looking = [asyncio.create_task(scene.show(viewer.take)) for viewer in (slow, quick)]
        await until(lambda: len(slow.messages) > 10)
        slow.may.clear()
        taken, count = len(slow.messages), len(quick.messages)
        await until(lambda: len(quick.messages) > count + 60)
        assert len(slow.messages) == taken
        slow.may.set()
        await until(lambda: len(slow.messages) > taken + 5)
        # What moved sixty times meanwhile is sent once, in a message or two, not in sixty.
        assert sum(map(len, slow.messages[taken : taken + 5])) < 60_000
        for task in looking:
            task.cancel()
        await until(lambda: scene.server.viewers == 0)

    run(session)


def test_a_failed_viewer_is_reported_and_removed(scene: SceneMirror) -> None:
    async def fail(_message: bytes) -> None:
        raise ConnectionResetError("the cable is out")

    async def session() -> None:
        with pytest.raises(ConnectionResetError, match="the cable is out"):
            await scene.show(fail)
        await until(lambda: scene.server.viewers == 0)

    run(session)


def test_the_end_of_the_server_disconnects_its_viewers() -> None:
    async def session() -> None:
        server, viewer = PortlessServer(), Viewer()
        looking = asyncio.create_task(server.show(viewer.take))
        await until(lambda: len(viewer.messages) > 0)
        await asyncio.to_thread(server.stop)
        done, _ = await asyncio.wait([looking])
        assert done == {looking}
        assert server.viewers == 0
        with pytest.raises(SceneEndedError):
            await server.show(viewer.take)

    run(session)


@pytest.mark.filterwarnings("ignore::pytest.PytestUnhandledThreadExceptionWarning")
def test_a_dead_viser_thread_is_reported_and_the_scene_is_rebuilt() -> None:
    async def session() -> None:
        supervision, viewer = Supervision(), Viewer()
        mirror = SceneMirror(load_parameters("ideal"), swinging)
        kept = supervision.start_thread(SCENE_PART, mirror.run, mirror.end)
        looking = asyncio.create_task(mirror.show(viewer.take))
        await until(lambda: len(viewer.messages) > 10)
        died = mirror.server._event_loop
        died.call_soon_threadsafe(died.stop)
        done, _ = await asyncio.wait([looking])
        assert done == {looking}
        await until(lambda: len(supervision.problems) == 1)
        assert viewer_thread_ended() in supervision.problems[0]
        await until(lambda: mirror.server._event_loop is not died)
        viewer.messages.clear()
        looking = asyncio.create_task(mirror.show(viewer.take))
        await until(lambda: len(viewer.messages) > 10)
        looking.cancel()
        await asyncio.to_thread(kept.end)
        await asyncio.to_thread(mirror.close)
        await supervision.close()

    run(session)


def test_a_scene_that_never_starts_blocks_no_thread(monkeypatch: pytest.MonkeyPatch) -> None:
    """Viewers are rejected, and the shared threads stay free."""

    async def session() -> None:
        mirror = SceneMirror(load_parameters("ideal"), swinging)
        left = [asyncio.create_task(mirror.show(Viewer().take)) for _ in range(100)]
        await asyncio.sleep(0.0)
        for task in left[:50]:
            task.cancel()
        assert await asyncio.wait_for(asyncio.to_thread(lambda: True), TIMEOUT_S)
        ended = await asyncio.gather(*left, return_exceptions=True)
        assert {type(error) for error in ended[:50]} == {asyncio.CancelledError}
        assert {type(error) for error in ended[50:]} == {SceneEndedError}

    monkeypatch.setattr("backend.scene.model.UP_WITHIN_S", 0.2)
    run(session)


def test_no_browser_request_has_a_handler(scene: SceneMirror) -> None:
    server = scene.server
    assert server._websock_server._incoming_handlers == {}
    before = children(os.getpid())
    assert server.request_share_url() is None
    server.disconnect_share_url()
    assert children(os.getpid()) == before


def test_a_viser_version_that_opens_a_socket_is_rejected(monkeypatch: pytest.MonkeyPatch) -> None:
    """Here the interception is disabled: viser's worker finds the real ``serve``, as in a later version."""
    import websockets
    from viser.infra import WebsockServer, _infra

    begin = WebsockServer.start

    def begin_by_itself(server: WebsockServer) -> None:
        vars(_infra)["websockets"] = websockets
        server._host = "127.0.0.1"
        begin(server)

    monkeypatch.setattr(WebsockServer, "start", begin_by_itself)
    before = sockets()
    with pytest.raises(RuntimeError, match=re.escape(viewer_opens_port(version=viser.__version__))):
        PortlessServer()
    assert sockets() == before


def test_viser_has_the_messages_that_the_attack_tests_use() -> None:
    """If viser renames them, the attack tests against the service must follow."""
    names = {kind.__name__ for kind in _messages.Message.get_subclasses()}
    assert {"ShareUrlRequest", "ShareUrlDisconnect", "FileTransferStartUpload", "ViewerCameraMessage"} <= names
