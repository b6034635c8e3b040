"""Descriptors: limits of open files and connections of this process."""

import logging
import os
import resource

_log = logging.getLogger(__name__)

WANTED_DESCRIPTORS = 8192
"""Desired limit of open descriptors; the machine may allow less."""


LOW_DESCRIPTORS = 512
"""Limit below which only few pages can be served, which is logged."""


def raise_limit() -> None:
    """Raise this process's limit of open descriptors as far as allowed.

    Logs a warning if it stays low.
    """
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    most = WANTED_DESCRIPTORS if hard == resource.RLIM_INFINITY else min(hard, WANTED_DESCRIPTORS)
    if soft != resource.RLIM_INFINITY and soft < most:
        resource.setrlimit(resource.RLIMIT_NOFILE, (most, hard))
    if descriptor_limit() < LOW_DESCRIPTORS:
        _log.warning(
            "The service may open only %d files (ulimit -n), enough for only a few pages. Allow at least %d.",
            descriptor_limit(),
            LOW_DESCRIPTORS,
        )


def descriptor_limit() -> int:
    """Return the limit of this process's open descriptors."""
    soft, _ = resource.getrlimit(resource.RLIMIT_NOFILE)
    return WANTED_DESCRIPTORS if soft == resource.RLIM_INFINITY else soft


def open_descriptors() -> int:
    """Return the number of open descriptors of this process."""
    return len(os.listdir("/proc/self/fd"))
