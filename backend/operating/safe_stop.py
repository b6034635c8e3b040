"""Brings the joint to rest when a part of the service dies that safety depends on."""

import asyncio
import logging

from backend.faults import Fault
from backend.operating.present_state import PresentState
from backend.realtime.commands import Stop
from backend.realtime.program import Mode
from backend.realtime.supervisor import LoopDiedError, Supervisor
from backend.supervision import KeptTask, Part, Supervision

ANSWER_S = 0.5
SILENCE_S = 2.0
"""Longer than the loop bears to hear nothing."""

_PART = Part("The soft stop for a part that died", "Press STOP if the joint still moves.")
_STILL = (Mode.OFF, Mode.STOPPING, Mode.TRIPPED)
_log = logging.getLogger(__name__)


class SafeStop:
    """Stops softly by command; where the loop does not take it, by silence, upon which the loop stops by itself."""

    def __init__(self, supervisor: Supervisor, present: PresentState, supervision: Supervision) -> None:
        self._supervisor = supervisor
        self._present = present
        self._supervision = supervision
        self._stopping: KeptTask | None = None

    def begin(self, fault: Fault) -> None:
        """Stop softly with ``fault``, unless the joint is at rest; without waiting for it."""
        self._stopping = self._supervision.keep_task(_PART, lambda: self._stop(fault))

    async def _stop(self, fault: Fault) -> None:
        try:
            if self._present.mode in _STILL or not self._supervisor.alive:
                return
            await asyncio.wait_for(self._supervisor.send(Stop(fault, hard=False)), ANSWER_S)
        except LoopDiedError:
            return
        except Exception:
            _log.exception("the loop does not take a soft stop: it hears nothing more until it stops by itself")
            self._supervisor.fall_silent(SILENCE_S)
