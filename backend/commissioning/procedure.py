"""What a procedure works with: the loop, its samples, and a person who does things at the rig."""

import math
from collections.abc import Awaitable, Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from backend.realtime import MODES, Accepted, Command, LoopClient, Mode, Refused, SimulateManualInput
from backend.sample import INDEX
from plant import NO_HAND, CellCalibration, ManualInput, PlantParameters, SinewError, T_s, Wiring

Rows = NDArray[np.float64]
"""Samples [n, fields]."""

Signal = NDArray[np.float64]
"""One signal [n]."""

SLACK = ManualInput(q=0.0, theta_A=0.0, theta_B=0.0)
"""Joint and motors where a virtual card begins: both tendons slack."""

HAND_S = 2.0
"""A hand of this program has brought joint and motors to where they belong after so long [s]."""

BLOCK_S = 0.05
"""Readings are averaged over so long [s]: the noise of a load cell is a seventh of itself then."""


@dataclass(frozen=True)
class MeasuredNumber:
    """One number that was measured; None where it could not be."""

    words: str
    value: float | None
    unit: str


@dataclass(frozen=True)
class StepFinding:
    """What a step came to; ``calibrations`` take effect where it passed.

    ``disproves_directions`` tells that a motor or the joint did not go where the step of the directions says.
    """

    passed: bool
    text: str
    figures: tuple[MeasuredNumber, ...] = ()
    calibrations: tuple[CellCalibration, ...] = ()
    disproves_directions: bool = False


class StepFailedError(SinewError):
    """A step cannot go on; the message says what was seen and what to do."""


class DirectionsDisprovedError(StepFailedError):
    """What was seen contradicts the step of the directions: it has to be done again."""


Confirmed = Callable[[str], Awaitable[None]]
"""Asks a person to do something and returns once it is confirmed."""


Switch = Callable[[bool], Awaitable[Accepted | Refused]]
"""Switches the drives on or off, and keeps whether hands may be at the rig."""


class ProcedureContext:
    """``values`` are what the person entered; ``computed`` tells that hands of this program do what is asked for.

    ``cells`` are the load cells to calibrate. ``tried_motors``: the loop takes directions for unproven since.
    """

    def __init__(
        self,
        loop: LoopClient,
        wiring: Wiring,
        parameters: PlantParameters,
        values: dict[str, float],
        *,
        computed: bool,
        confirmed: Confirmed,
        switch: Switch,
        phase: Callable[[str], None],
        cells: str = "AB",
    ) -> None:
        self.loop = loop
        self.wiring = wiring
        self.parameters = parameters
        self.values = values
        self.phase = phase
        self.computed = computed
        self.cells = cells
        self.tried_motors = False
        self._confirmed = confirmed
        self._switch = switch

    @property
    def mode(self) -> Mode:
        """Mode of the newest sample; OFF before the first."""
        newest = self.loop.ring.newest()
        return Mode.OFF if newest is None else MODES[int(newest[INDEX["mode"]])]

    async def send(self, command: Command) -> None:
        """Hand over a command. Raises StepFailedError with the loop's reason where it is refused."""
        _require_accepted(await self.loop.send(command))

    async def drives_off(self) -> None:
        """Take the drives away before hands are asked for; they stay off until somebody has them switched on."""
        _require_accepted(await self._switch(False))

    async def drives_on(self) -> None:
        """Give the drives back, at zero volts: only after it was confirmed that no hand is at the rig."""
        _require_accepted(await self._switch(True))

    async def ask(self, words: str, hand: ManualInput = NO_HAND) -> None:
        """Ask a person to do something and wait until it is confirmed; at a virtual card, ``hand`` does it then."""
        await self._confirmed(words)
        if self.computed and hand != NO_HAND:
            await self.send(SimulateManualInput(hand))
            await self.loop.advance(HAND_S)

    async def let_go(self) -> None:
        """Take the hands away."""
        if self.computed:
            await self.send(SimulateManualInput(NO_HAND))
            await self.loop.advance(0.1)

    async def mean(self, *names: str, seconds: float = 0.3) -> NDArray[np.float64]:
        """Return the means [len(names)] of signals over the next seconds; nan where one was no number."""
        rows = await self.recorded(seconds)
        means: NDArray[np.float64] = rows[:, [INDEX[name] for name in names]].mean(axis=0)
        return means

    async def recorded(self, seconds: float) -> NDArray[np.float64]:
        """Let the loop go on and return the samples [n, fields] from now on."""
        first = self.loop.ring.count
        await self.loop.advance(seconds)
        return self.since(first)[: round(seconds / T_s)]

    def since(self, first: int) -> NDArray[np.float64]:
        """Return the samples [n, fields] from the one numbered ``first`` on."""
        _, rows, _ = self.loop.ring.read(first, self.loop.ring.capacity)
        return rows


def _require_accepted(answer: Accepted | Refused) -> None:
    if isinstance(answer, Refused):
        raise StepFailedError(answer.reason)


def known(value: float) -> float | None:
    """Return what was measured; None where it is no number."""
    return value if math.isfinite(value) else None


def blocks(rows: NDArray[np.float64], name: str) -> NDArray[np.float64]:
    """Return means of a signal over blocks of BLOCK_S."""
    length = round(BLOCK_S / T_s)
    count = max(len(rows) // length, 1)
    column = rows[: count * length, INDEX[name]]
    return np.array([part.mean() for part in np.array_split(column, count)])
