"""Small files in the formats of other programs, all of one motion: K = 2, T = 0.02 s at 1 kHz.

All contain the same two signals, so that every value that is read can be compared.
"""

import io
import struct
from collections.abc import Callable
from decimal import Decimal
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

COUNT = 400
PERIOD_S = 1e-3
T = np.round(np.arange(COUNT) * PERIOD_S, 6)
U = np.repeat(np.random.default_rng(3).choice([-3.0, 3.0], COUNT // 20), 20)


def _output() -> Array:
    y, decay = np.zeros(COUNT), np.exp(-PERIOD_S / 0.02)
    for k in range(1, COUNT):
        y[k] = decay * y[k - 1] + 2.0 * (1.0 - decay) * U[k - 1]
    return np.round(y + 0.002 * np.random.default_rng(4).standard_normal(COUNT), 4)


Y = _output()
Row = Callable[[int], str]


def lines(heading: str, row: Row, *before: str, end: str = "\n") -> str:
    """Return the text of a table: the text ``before`` the heading, the heading, and a row for each sample."""
    return end.join([*before, heading, *(row(k) for k in range(COUNT))]) + end


def plain(k: int) -> str:
    """Return a row of time, input and output."""
    return f"{T[k]:.3f},{U[k]},{Y[k]}"


def comma(value: float, digits: int = 4) -> str:
    """Return a number with a decimal comma."""
    return f"{value:.{digits}f}".replace(".", ",")


def stamp(k: int, ms: int = 0) -> str:
    """Return the time of day of a sample, in milliseconds."""
    return f"10:20:30.{(k + ms) % 1000:03d}"


def mat(content: dict[str, Any]) -> bytes:
    """Return a MATLAB file of these variables."""
    from scipy.io import savemat

    stream = io.BytesIO()
    savemat(stream, content)  # type: ignore[arg-type]  # the stubs forget that files may be open
    return stream.getvalue()


def parquet(content: dict[str, Any]) -> bytes:
    """Return a Parquet file of these columns."""
    import pyarrow as pa
    import pyarrow.parquet

    stream = io.BytesIO()
    pa.parquet.write_table(pa.table(content), stream)
    return stream.getvalue()


def scope(values: Array, label: str) -> dict[str, Any]:
    """Return a signal of a MATLAB structure with time."""
    return {"values": values.reshape(-1, 1), "dimensions": 1.0, "label": label}


def opaque(name: bytes, kind: bytes) -> bytes:
    """Return the MATLAB 5 element of an object such as a table: name, class 17, a reference."""

    def element(code: int, content: bytes) -> bytes:
        return struct.pack("<II", code, len(content)) + content + b"\0" * (-len(content) % 8)

    reference = element(6, struct.pack("<II", 13, 0)) + element(5, struct.pack("<ii", 2, 1)) + element(1, b"")
    reference += element(6, struct.pack("<II", 0xDD000000, 2))
    words = b"".join(element(1, word) for word in (name, b"MCOS", kind))
    return element(14, element(6, struct.pack("<II", 17, 0)) + words + element(14, reference))


def objects(**kinds: str) -> bytes:
    """Return a MATLAB file of objects by name and class."""
    header = b"MATLAB 5.0 MAT-file".ljust(116) + b"\0" * 8 + struct.pack("<H", 0x0100) + b"IM"
    return header + b"".join(opaque(name.encode(), kind.encode()) for name, kind in kinds.items())


def structure_with_time() -> dict[str, Any]:
    """Return a MATLAB structure with time of two signals, in the format of a Simulink Scope."""
    signals = np.empty(2, dtype=[("values", object), ("dimensions", object), ("label", object)])
    for at, (values, label) in enumerate(((U, "u"), (Y, "y"))):
        signals[at] = (values.reshape(-1, 1), 1.0, label)
    return {"ScopeData": {"time": T, "signals": signals, "blockName": "model/Scope"}}


def decimals(values: Array) -> list[Decimal]:
    """Return values as decimal numbers of four places."""
    return [Decimal(f"{value:.4f}") for value in values]
