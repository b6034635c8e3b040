"""The loop without real time: for the command line, dry runs and tests."""

import asyncio
from collections.abc import Callable

from backend.realtime import messages
from backend.realtime.commands import Accepted, Command, Event, Refused
from backend.realtime.control_loop import Loop
from backend.realtime.program import BiasLost, ConfigureContactDetection, SetTuning
from backend.realtime.ring_buffer import Ring
from backend.realtime.supervisor import EventListener
from backend.realtime.timing import RealTimeStatus
from plant import Plant, PlantParameters, T_s

_BATCH_TICKS = 1000


class SimulatedLoop:
    """A ``LoopClient`` without clock, process or heartbeat.

    ``each_batch`` is called after at most 1000 ticks and at the end of each advance, to record or to show progress.
    ``has_bias``: the bias of the external force is calibrated.
    """

    def __init__(
        self,
        plant: Plant,
        parameters: PlantParameters,
        tuning: SetTuning,
        each_batch: Callable[[Ring], None] = lambda _ring: None,
    ) -> None:
        self.ring = Ring.create()
        self.granted: RealTimeStatus | None = None
        self._loop = Loop(plant, parameters, self.ring, tuning)
        self._each_batch = each_batch
        self._listeners: list[EventListener] = []
        self._sequence = 0
        self.has_bias = False

    def listen(self, listener: EventListener) -> Callable[[], None]:
        """Call ``listener`` with each event; return a function that removes it."""
        self._listeners.append(listener)
        return lambda: self._listeners.remove(listener)

    async def send(self, command: Command) -> Accepted | Refused:
        """Execute a command between two ticks and return the loop's reply."""
        self._sequence += 1
        self._loop.handle(self._sequence, command)
        answer = next(event for event in self._deliver() if isinstance(event, Accepted | Refused))
        if isinstance(command, ConfigureContactDetection) and isinstance(answer, Accepted):
            self.has_bias = len(command.bias) > 0
        return answer

    async def advance(self, seconds: float) -> None:
        """Step the loop for a duration of its time [s]."""
        left = round(seconds / T_s)
        while left > 0:
            batch = min(left, _BATCH_TICKS)
            left -= batch
            while batch > 0:
                batch -= self._loop.run(batch)
                self._deliver()
            await self._end_batch()

    async def advance_until(self, reached: Callable[[], bool], timeout_s: float) -> None:
        """Step the loop until ``reached()``, called before each tick. Raises TimeoutError."""
        for tick in range(1, round(timeout_s / T_s) + 1):
            if reached():
                break
            self._loop.tick()
            self._deliver()
            if tick % _BATCH_TICKS == 0:
                await self._end_batch()
        await self._end_batch()
        if not reached():
            raise TimeoutError(messages.state_not_reached_in_mode(timeout_s=timeout_s, mode=self._loop.mode))

    async def _end_batch(self) -> None:
        self._each_batch(self.ring)
        await asyncio.sleep(0)  # other tasks of this event loop get their turn, however short the advance

    def _deliver(self) -> list[Event]:
        events = self._loop.drain_events()
        for event in events:
            self.has_bias = self.has_bias and not isinstance(event, BiasLost)
            for listener in tuple(self._listeners):
                listener(event)
        return events

    def close(self) -> None:
        """Write zero volts and close the plant."""
        self._loop.close()
