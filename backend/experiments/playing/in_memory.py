"""An experiment played on a simulator of its own and measured, with nothing stored: the row of a study.

The same loop, program and evaluation as a run that is stored, of samples as a recording keeps them, so that the
figures are the same to the last digit.
"""

import asyncio
from collections.abc import Sequence
from contextlib import closing
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from backend.banks.builder import points_of, tuning_command
from backend.experiments.plans.composed_plan import ComposedPlan
from backend.experiments.plans.loop_settings import LoopSettings
from backend.experiments.playing.headless_station import headless_loop
from backend.experiments.playing.learning import learn_for
from backend.experiments.playing.play import play
from backend.experiments.playing.playable import BankOf, playable
from backend.experiments.results.composed import composed_result
from backend.experiments.results.in_force import InForce
from backend.experiments.results.metrics import NoSamplesError
from backend.models.run import Criterion, Metrics
from backend.realtime.commands import Event, RunEnded
from backend.realtime.headless import Headless
from backend.realtime.program import Program, SetTuning
from backend.realtime.ring_buffer import Ring
from backend.realtime.supervisor import LoopDied
from backend.recording.reader import Columns
from backend.recording.recorder import end_of
from backend.sample import INDEX, STORED_COLUMNS, STORED_NAMES
from backend.storage.runs import EndState
from plant.interface import T_s
from plant.parameters import PlantParameters

_RUN = 1
_AT_ONCE = 100_000


@dataclass(frozen=True)
class Played:
    """How it ended, ``end_state`` an ``EndState`` value, what was recorded, measured and judged."""

    end_state: str
    end_detail: str
    metrics: Metrics
    criteria: tuple[Criterion, ...]
    columns: Columns


def play_in_memory(parameters: PlantParameters, plan: ComposedPlan, settings: LoopSettings, bank_of: BankOf) -> Played:
    """Play a plan as ``sinew experiment`` would, and measure it; ``end_detail`` also says why nothing was measured.

    Raises OutOfRangeError for λ that is not safe, ExperimentError for what this plant cannot play, NotPlayedError,
    UnknownRecordError for a bank that ``bank_of`` does not know.
    """
    bank = bank_of(settings.bank) if settings.bank else None
    kept = _Kept()
    with closing(headless_loop(parameters, settings, bank, kept.drain)) as loop:
        program = playable(bank_of, parameters, plan, settings.tuning)
        loop.listen(kept.hear)
        asyncio.run(_played(loop, program, tuning_command(parameters, settings, bank)))
        kept.drain(loop.ring)
    assert kept.ended is not None  # else it would still be played
    state, detail = end_of(kept.ended)
    columns = _columns(kept.rows)
    outline = Metrics(
        complete=state == EndState.COMPLETED,
        played_s=columns["t"].size * T_s,
        planned_s=plan.program().duration_s,
        phases=plan.phases(),
    )
    in_force = InForce(parameters, plan, settings.tuning, points_of(bank))
    try:
        metrics, criteria = composed_result(columns, in_force, outline, 0)
    except NoSamplesError as error:
        return Played(state.value, f"{detail}: {error}" if detail else str(error), outline, (), columns)
    return Played(state.value, detail, metrics, criteria, columns)


async def _played(loop: Headless, program: Program, tuning: SetTuning) -> None:
    await learn_for(loop, program, tuning)
    await play(loop, program, _RUN, lambda _doing, _elapsed_s: None)


class _Kept:
    """The samples of the run [n, fields of a recording], and how the loop said that it ended."""

    def __init__(self) -> None:
        self.rows: list[NDArray[np.float32]] = []
        self.ended: RunEnded | None = None
        self._position = 0

    def drain(self, ring: Ring) -> None:
        first, rows, _ = ring.read(self._position, _AT_ONCE)
        self._position = first + len(rows)
        self.rows.append(rows[rows[:, INDEX["run"]] == _RUN][:, STORED_COLUMNS].astype(np.float32))

    def hear(self, event: Event | LoopDied) -> None:
        if isinstance(event, RunEnded) and event.run == _RUN:
            self.ended = event


def _columns(rows: Sequence[NDArray[np.float32]]) -> Columns:
    table = np.concatenate(rows)
    t = np.arange(len(table), dtype=np.float64) * T_s
    return {"t": t} | {name: table[:, place].astype(np.float64) for place, name in enumerate(STORED_NAMES)}
