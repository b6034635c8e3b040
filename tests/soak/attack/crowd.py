"""Groups of clients, each in its own processes, that run until the ``with`` block ends."""

import multiprocessing
import resource
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from multiprocessing.sharedctypes import Synchronized
from multiprocessing.synchronize import Event
from typing import Any, NamedTuple

_CONTEXT = multiprocessing.get_context("spawn")
BEGIN_TIMEOUT_S = 30.0
USUAL_DESCRIPTORS = 1024


class Signals(NamedTuple):
    """Signals of a client process: ready, end, and three counters."""

    there: Event
    over: Event
    now: "Synchronized[int]"
    ever: "Synchronized[int]"
    failed: "Synchronized[int]"


Crowd = tuple[Callable[..., None], tuple[Any, ...]]
"""What a process does: a function of Signals and these arguments."""


@contextmanager
def running_clients(*wanted: Crowd) -> Iterator[list[Signals]]:
    """Start client processes; the block runs once all are ready, or after BEGIN_TIMEOUT_S."""
    signals = [Signals(_CONTEXT.Event(), _CONTEXT.Event(), *(_CONTEXT.Value("q", 0) for _ in range(3))) for _ in wanted]
    processes = [
        _CONTEXT.Process(target=function, args=(signal, *arguments), daemon=True)
        for signal, (function, arguments) in zip(signals, wanted, strict=True)
    ]
    try:
        for process in processes:
            process.start()
        for signal in signals:
            signal.there.wait(BEGIN_TIMEOUT_S)
        yield signals
    finally:
        for signal in signals:
            signal.over.set()
        for process in processes:
            process.join(10.0)
            process.kill()


def usual_descriptors() -> None:
    """Give child processes the limit of descriptors that most machines have."""
    _, most = resource.getrlimit(resource.RLIMIT_NOFILE)
    resource.setrlimit(resource.RLIMIT_NOFILE, (min(USUAL_DESCRIPTORS, most), most))


def many_descriptors() -> None:
    """Raise the limit of sockets of this process to the maximum of the machine."""
    _, most = resource.getrlimit(resource.RLIMIT_NOFILE)
    resource.setrlimit(resource.RLIMIT_NOFILE, (most, most))
