"""The virtual card's watchdog as a task of NI-DAQmx: what may be asked of it when, and what it has done to lines."""

from nidaqmx.constants import WDTTaskAction
from nidaqmx.error_codes import DAQmxErrors

from plant.card import Card, WatchdogExpiredError
from plant.in_process import CardError

_CLEAR = WDTTaskAction.CLEAR_EXPIRATION.value


class WatchdogTask:
    """At most one task; its timer and what it cuts are the registers' own. Raises CardError as NI-DAQmx would."""

    def __init__(self, registers: Card) -> None:
        self.limit_s = 0.0
        self._registers = registers
        self._task = ""
        self._running = False

    def make(self, task: str, limit_s: float) -> None:
        """Make the task, with its time [s]."""
        self._task, self.limit_s = task, limit_s

    def let_go(self, task: str) -> None:
        """Let go of a task; of this one nothing is watched any more."""
        if task == self._task:
            self._task, self._running, self.limit_s = "", False, 0.0
            self._registers.disarm()

    def start(self, task: str) -> None:
        """Count from this moment, where the task is this one."""
        if task != self._task:
            return
        if self._running:
            raise CardError(DAQmxErrors.CAN_NOT_PERFORM_OP_WHILE_TASK_RUNNING, f"The task is running: {task}")
        self._running = True
        self._registers.watch_from_now(self.limit_s)

    def stop(self, task: str) -> None:
        """Stop counting, where the task is this one."""
        self._running = self._running and task != self._task

    def control(self, action: int) -> None:
        """Reset the timer, or clear the expiration."""
        if action == _CLEAR:
            self._registers.clear_expiration()
            return
        try:
            self._registers.feed()
        except WatchdogExpiredError:
            text = "The watchdog timer has expired, and cannot be reset before its expiration is cleared"
            raise CardError(DAQmxErrors.CANT_RESET_EXPIRED_WATCHDOG, text) from None

    @property
    def expired(self) -> bool:
        """Whether it has expired; told while it runs only."""
        if not self._running:
            text = "The property can be read while the task is reserved, committed or running only"
            raise CardError(DAQmxErrors.CANNOT_GET_PROPERTY_WHEN_TASK_NOT_RESERVED_COMMITTED_OR_RUNNING, text)
        return self._registers.state().expired

    def require_unlocked(self) -> None:
        """Refuse a write to the lines that it holds."""
        if self._registers.state().expired:
            text = "Write failed, because the watchdog timer has expired: clear its expiration first"
            raise CardError(DAQmxErrors.WRITE_FAILED_BECAUSE_WATCHDOG_EXPIRED, text)
