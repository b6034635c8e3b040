"""Connection to a card of another computer through NI's gRPC device server."""

import re

import grpc
from nidaqmx import GrpcSessionOptions, SessionInitializationBehavior

from plant import messages
from plant.interface import PlantError

CONNECTED_S = 3.0
"""Timeout of the first connection [s]."""

_ADDRESS = re.compile(r"(?:[\w.-]+|\[[0-9a-fA-F:]+\]):\d{1,5}")


class DeviceServer:
    """NI's device server at ``HOST:PORT``, without TLS: only for a private connection."""

    def __init__(self, address: str) -> None:
        self.address = address
        self._channel: grpc.Channel | None = None

    def options(self) -> GrpcSessionOptions:
        """Return the options of nidaqmx tasks on the server; connects at the first call.

        Raises PlantError. A task of the same name that another client has created is rejected, not shared.
        """
        if self._channel is None:
            self._channel = self._connect()
        return GrpcSessionOptions(
            self._channel,
            "",
            initialization_behavior=SessionInitializationBehavior.INITIALIZE_SERVER_SESSION,
        )

    def _connect(self) -> grpc.Channel:
        if _ADDRESS.fullmatch(self.address) is None:
            raise PlantError(messages.server_address_invalid(address=self.address))
        channel = grpc.insecure_channel(self.address)
        try:
            grpc.channel_ready_future(channel).result(CONNECTED_S)
        except grpc.FutureTimeoutError:
            channel.close()
            raise PlantError(messages.server_not_answering(address=self.address, within_s=CONNECTED_S)) from None
        return channel
