"""A virtual card behind a real gRPC server on this machine, in place of NI's device server."""

import threading
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from typing import Any

import grpc
from nidaqmx._stubs import nidaqmx_pb2 as pb

from plant.virtual_daq import CardError, UnknownCallError, VirtualCard


class _Service(grpc.GenericRpcHandler):  # type: ignore[misc]  # gRPC has no types
    """Answers each call by the card's own, ``delay_s`` later."""

    def __init__(self, card: VirtualCard, delay_s: float) -> None:
        self._card = card
        self._delay_s = delay_s

    def service(self, details: Any) -> Any:
        name = details.method.rpartition("/")[2]
        return grpc.unary_unary_rpc_method_handler(
            self._answering(name),
            request_deserializer=getattr(pb, f"{name}Request").FromString,
            response_serializer=lambda answer: answer.SerializeToString(),
        )

    def _answering(self, name: str) -> Callable[[Any, Any], Any]:
        answering = self._card.get_handler(name)

        def answer(request: Any, context: Any) -> Any:
            time.sleep(self._delay_s)
            try:
                return answering(request)
            except (CardError, UnknownCallError) as error:
                context.set_trailing_metadata(tuple((entry.key, entry.value) for entry in error.trailing_metadata()))
                context.abort(error.code(), error.details())

        return answer


@contextmanager
def served(card: VirtualCard, delay_s: float = 0.0) -> Iterator[str]:
    """Serve a card on a free port; yields HOST:PORT."""
    server = grpc.server(ThreadPoolExecutor(1), handlers=[_Service(card, delay_s)])
    port = server.add_insecure_port("127.0.0.1:0")
    server.start()
    try:
        yield f"127.0.0.1:{port}"
    finally:
        ended: threading.Event = server.stop(0)
        ended.wait()
