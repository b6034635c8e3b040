"""Figures that take python-control and a while to compute, and never change for the same inputs: computed once.

They outlive the process where somebody with a disk keeps ``FIGURES`` (``backend.operating.kept_figures``): a start
then neither loads the library nor waits for it.
"""

import hashlib
import math
from collections.abc import Callable

FIGURES: dict[str, tuple[float, ...]] = {}
"""What has been computed, by the digest of what was asked; those that were asked for least lately go first."""

MOST = 400


def remembered(asked: tuple[object, ...], count: int, compute: Callable[[], tuple[float, ...]]) -> tuple[float, ...]:
    """Return the ``count`` figures of ``compute()``, computed the first time that this is ``asked``.

    ``asked`` names the question and all that the answer depends on: words, numbers, frozen dataclasses of numbers. What
    is remembered in another form, or is not finite, is computed anew; an exception is not remembered.
    """
    key = hashlib.sha256(repr(asked).encode()).hexdigest()
    known = FIGURES.get(key, ())
    if len(known) != count or not all(map(math.isfinite, known)):
        known = compute()
    FIGURES.pop(key, None)
    FIGURES[key] = known
    for oldest in list(FIGURES)[:-MOST]:  # a copy: other threads remember, too
        FIGURES.pop(oldest, None)
    return known
