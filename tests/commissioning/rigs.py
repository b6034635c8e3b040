"""A rig on a virtual card whose real wiring may differ from its wiring file, with automatic confirmations."""

import asyncio
from collections.abc import Awaitable, Callable
from dataclasses import replace
from typing import Any

from backend.banks.builder import build_tuning_command
from backend.commissioning.procedure import ProcedureContext, StepFinding
from backend.commissioning.session import collect_values, run_step
from backend.commissioning.steps import StepId
from backend.experiments.plans import LoopSettings
from backend.realtime.commands import SwitchDrives
from backend.realtime.headless import SimulatedLoop
from backend.realtime.modes import MODES, Mode
from backend.sample import INDEX
from plant.parameters import load_parameters
from plant.simulator import Simulator
from plant.virtual_daq import VirtualRig
from plant.wiring import Wiring, load_wiring

PARAMETERS = load_parameters("lab")
WIRING = load_wiring("pcie-6323")


def with_entries(wiring: Wiring = WIRING, **entries: dict[str, Any]) -> Wiring:
    """Return a wiring with some entries replaced: encoder_A={"direction": -1.0}."""
    parts = {section: replace(getattr(wiring, section), **changed) for section, changed in entries.items()}
    return replace(wiring, **parts)


class CommissionedRig:
    """``declared`` is the wiring file, ``true`` is the wiring of the card.

    ``meanwhile`` runs before a person confirms a manual action, ``in_phase`` when a step reports
    its progress.
    """

    def __init__(self, declared: Wiring = WIRING, true: Wiring = WIRING) -> None:
        self.simulator = Simulator(PARAMETERS, 0)
        self.rig = VirtualRig(declared, self.simulator, None, true, load_cells_measured=True)
        self.loop = SimulatedLoop(self.rig, PARAMETERS, build_tuning_command(PARAMETERS, LoopSettings(), None))
        self.declared = declared
        self.asked: list[str] = []
        self.meanwhile: Callable[[str], Awaitable[None]] | None = None
        self.in_phase: Callable[[str], None] = lambda _phase: None
        self.most_volts = 0.0
        self.joint_moved = 0.0

    @property
    def mode(self) -> Mode:
        """Mode of the newest sample."""
        newest = self.loop.ring.newest()
        assert newest is not None
        return MODES[int(newest[INDEX["mode"]])]

    async def _confirmed(self, words: str) -> None:
        self.asked.append(words)
        if self.meanwhile is not None:
            await self.meanwhile(words)

    async def do(self, step: StepId, cells: str = "AB", **values: float) -> StepFinding:
        """Run one step; ``cells`` are the load cells to calibrate."""
        work = ProcedureContext(
            self.loop,
            self.declared,
            PARAMETERS,
            collect_values(step, values),
            is_simulated=True,
            request_confirmation=self._confirmed,
            set_drives=lambda on: self.loop.send(SwitchDrives(on)),
            report_phase=self.in_phase,
            cells=cells,
        )
        return await run_step(step, work)


def played(rig: CommissionedRig, *steps: StepId, **values: float) -> list[StepFinding]:
    """Run steps one after the other, faster than real time, and close the rig."""

    async def all_of_them() -> list[StepFinding]:
        return [await rig.do(step, "AB", **(values if step is StepId.CALIBRATE else {})) for step in steps]

    try:
        return asyncio.run(all_of_them())
    finally:
        rig.loop.close()
