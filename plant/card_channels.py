"""Which task owns which channel of the virtual card: what is taken, or not there, is refused as NI-DAQmx does."""

from typing import Any

import session_pb2
from nidaqmx._stubs import nidaqmx_pb2 as pb
from nidaqmx._stubs import nidaqmx_pb2_grpc
from nidaqmx.error_codes import DAQmxErrors

from plant.in_process import CardError


class Channels(dict[str, list[str]]):
    """Channels of one card by the name of their task, in the order in which they were taken."""

    def __init__(self, device: str) -> None:
        super().__init__()
        self._device = device
        self._owner: dict[str, str] = {}

    def make(self, task: str) -> None:
        """Make a task without channels. Raises CardError where its name is taken."""
        if task in self:
            raise CardError(DAQmxErrors.DUPLICATE_TASK, f"Task name: {task} is taken already")
        self[task] = []

    def let_go(self, task: str) -> None:
        """Let go of a task and its channels."""
        for channel in self.pop(task, []):
            self._owner.pop(channel, None)

    def take(self, task: str, names: str, kind: str, count: int) -> None:
        """Give channels to a task; ``count`` is how many of this ``kind`` the card has. Raises CardError."""
        for name in names.replace(" ", "").split(","):
            device, _, channel = name.partition("/")
            self.require_device(device)
            number = "".join(filter(str.isdigit, channel.rpartition("/")[2]))
            if not channel.startswith(kind) or not number or int(number) >= count:
                raise CardError(
                    DAQmxErrors.PHYSICAL_CHAN_DOES_NOT_EXIST,
                    f"Physical channel specified does not exist on this device: {channel} of {device}",
                )
            if self._owner.setdefault(channel, task) != task:
                raise CardError(
                    DAQmxErrors.PAL_RESOURCE_RESERVED,
                    f"The specified resource is reserved: {channel} belongs to the task {self._owner[channel]}",
                )
            self[task].append(channel)

    def require_device(self, device: str) -> None:
        """Raise CardError for a card of another name."""
        if device != self._device:
            raise CardError(DAQmxErrors.INVALID_DEVICE_ID, f"Device identifier is invalid: {device}")


class TaskCalls(nidaqmx_pb2_grpc.NiDAQmxServicer):  # type: ignore[misc]  # made by a generator, without types
    """The calls of NI's service that make a task and give it channels."""

    def __init__(self, device: str) -> None:
        self._channels = Channels(device)

    def CreateTask(self, request: Any, context: Any) -> Any:
        """Make a task; its name is free."""
        self._channels.make(request.session_name)
        return pb.CreateTaskResponse(task=session_pb2.Session(name=request.session_name), new_session_initialized=True)

    def GetTaskAttributeString(self, request: Any, context: Any) -> Any:
        """Tell a task's name."""
        return pb.GetTaskAttributeStringResponse(value=request.task.name)

    def CreateAIVoltageChan(self, request: Any, context: Any) -> Any:
        """Take analog inputs."""
        self._channels.take(request.task.name, request.physical_channel, "ai", 32)
        return pb.CreateAIVoltageChanResponse()

    def CreateAOVoltageChan(self, request: Any, context: Any) -> Any:
        """Take analog outputs."""
        self._channels.take(request.task.name, request.physical_channel, "ao", 4)
        return pb.CreateAOVoltageChanResponse()

    def CreateCIAngEncoderChan(self, request: Any, context: Any) -> Any:
        """Take a counter."""
        self._channels.take(request.task.name, request.counter, "ctr", 4)
        return pb.CreateCIAngEncoderChanResponse()

    def CreateDIChan(self, request: Any, context: Any) -> Any:
        """Take lines to read."""
        self._channels.take(request.task.name, request.lines, "port", 48)
        return pb.CreateDIChanResponse()

    def CreateDOChan(self, request: Any, context: Any) -> Any:
        """Take lines to write."""
        self._channels.take(request.task.name, request.lines, "port", 48)
        return pb.CreateDOChanResponse()
