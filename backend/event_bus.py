"""The event bus of the service, between publishers and subscribers of events."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, TypeVar

_Event = TypeVar("_Event")


@dataclass(frozen=True)
class StateChanged:
    """The state of the service has changed and must be sent at once."""


class EventBus:
    """Calls the subscribers of an event in the publisher's thread.

    Subscribers are called in the order in which they subscribed. An event is a frozen dataclass; the module of its
    publisher defines it.
    """

    def __init__(self) -> None:
        self._handlers: dict[type[Any], list[Callable[[Any], object]]] = {}

    def subscribe(self, event: type[_Event], handler: Callable[[_Event], object]) -> None:
        """Call ``handler`` with each later event of this type."""
        self._handlers.setdefault(event, []).append(handler)

    def publish(self, event: object) -> None:
        """Call all subscribers of the event's type.

        Raises the first exception of a subscriber, after all were called.
        """
        first_error: Exception | None = None
        for handler in self._handlers.get(type(event), ()):
            try:
                handler(event)
            except Exception as error:
                first_error = first_error or error
        if first_error is not None:
            raise first_error
