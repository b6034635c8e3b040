"""A service that starts the loop, pretensions it, prints where to find its ring buffer, and waits to be killed."""

import asyncio
import os
from pathlib import Path

from backend.realtime.commands import SetMode
from backend.realtime.gains import make_tuning_command
from backend.realtime.ipc import Setup
from backend.realtime.modes import Mode
from backend.realtime.supervisor import Supervisor
from backend.sample import INDEX
from backend.tuning.gains import TuningParameters
from plant.interface import SIMULATOR
from plant.parameters import load_parameters


async def serve() -> None:
    tuning = make_tuning_command(load_parameters("ideal"), TuningParameters())
    supervisor = Supervisor(Setup(plant=SIMULATOR, parameters="ideal", seed=0, tuning=tuning))
    await supervisor.start()
    await supervisor.send(SetMode(Mode.PRETENSION))

    def is_moving() -> bool:
        newest = supervisor.ring.newest()
        return newest is not None and newest[INDEX["u_A"]] != 0.0

    await supervisor.advance_until(is_moving, timeout_s=5.0)
    (worker,) = Path(f"/proc/self/task/{os.getpid()}/children").read_text(encoding="ascii").split()
    print(worker, supervisor.ring.fd, flush=True)
    await asyncio.Event().wait()


asyncio.run(serve())
