"""Headless stepping is the same loop: answers, events, samples and time agree, and it repeats to the last bit."""

import asyncio
from collections.abc import Callable
from functools import partial

import numpy as np
import pytest

from backend.realtime.commands import (
    Accepted,
    ModeChanged,
    PretensionReached,
    Refused,
    Reset,
    RunEnded,
    RunProgram,
    SetMode,
    SetReferences,
    Stop,
    Stopped,
)
from backend.realtime.headless import SimulatedLoop
from backend.realtime.modes import MODE_CODE, Mode
from backend.realtime.program import Law, Program, Segment, SetTuning
from backend.realtime.ring_buffer import Ring
from backend.sample import INDEX
from plant.parameters import PlantParameters
from plant.simulator import Simulator

Make = Callable[..., SimulatedLoop]


@pytest.fixture
def make(ideal: PlantParameters, tuning: SetTuning) -> Make:
    def build(**options: Callable[[Ring], None]) -> SimulatedLoop:
        return SimulatedLoop(Simulator(ideal, seed=1), ideal, tuning, **options)

    return build


def read_mode(ring: Ring) -> Mode:
    newest = ring.newest()
    assert newest is not None
    return list(MODE_CODE)[int(newest[INDEX["mode"]])]


def slack(ring: Ring) -> bool:
    newest = ring.newest()
    return newest is not None and bool(max(newest[INDEX["F_A"]], newest[INDEX["F_B"]]) < 0.5)


async def pretension(headless: SimulatedLoop) -> None:
    await headless.send(SetMode(Mode.PRETENSION))

    async def granted() -> bool:
        return isinstance(await headless.send(SetMode(Mode.RUN, run=5)), Accepted)

    for _ in range(300):
        if await granted():
            return
        await headless.advance(0.1)
    raise AssertionError("pretension was never reached")


def test_a_program_plays_to_its_end_and_its_samples_carry_its_run(make: Make) -> None:
    async def session() -> None:
        headless = make()
        events: list[object] = []
        headless.listen(events.append)
        await pretension(headless)
        program = Program(Law.CASCADE, (Segment(0.3, q_ref=0.1, S_ref=10.0), Segment(0.2, q_ref=0.0, S_ref=10.0)))
        assert isinstance(await headless.send(RunProgram(program, run=8)), Accepted)
        start = headless.ring.count
        await headless.advance_until(lambda: isinstance(events[-1], RunEnded | ModeChanged), timeout_s=1.0)
        _, rows, missed = headless.ring.read(start, 10_000)
        assert missed == 0
        assert np.count_nonzero(rows[:, INDEX["run"]] == 8) == pytest.approx(500, abs=2)
        assert any(isinstance(event, RunEnded) and event.completed and event.run == 8 for event in events)
        headless.close()

    asyncio.run(session())


def test_refusals_and_stops_are_answered(make: Make) -> None:
    async def session() -> None:
        headless = make()
        events: list[object] = []
        forget = headless.listen(events.append)
        refused = await headless.send(SetReferences(0.0, 10.0))
        assert isinstance(refused, Refused)
        assert isinstance(await headless.send(Stop()), Accepted)
        await headless.advance(0.002)
        assert [event.fault for event in events if isinstance(event, Stopped)] == [Stop().fault]
        assert read_mode(headless.ring) is Mode.TRIPPED
        forget()
        seen = len(events)
        await headless.send(Stop())
        assert len(events) == seen
        headless.close()

    asyncio.run(session())


def test_advance_is_exact_and_calls_each_batch_before_the_ring_overflows(make: Make) -> None:
    async def session() -> None:
        counts: list[int] = []
        headless = make(each_batch=lambda ring: counts.append(ring.count))
        await headless.advance(2.5)
        assert headless.ring.count == 2500
        assert counts[-1] == 2500
        assert max(np.diff([0, *counts])) <= 1000
        with pytest.raises(TimeoutError, match=r"0\.01 s of loop time"):
            await headless.advance_until(lambda: False, timeout_s=0.01)
        assert headless.ring.count == 2510
        await headless.advance_until(lambda: headless.ring.count >= 2515, timeout_s=0.1)
        assert headless.ring.count == 2515
        headless.close()

    asyncio.run(session())


def test_the_same_session_repeats_to_the_last_bit(make: Make) -> None:
    async def session() -> np.ndarray[tuple[int, ...], np.dtype[np.float64]]:
        headless = make()
        await headless.send(SetMode(Mode.PRETENSION))
        await headless.advance(1.0)
        _, rows, _ = headless.ring.read(0, 1000)
        headless.close()
        return rows

    np.testing.assert_array_equal(asyncio.run(session()), asyncio.run(session()))


def test_reaching_the_pretension_is_told_once_and_motion_is_granted_from_then_on(make: Make) -> None:
    async def session() -> None:
        headless = make()
        told: list[object] = []
        headless.listen(lambda event: told.append(event) if isinstance(event, PretensionReached) else None)
        await headless.send(SetMode(Mode.PRETENSION))
        assert isinstance(await headless.send(SetMode(Mode.RUN)), Refused)
        await headless.advance_until(lambda: bool(told), timeout_s=30.0)
        await headless.advance(0.5)
        assert len(told) == 1
        assert isinstance(await headless.send(SetMode(Mode.RUN)), Accepted)
        headless.close()

    asyncio.run(session())


def test_pretension_is_reached_again_after_a_stop_let_the_tendons_go(make: Make) -> None:
    async def session() -> None:
        headless = make()
        told: list[object] = []
        headless.listen(lambda event: told.append(event) if isinstance(event, PretensionReached) else None)

        def told_so_often(times: int) -> bool:
            return len(told) == times

        for times in (1, 2):
            assert isinstance(await headless.send(SetMode(Mode.PRETENSION)), Accepted)
            await headless.advance_until(partial(told_so_often, times), timeout_s=30.0)
            await headless.send(Stop())
            await headless.advance_until(lambda: slack(headless.ring), timeout_s=60.0)
            assert isinstance(await headless.send(Reset()), Accepted)
        headless.close()

    asyncio.run(session())
