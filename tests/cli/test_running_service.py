"""What answers where a service is expected may be anything: a command says so in one line."""

import socket
from threading import Thread

import pytest

from backend.cli.running_service import RunningService
from backend.messages.experiment import QueuePlace

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
            return RunningService(f"http://127.0.0.1:{server.getsockname()[1]}", "").ask(
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
