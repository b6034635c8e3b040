"""The real loop on the simulator, recorded: every tick of the run is in the database as it was in the ring."""

import asyncio

import numpy as np

from backend.faults import Fault
from backend.realtime.commands import Accepted, PretensionReached, SetMode, SetReferences, Stop
from backend.realtime.gains import make_tuning_command
from backend.realtime.headless import SimulatedLoop
from backend.realtime.modes import MODE_CODE, Mode
from backend.realtime.ring_buffer import Ring
from backend.recording.reader import read_envelope, read_samples
from backend.recording.recorder import Recorder
from backend.sample import INDEX, STORED_NAMES
from backend.storage import recordings
from backend.storage.database import Database
from backend.storage.runs import EndState
from backend.tuning.gains import TuningParameters
from plant.parameters import load_parameters
from plant.simulator import Simulator
from tests.recording.stand_in import new_run, stored_run


def test_a_session_on_the_simulator_is_recorded_whole(database: Database) -> None:
    async def session() -> None:
        parameters = load_parameters("lab")
        recorders: list[Recorder] = []

        def record(_ring: Ring) -> None:
            for recorder in recorders:
                recorder.drain()

        headless = SimulatedLoop(
            Simulator(parameters, seed=3), parameters, make_tuning_command(parameters, TuningParameters()), record
        )
        recorders.append(Recorder(database, headless.ring))
        headless.listen(recorders[0].on_event)
        reached: list[object] = []
        headless.listen(lambda event: reached.append(event) if isinstance(event, PretensionReached) else None)
        await headless.send(SetMode(Mode.PRETENSION))
        await headless.advance_until(lambda: bool(reached), timeout_s=60.0)
        run = new_run(database)
        assert isinstance(await headless.send(SetMode(Mode.RUN, run=run.id)), Accepted)
        start = headless.ring.count
        await headless.send(SetReferences(0.2, 10.0))
        await headless.advance(3.21)
        end = headless.ring.count
        await headless.send(Stop(hard=False))
        await headless.advance(1.0)
        headless.close()
        recorders[0].close()

        ended = stored_run(database, run.id)
        assert (ended.end_state, ended.end_detail) == (EndState.STOPPED, Fault.STOP_PRESSED)
        _, rows, _ = headless.ring.read(start, end - start)
        with database.reading() as reading:
            samples = read_samples(reading, run.id)
            envelope = read_envelope(reading, run.id, points=50, names=["q"])
            recording = recordings.get(reading, run.id)
            packed = sum(len(chunk.samples) for chunk in recordings.chunks(reading, run.id, 0, 2**40))
        assert recording.missed == 0
        assert samples.first_tick == start
        assert len(samples.t) == 3210
        assert np.all(samples.columns["mode"] == MODE_CODE[Mode.RUN])
        for name in STORED_NAMES:
            np.testing.assert_array_equal(samples.columns[name], rows[:, INDEX[name]].astype(np.float32), err_msg=name)
        assert np.nanmax(envelope.maximum["q"]) == samples.columns["q"].max() > 0.15
        assert packed < 0.4 * len(rows) * len(STORED_NAMES) * 4

    asyncio.run(session())
