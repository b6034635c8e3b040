"""The libraries that no start needs and that take seconds to load: whoever computes with one imports it where it does.

The first curve waits for none of them. The service loads them behind it (``backend.main``), so that whoever asks first
does not wait for that either; a process beside the service loads what its work will need.
"""

from importlib import import_module

SCIENCE = ("scipy.fft", "scipy.linalg", "scipy.optimize", "scipy.signal", "scipy.stats", "control")
DRAWING = ("scipy.signal", "matplotlib.figure", "typst")
TABLES = ("scipy.io", "pyarrow.csv", "pyarrow.parquet")


def load(*names: str) -> None:
    """Import these modules, in this order."""
    for name in names:
        import_module(name)
