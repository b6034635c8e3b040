"""A worker of the control loop, stepped on a clock that its own ticks drive."""

from collections.abc import Callable

import numpy as np

from backend.realtime.channel import Channel, channel_pair
from backend.realtime.control_loop import Loop
from backend.realtime.ipc import Setup, decode_from_loop, encode
from backend.realtime.process import Worker
from backend.realtime.program import SetTuning
from backend.realtime.ring_buffer import Ring
from backend.realtime.timing import Pacer
from backend.sample import INDEX
from plant.interface import SIMULATOR, Plant
from plant.parameters import PlantParameters
from plant.simulator import Simulator


class Bench:
    """A worker whose clock is driven by its own ticks; ``each_tick`` plays the service."""

    def __init__(
        self, parameters: PlantParameters, tuning: SetTuning, plant: Plant | None = None, *, drives_off: bool = False
    ) -> None:
        self.service, theirs = channel_pair()
        self.ring = Ring.create()
        plant = plant or Simulator(parameters)
        loop = Loop(plant, parameters, self.ring, tuning)
        self.worker = Worker(plant, loop, Channel(theirs), drives_off=drives_off)
        self.setup = Setup(SIMULATOR, "ideal", 0, tuning)
        self.now_ns = 0
        self.each_tick: Callable[[int], None] = lambda tick: None
        self.told: list[object] = []

    def run(self, each_tick: Callable[[int], None]) -> None:
        self.each_tick = each_tick
        self.worker.run(Pacer(0.001, lambda: self.now_ns, self._sleep_until), lambda: self.now_ns * 1e-9)

    def _sleep_until(self, deadline_ns: int) -> None:
        self.now_ns = deadline_ns
        self.each_tick(self.ring.count)

    def say(self, message: object, sequence: int = 0) -> None:
        assert self.service.send(encode(message, sequence))  # type: ignore[arg-type] # any kind on purpose

    def hear(self) -> list[object]:
        while (packet := self.service.receive()) is not None:
            self.told.append(decode_from_loop(packet)[1])
        return self.told

    def column(self, name: str) -> np.ndarray[tuple[int, ...], np.dtype[np.float64]]:
        return self.ring.read(0, 100_000)[1][:, INDEX[name]]
