"""No process of ours is ever copied: a fork would hold the lock, the database and every socket, and outlive us.

Processes that are started anew import nothing from the working directory, where a file may be called as a module is.
"""

import multiprocessing
import os
import sys
from multiprocessing.context import SpawnContext

SAFE_PATH = "PYTHONSAFEPATH"
"""Variable that keeps Python from searching the working directory for modules, as -P does."""


class ForkRefusedError(Exception):
    """Something tried to fork the process."""


def import_nothing_from_here() -> None:
    """Let no Python process that this one starts import from the working directory; for good, and for theirs too.

    multiprocessing has no option for its processes and its tracker of resources: they take it from the environment.
    """
    os.environ[SAFE_PATH] = "1"


def spawning() -> SpawnContext:
    """Return the context whose processes are programs started anew, which import nothing from here."""
    import_nothing_from_here()
    return multiprocessing.get_context("spawn")


def refuse_forks() -> None:
    """Let every fork of this process fail with ForkRefusedError, for good.

    New programs can still be started, as all descriptors of ours close on exec: subprocesses, and processes of
    ``multiprocessing``, which are spawned unless they ask for a fork by name.
    """
    import_nothing_from_here()
    multiprocessing.set_start_method("spawn", force=True)
    sys.addaudithook(_refuse)


def _refuse(event: str, _arguments: object) -> None:
    if event in ("os.fork", "os.forkpty"):
        raise ForkRefusedError("the service does not fork: its lock, database and sockets would live on in the copy")
