"""Messages to the user: texts of a catalogue that carry their code and their values.

Each package lists its messages in a module ``messages``, one function per message. The function's name is the code, its
arguments are the values, and it returns the text. Programs and tests read code and values; people read the text.
"""

from collections.abc import Callable, Mapping
from functools import wraps
from types import MappingProxyType
from typing import ParamSpec

P = ParamSpec("P")


class Message(str):
    """Text with the code of its catalogue entry and the values that it shows.

    ``code`` is empty for a text that no catalogue contains. A message within a message is one of its values. Joined to
    another string it is a plain text: build the whole text in the catalogue.
    """

    code: str
    values: Mapping[str, object]

    def __new__(cls, text: str, code: str = "", values: Mapping[str, object] = MappingProxyType({})) -> "Message":
        """Return the text with this code and a copy of these values."""
        message = super().__new__(cls, text)
        message.code, message.values = code, dict(values)
        return message


def catalogue_entry(write: Callable[P, str]) -> Callable[P, Message]:
    """Return a function that builds messages from one that writes their text.

    Its arguments are keywords, so that the values have names.
    """

    @wraps(write)
    def build(*args: P.args, **kwargs: P.kwargs) -> Message:
        return Message(write(*args, **kwargs), write.__name__, kwargs)

    return build
