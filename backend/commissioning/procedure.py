"""The context of a procedure: control loop, samples, and the person who acts at the rig."""

import math
from collections.abc import Awaitable, Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from backend.realtime import MODES, Accepted, Command, LoopClient, Mode, Refused, SimulateManualInput
from backend.sample import INDEX
from plant import NO_MANUAL_INPUT, CellCalibration, ManualInput, PlantParameters, SinewError, T_s, Wiring

Rows = NDArray[np.float64]
"""Samples [n, fields]."""

Signal = NDArray[np.float64]
"""One signal [n]."""

SLACK = ManualInput(q=0.0, theta_A=0.0, theta_B=0.0)
"""Zero position of joint and motors, at which both tendons of a virtual card are slack."""

MANUAL_MOTION_S = 2.0
"""Time [s] after which a simulated manual input has reached its position."""

BLOCK_S = 0.05
"""Averaging time [s]; it reduces the noise of a load cell to a seventh."""


@dataclass(frozen=True)
class MeasuredNumber:
    """A measured number; None if it could not be measured."""

    words: str
    value: float | None
    unit: str


@dataclass(frozen=True)
class StepFinding:
    """Result of a step; ``calibrations`` take effect if it passed.

    ``disproves_directions``: a motor or the joint moved against the result of the direction step.
    """

    passed: bool
    text: str
    figures: tuple[MeasuredNumber, ...] = ()
    calibrations: tuple[CellCalibration, ...] = ()
    disproves_directions: bool = False


class StepFailedError(SinewError):
    """The step cannot continue; the message says what was measured and what to do."""


class DirectionsDisprovedError(StepFailedError):
    """A measurement contradicts the direction step, which must be repeated."""


RequestConfirmation = Callable[[str], Awaitable[None]]
"""Asks the person to do something and returns after the confirmation."""


SetDrives = Callable[[bool], Awaitable[Accepted | Refused]]
"""Switches the drives on or off and stores the drive lockout."""


class ProcedureContext:
    """Access of a running step to loop, wiring and person.

    ``values`` are the inputs of the step. ``is_simulated``: the program simulates the requested manual inputs.
    ``cells`` are the load cells to calibrate. ``has_tried_motors``: a motor test has started, so directions are
    unproven.
    """

    def __init__(
        self,
        loop: LoopClient,
        wiring: Wiring,
        parameters: PlantParameters,
        values: dict[str, float],
        *,
        is_simulated: bool,
        request_confirmation: RequestConfirmation,
        set_drives: SetDrives,
        report_phase: Callable[[str], None],
        cells: str = "AB",
    ) -> None:
        self.loop = loop
        self.wiring = wiring
        self.parameters = parameters
        self.values = values
        self.report_phase = report_phase
        self.is_simulated = is_simulated
        self.cells = cells
        self.has_tried_motors = False
        self._request_confirmation = request_confirmation
        self._set_drives = set_drives

    @property
    def mode(self) -> Mode:
        """Mode of the newest sample; OFF before the first."""
        newest = self.loop.ring.newest()
        return Mode.OFF if newest is None else MODES[int(newest[INDEX["mode"]])]

    async def send(self, command: Command) -> None:
        """Send a command. Raises StepFailedError with the loop's reason if it is rejected."""
        _require_accepted(await self.loop.send(command))

    async def switch_drives_off(self) -> None:
        """Switch the drives off before the person touches the rig; they stay off until a person switches them on."""
        _require_accepted(await self._set_drives(False))

    async def switch_drives_on(self) -> None:
        """Switch the drives on, at zero volts; only after the person has confirmed to be clear of the rig."""
        _require_accepted(await self._set_drives(True))

    async def request_action(self, words: str, manual_input: ManualInput = NO_MANUAL_INPUT) -> None:
        """Ask the person to do something and wait for the confirmation.

        On a virtual card, ``manual_input`` is simulated afterwards.
        """
        await self._request_confirmation(words)
        if self.is_simulated and manual_input != NO_MANUAL_INPUT:
            await self.send(SimulateManualInput(manual_input))
            await self.loop.advance(MANUAL_MOTION_S)

    async def release_rig(self) -> None:
        """End the simulated manual input."""
        if self.is_simulated:
            await self.send(SimulateManualInput(NO_MANUAL_INPUT))
            await self.loop.advance(0.1)

    async def measure_mean(self, *names: str, seconds: float = 0.3) -> NDArray[np.float64]:
        """Return the means [len(names)] of signals over the next seconds; nan if a sample is not a number."""
        rows = await self.record(seconds)
        means: NDArray[np.float64] = rows[:, [INDEX[name] for name in names]].mean(axis=0)
        return means

    async def record(self, seconds: float) -> NDArray[np.float64]:
        """Return the samples [n, fields] of the next seconds."""
        first = self.loop.ring.count
        await self.loop.advance(seconds)
        return self.read_since(first)[: round(seconds / T_s)]

    def read_since(self, first: int) -> NDArray[np.float64]:
        """Return the samples [n, fields] from the sample with index ``first`` on."""
        _, rows, _ = self.loop.ring.read(first, self.loop.ring.capacity)
        return rows


def _require_accepted(answer: Accepted | Refused) -> None:
    if isinstance(answer, Refused):
        raise StepFailedError(answer.reason)


def to_finite(value: float) -> float | None:
    """Return a measured value, or None if it is not finite."""
    return value if math.isfinite(value) else None


def average_blocks(rows: NDArray[np.float64], name: str) -> NDArray[np.float64]:
    """Return means of a signal over blocks of BLOCK_S."""
    length = round(BLOCK_S / T_s)
    count = max(len(rows) // length, 1)
    column = rows[: count * length, INDEX[name]]
    return np.array([part.mean() for part in np.array_split(column, count)])
