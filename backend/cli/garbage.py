"""How often the command line looks for garbage: nearly all that a command loads stays until its end."""

import atexit
import gc

_SELDOM = 100_000
_USUAL = gc.get_threshold()


def look_seldom() -> None:
    """Look for garbage seldom, and not at all at the end of this process: the two would take a third of a command."""
    gc.set_threshold(_SELDOM)
    atexit.register(gc.freeze)


def look_as_usual() -> None:
    """Look for it as usual from here on: for what runs for days."""
    gc.set_threshold(*_USUAL)
