"""NI's device service without a network: a channel whose calls are calls, and its errors as the server sends them."""

from collections.abc import Callable
from typing import Any, NamedTuple, Protocol

import grpc
from nidaqmx.error_codes import DAQmxErrors


class _Entry(NamedTuple):
    key: str
    value: str


class CardError(grpc.RpcError):  # type: ignore[misc]  # grpcio has no types
    """An error of NI-DAQmx, as the device server sends it."""

    def __init__(self, code: DAQmxErrors, text: str) -> None:
        super().__init__(text)
        self._code, self._text = code, text

    def code(self) -> grpc.StatusCode:
        """Return what gRPC calls it."""
        return grpc.StatusCode.UNKNOWN

    def details(self) -> str:
        """Return it in words."""
        return self._text

    def trailing_metadata(self) -> tuple[_Entry, ...]:
        """Return the code of NI-DAQmx, where the client looks for it."""
        return (_Entry("ni-error", str(self._code.value)),)


class Answering(Protocol):
    """A service of NI's: every call goes through here."""

    def answering(self, method: str) -> Callable[..., Any]:
        """Return what answers a call of this name, given its request. It raises grpc.RpcError."""
        ...


class InProcess(grpc.Channel):  # type: ignore[misc]  # grpcio has no types
    """A channel whose calls are calls: over a socket a cycle takes 1 ms, more than a period."""

    def __init__(self, service: Answering) -> None:
        self._service = service

    def unary_unary(self, method: str, *_: Any, **__: Any) -> Callable[..., Any]:
        """Return what answers the call: looked up here, once, and not in each tick."""
        return self._service.answering(method.rpartition("/")[2])

    def unary_stream(self, *_: Any, **__: Any) -> None:
        """Not used by the client's tasks."""

    stream_unary = stream_stream = unary_stream

    def subscribe(self, *_: Any, **__: Any) -> None:
        """Do nothing: it is always connected."""

    unsubscribe = subscribe

    def close(self) -> None:
        """Nothing to close."""

    def __enter__(self) -> "InProcess":
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


class UnknownCallError(grpc.RpcError):  # type: ignore[misc]  # grpcio has no types
    """What a server says that does not know a call."""

    def code(self) -> grpc.StatusCode:
        """Return what gRPC calls it."""
        return grpc.StatusCode.UNIMPLEMENTED

    def details(self) -> str:
        """Return it in words."""
        return "the virtual card does not know this call"

    def trailing_metadata(self) -> tuple[()]:
        """Return nothing: there is no code of NI-DAQmx."""
        return ()


class Context:
    """As much of a server's context as the stubs of unknown calls touch."""

    def set_code(self, code: grpc.StatusCode) -> None:
        """Take note of nothing."""

    def set_details(self, details: str) -> None:
        """Take note of nothing."""
