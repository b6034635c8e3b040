"""Commands of the trigger: arms and disarms it, and logs that."""

import asyncio
from datetime import UTC, datetime

from backend.errors import RequestRejectedError
from backend.recording import WINDOWS, Armed, Condition, Derived, Trigger, build_derived_signal, load_armed_trigger
from backend.sample import UNIT_BY_SIGNAL, find_nearest_name
from backend.schemas import MarkKind, TriggerOrder, TriggerView
from backend.services import messages
from backend.services.actuator import ActuatorService
from backend.services.event_log import EventLog
from backend.storage import Database, EventKind, StorageError, formulas
from plant import ErrorCode, T_s


class Triggers:
    """Arms and disarms the trigger of the service."""

    def __init__(self, trigger: Trigger, actuator: ActuatorService, event_log: EventLog, database: Database) -> None:
        self._trigger, self._actuator, self._event_log, self._database = trigger, actuator, event_log, database
        self._command_lock = asyncio.Lock()
        armed = load_armed_trigger(database)
        if armed is not None:
            says = (
                armed.get("says")
                or Condition(armed["signal"], armed["kind"], armed["level"], armed["upper"]).describe()
            )
            text = messages.trigger_disarmed_by_restart(condition=says, who=armed["who"])
            event_log.add_entry(EventKind.NOTE, text)

    def view(self) -> TriggerView | None:
        """Return the last armed trigger with its progress.

        None if none was armed since the service started.
        """
        status = self._trigger.status
        if status is None:
            return None
        armed, condition = status.armed, status.armed.condition
        return TriggerView(
            signal=condition.signal,
            condition=condition.kind,
            level=condition.level,
            upper=condition.upper,
            before_s=armed.before * T_s,
            after_s=armed.after * T_s,
            captures=armed.captures,
            unit=condition.unit,
            says=condition.describe(),
            who=armed.who,
            at=armed.at,
            phase="ended" if status.ended else "capturing" if status.left else "armed",
            captured=status.captured,
            left_s=status.left * T_s,
            ended=status.ended,
        )

    async def arm(self, order: TriggerOrder, who: str) -> TriggerView:
        """Arm the trigger with a condition.

        Raises RequestRejectedError if it is armed or the order is invalid.
        """
        condition = _build_condition(order, await asyncio.to_thread(self._load_derived_signals))
        async with self._command_lock:
            status = self._trigger.status
            if status is not None and self._trigger.is_armed:
                armed = status.armed
                message = messages.trigger_is_armed(who=armed.who, condition=armed.condition.describe())
                raise RequestRejectedError(ErrorCode.NOT_NOW, message, code="trigger_armed")
            before, after = round(order.before_s / T_s), round(order.after_s / T_s)
            self._trigger.arm(
                Armed(
                    condition=condition,
                    before=before,
                    after=after,
                    captures=order.captures,
                    who=who,
                    at=datetime.now(UTC),
                )
            )
            try:
                await asyncio.to_thread(self._trigger.save_armed, who)
            except StorageError:
                self._trigger.disarm(messages.trigger_not_stored())
                raise
        text = messages.trigger_armed(
            condition=condition.describe(), before_s=order.before_s, after_s=order.after_s, captures=order.captures
        )
        self._add_mark(text, who)
        view = self.view()
        assert view is not None
        return view

    async def disarm(self, who: str) -> None:
        """Disarm the trigger; a capture in progress ends and is stored."""
        async with self._command_lock:
            if not self._trigger.is_armed:
                return
            self._trigger.disarm(messages.trigger_disarmed_by(who=who))
            await asyncio.to_thread(self._trigger.save_armed, who)
        self._add_mark(messages.trigger_disarmed(), who)

    def _load_derived_signals(self) -> dict[str, Derived]:
        with self._database.reading() as session:
            return {one.name: build_derived_signal(one) for one in formulas.find(session)}

    def _add_mark(self, text: str, who: str) -> None:
        self._event_log.add_mark(MarkKind.NOTE, text, self._actuator.live_state.tick, who)


def _build_condition(order: TriggerOrder, derived: dict[str, Derived]) -> Condition:
    """Return a checked condition; ``derived`` are the derived signals by name.

    Raises RequestRejectedError.
    """
    if order.signal not in UNIT_BY_SIGNAL and order.signal not in derived:
        message = messages.unknown_signal(signal=order.signal, nearest=find_nearest_name(order.signal))
        raise RequestRejectedError(
            ErrorCode.BAD_VALUE, message, code="unknown_signal", legal=[*UNIT_BY_SIGNAL, *derived]
        )
    is_window = order.condition in WINDOWS
    if is_window and (order.upper is None or order.upper <= order.level):
        raise RequestRejectedError(ErrorCode.BAD_VALUE, messages.window_without_width(), code="bad_window")
    if not is_window and order.upper is not None:
        message = messages.upper_end_without_window(condition=order.condition)
        raise RequestRejectedError(ErrorCode.BAD_VALUE, message, code="bad_window")
    formula = None if order.signal in UNIT_BY_SIGNAL else derived[order.signal]
    return Condition(order.signal, order.condition, order.level, order.upper, formula)
