"""No process of ours is ever copied: a fork would hold the lock, the database and every socket, and outlive us."""

import multiprocessing
import sys


class ForkRefusedError(Exception):
    """Something tried to fork the process."""


def refuse_forks() -> None:
    """Let every fork of this process fail with ForkRefusedError, for good.

    New programs can still be started, as all descriptors of ours close on exec: subprocesses, and processes of
    ``multiprocessing``, which are spawned unless they ask for a fork by name.
    """
    multiprocessing.set_start_method("spawn", force=True)
    sys.addaudithook(_refuse)


def _refuse(event: str, _arguments: object) -> None:
    if event in ("os.fork", "os.forkpty"):
        raise ForkRefusedError("the service does not fork: its lock, database and sockets would live on in the copy")
