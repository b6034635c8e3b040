"""The event bus of the service: publishers name an event, subscribers need not be known to them."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, TypeVar

_Event = TypeVar("_Event")


@dataclass(frozen=True)
class StateChanged:
    """The state of the service has changed, and is worth sending at once."""


class EventBus:
    """Calls the subscribers of an event, in the order in which they subscribed, in the publisher's thread.

    An event is a frozen dataclass; the module of its publisher defines it.
    """

    def __init__(self) -> None:
        self._handlers: dict[type[Any], list[Callable[[Any], object]]] = {}

    def subscribe(self, event: type[_Event], handler: Callable[[_Event], object]) -> None:
        """Call ``handler`` with each event of this type from now on."""
        self._handlers.setdefault(event, []).append(handler)

    def publish(self, event: object) -> None:
        """Call all subscribers of the event's type; raises what the first of them raised, after all were called."""
        failed: Exception | None = None
        for handler in self._handlers.get(type(event), ()):
            try:
                handler(event)
            except Exception as error:
                failed = failed or error
        if failed is not None:
            raise failed
