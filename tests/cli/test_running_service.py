"""What answers where a service is expected may be anything: a command says so in one line."""

import socket
import time
from collections.abc import Callable
from pathlib import Path
from threading import Thread

import pytest

from backend import main
from backend.cli import server as serve
from backend.cli.options import RunningService
from backend.schemas.experiment import QueuePlace

OK, REFUSED = b"HTTP/1.1 200 OK\r\nConnection: close\r\n\r\n", b"HTTP/1.1 409 Conflict\r\nConnection: close\r\n\r\n"


def answer(said: bytes) -> object:
    """Ask a server that gives this answer to whoever comes."""
    with socket.create_server(("127.0.0.1", 0)) as server:

        def serve() -> None:
            connection, _ = server.accept()
            with connection:
                connection.recv(10_000)
                connection.sendall(said)

        thread = Thread(target=serve)
        thread.start()
        try:
            return RunningService(f"http://127.0.0.1:{server.getsockname()[1]}", "").request(
                "GET", "/place", None, QueuePlace
            )
        finally:
            thread.join(10)


@pytest.mark.parametrize(
    ("said", "why"),
    [
        (b"SSH-2.0-OpenSSH\r\n", "does not answer"),
        (b"", "does not answer"),
        (OK + b"<html>", "is no Sinew: status 200"),
        (REFUSED + b'{"detail": "no"}', "is no Sinew: status 409"),
        (REFUSED + b"[]", "is no Sinew: status 409"),
        (REFUSED, "is no Sinew: status 409"),
        (OK + b'{"place": "behind"}', "is no Sinew: status 200"),
        (OK + b'{"place": 3, "mode": "off"}', "is no Sinew: status 200"),
        (REFUSED + b'{"error": {"code": "busy", "message": "busy now"}}', "sinew: busy now"),
    ],
)
def test_whatever_answers_a_command_ends_in_a_sentence(
    said: bytes, why: str, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit):
        answer(said)
    assert why in capsys.readouterr().err


def test_an_answer_is_read() -> None:
    assert answer(OK + b'{"place": 3}') == QueuePlace(place=3)


def test_a_slow_start_says_so_and_a_quick_one_nothing(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    starts = iter((0.3, 0.0))

    def start(_settings: object, ready: Callable[[str, None], None]) -> None:
        time.sleep(next(starts))
        ready("http://127.0.0.1:8000", None)

    monkeypatch.setattr(main, "serve", start)
    monkeypatch.setattr(serve, "NOTICE_DELAY_S", 0.05)
    told = []
    for _ in range(2):
        serve.serve(plant="simulator", data=tmp_path)
        told.append(serve.STARTING_NOTICE in capsys.readouterr().out)
    assert told == [True, False]
