"""Which task owns which channel of the virtual card: what is taken, or not there, is refused as NI-DAQmx does."""

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
