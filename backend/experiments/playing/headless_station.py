"""A station stepped as fast as it goes, on what waits for its writes: for the command line, for dry runs, for tests."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager

from backend.banks.builder import points_of, tuning_command
from backend.experiments.plans.loop_settings import LoopSettings
from backend.experiments.playing.playable import banks_in
from backend.experiments.playing.runner import Station
from backend.realtime.headless import Headless
from backend.realtime.ring_buffer import Ring
from backend.recording.recorder import Recorder
from backend.storage.banks import Bank
from backend.storage.database import Database
from backend.tuning.preview import Previewer
from plant.factory import make_plant
from plant.interface import SIMULATOR, PlantChoice, PlantError
from plant.parameters import PlantParameters


@contextmanager
def headless_station(
    database: Database, parameters: PlantParameters, settings: LoopSettings, plant: PlantChoice = SIMULATOR
) -> Iterator[Station]:
    """Give an actuator that is computed, with a recorder, set to ``settings``; let go of it at the end of the block.

    Raises PlantError for a ``plant`` that moves by itself, UnknownRecordError for a bank that is not there,
    OutOfRangeError for λ that is not safe on its models.
    """
    bank = banks_in(database)(settings.bank) if settings.bank else None
    recorders: list[Recorder] = []

    def record(_ring: Ring) -> None:
        for recorder in recorders:
            recorder.drain_what_is_worth_it()

    loop = headless_loop(parameters, settings, bank, record, plant)
    recorder = Recorder(database, loop.ring)
    recorders.append(recorder)
    loop.listen(recorder.hear)
    try:
        yield Station(loop, database, plant.name, parameters)
    finally:
        loop.close()
        recorder.close()


def headless_loop(
    parameters: PlantParameters,
    settings: LoopSettings,
    bank: Bank | None,
    each_batch: Callable[[Ring], None],
    plant: PlantChoice = SIMULATOR,
) -> Headless:
    """Return a loop on a computed actuator, set to ``settings``; ``each_batch`` sees its samples as they come.

    Raises PlantError for a ``plant`` that moves by itself, OutOfRangeError for λ that is not safe.
    """
    previewer = Previewer(parameters, points_of(bank), lam_motor=settings.lam_motor, b=settings.b)
    previewer.require_safe(settings.lambdas, settings.budget)
    made = make_plant(plant, parameters, settings.seed)
    if not made.stepped:
        raise PlantError(f"{plant.name}: it runs in real time, start experiments from the dashboard of sinew serve")
    return Headless(made, parameters, tuning_command(parameters, settings, bank), each_batch)
