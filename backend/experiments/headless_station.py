"""A station on the simulator, stepped as fast as it goes: for the command line, for dry runs, for tests."""

from collections.abc import Iterator
from contextlib import contextmanager

from backend.experiments.bank_building import points_of, tuning_command
from backend.experiments.loop_settings import LoopSettings
from backend.experiments.runner import Station
from backend.loop.headless import Headless
from backend.loop.ring import Ring
from backend.recording.recorder import Recorder
from backend.storage import Database, banks
from backend.tuning.preview import Previewer
from plant.parameters import PlantParameters
from plant.simulator import Simulator


@contextmanager
def headless_station(database: Database, parameters: PlantParameters, settings: LoopSettings) -> Iterator[Station]:
    """Give a simulated actuator with a recorder, set to ``settings``; let go of it at the end of the block.

    Raises UnknownRecordError for a bank that is not there, OutOfRangeError for λ that is not safe on its models.
    """
    bank = None
    if settings.bank:
        with database.reading() as session:
            bank = banks.get(session, settings.bank)
    previewer = Previewer(parameters, points_of(bank), lam_motor=settings.lam_motor, b=settings.b)
    previewer.require_safe(settings.lambdas)
    recorders: list[Recorder] = []

    def record(_ring: Ring) -> None:
        for recorder in recorders:
            recorder.drain()

    loop = Headless(
        Simulator(parameters, settings.seed), parameters, tuning_command(parameters, settings, bank), record
    )
    recorder = Recorder(database, loop.ring)
    recorders.append(recorder)
    loop.listen(recorder.hear)
    try:
        yield Station(loop, database, "simulator", parameters)
    finally:
        loop.close()
        recorder.close()
