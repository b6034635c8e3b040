"""What the loop has answered to a command."""

from backend.errors import Because, RefusalError
from backend.realtime.commands import Accepted, Refused


def carried_out(answer: Accepted | Refused) -> Accepted:
    """Return the answer of a loop that carries out. Raises RefusalError with its reason where it does not."""
    if isinstance(answer, Refused):
        legal = [str(mode) for mode in answer.legal] or None
        raise RefusalError(Because.NOT_NOW, answer.reason, code="refused", legal=legal)
    return answer
