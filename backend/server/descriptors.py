"""Descriptors: how many files and connections this process may have open."""

import logging
import os
import resource

_log = logging.getLogger(__name__)

WANTED_DESCRIPTORS = 8192
"""The limit of open descriptors is raised to this, or as far as the machine allows."""


LOW_DESCRIPTORS = 512
"""Below this limit there is room for few pages only; the log says so."""


def raise_limit() -> None:
    """Raise this process's limit of open descriptors as far as it may; say so where it stays low."""
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    most = WANTED_DESCRIPTORS if hard == resource.RLIM_INFINITY else min(hard, WANTED_DESCRIPTORS)
    if soft != resource.RLIM_INFINITY and soft < most:
        resource.setrlimit(resource.RLIMIT_NOFILE, (most, hard))
    if descriptor_limit() < LOW_DESCRIPTORS:
        _log.warning(
            "The service may open only %d files (ulimit -n), enough for few pages. Allow at least %d.",
            descriptor_limit(),
            LOW_DESCRIPTORS,
        )


def descriptor_limit() -> int:
    """Return how many descriptors this process may have open."""
    soft, _ = resource.getrlimit(resource.RLIMIT_NOFILE)
    return WANTED_DESCRIPTORS if soft == resource.RLIM_INFINITY else soft


def open_descriptors() -> int:
    """Return how many descriptors this process has open."""
    return len(os.listdir("/proc/self/fd"))
