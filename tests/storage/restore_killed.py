"""A restore in a process of its own that is killed at its nth change of a name: ``FILE TARGET N``."""

import os
import signal
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

from backend.storage.database import restore_database

left = int(sys.argv[3])


def killed_at(name: str) -> None:
    """Let a function of os kill the process before the call at which the count runs out."""
    really: Callable[..., Any] = getattr(os, name)

    def counted(*arguments: Any, **named: Any) -> Any:
        global left
        left -= 1
        if left < 0:
            os.kill(os.getpid(), signal.SIGKILL)
        return really(*arguments, **named)

    setattr(os, name, counted)


for each in ("replace", "unlink", "fsync", "open"):
    killed_at(each)
restore_database(Path(sys.argv[1]), Path(sys.argv[2]))
print("done")
