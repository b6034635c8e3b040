"""A station on the simulator, stepped as fast as it goes: what the command line uses, on a database of its own."""

from pathlib import Path

from backend.experiments.bank_building import tuning_command
from backend.experiments.loop_settings import LoopSettings
from backend.experiments.runner import Station
from backend.loop.headless import Headless
from backend.loop.ring import Ring
from backend.recording.recorder import Recorder
from backend.storage import open_database
from plant.parameters import load_parameters
from plant.simulator import Simulator


def station(folder: Path, parameters: str, settings: LoopSettings = LoopSettings()) -> Station:  # noqa: B008  # frozen
    loaded = load_parameters(parameters)
    database = open_database(folder)
    recorders: list[Recorder] = []

    def record(_ring: Ring) -> None:
        for recorder in recorders:
            recorder.drain()

    loop = Headless(Simulator(loaded, settings.seed), loaded, tuning_command(loaded, settings, None), record)
    recorders.append(Recorder(database, loop.ring))
    loop.listen(recorders[0].hear)
    return Station(loop, database, "simulator", loaded)
