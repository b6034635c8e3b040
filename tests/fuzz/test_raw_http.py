"""Invalid bytes on the port of the service: refused or closed, no server error, no hanging connection."""

import random
import re
import select
import socket
import time

from tests.fuzz import junk
from tests.fuzz.conftest import EXAMPLES, SEED
from tests.fuzz.target import Target

REQUESTS = 50 * EXAMPLES
AT_ONCE = 20
LISTEN_S = 0.5
"""How long to listen to a batch of requests; those cut short get no answer before they are hung up on."""

STATUS = re.compile(rb"HTTP/1\.[01] (\d{3}) ")


def test_malformed_requests_cause_no_server_error(target: Target) -> None:
    dice = random.Random(SEED)
    for _ in range(REQUESTS // AT_ONCE):
        sent = [junk.request(dice) for _ in range(AT_ONCE)]
        for request, answer in zip(sent, exchange(target, sent), strict=True):
            statuses = [int(status) for status in STATUS.findall(answer)]
            target.answers["raw request", statuses[0] if statuses else 0] += 1
            assert max(statuses, default=0) < 500, (request[:2000], answer[:2000])


def test_pipelined_requests_are_answered_in_order(target: Target) -> None:
    host = target.service.url.removeprefix("http://")
    ask = f"GET /api/health HTTP/1.1\r\nHost: {host}\r\n\r\n".encode()
    last = f"GET /api/health HTTP/1.1\r\nHost: {host}\r\nConnection: close\r\n\r\n".encode()
    with target.connect() as connection:
        connection.sendall(ask * 40 + last)
        answer = b""
        while part := connection.recv(65536):
            answer += part
    assert [int(status) for status in STATUS.findall(answer)] == [200] * 41


def exchange(target: Target, requests: list[bytes], answered_within_s: float = 0.0) -> list[bytes]:
    """Send each request on its own connection, all at once; return the responses until silence or closing.

    Connections that must respond are read until they do, for at most ``answered_within_s``.
    """
    connections = [target.connect() for _ in requests]
    answers = dict.fromkeys(connections, b"")
    try:
        for connection, request in zip(connections, requests, strict=True):
            _send(connection, request)
        waiting, began = set(connections), time.monotonic()
        while waiting:
            silent = any(not answers[connection] for connection in waiting)
            left = (max(LISTEN_S, answered_within_s) if silent else LISTEN_S) - (time.monotonic() - began)
            if left <= 0:
                break
            for connection in select.select(waiting, [], [], left)[0]:
                if part := _receive(connection):
                    answers[connection] += part
                else:
                    waiting.discard(connection)
    finally:
        for connection in connections:
            connection.close()
    return [answers[connection] for connection in connections]


def _send(connection: socket.socket, request: bytes) -> None:
    try:
        connection.sendall(request)
    except OSError:
        return  # refused during the transfer, which is also a response


def _receive(connection: socket.socket) -> bytes:
    try:
        return connection.recv(65536)
    except OSError:
        return b""
