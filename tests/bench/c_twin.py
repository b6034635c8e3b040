"""Twins in C: twin.c simulates like ``backend.tuning.simulation.simulate``, pacing_twin.c only waits."""

import ctypes
import shutil
import subprocess
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from backend.control import cascade
from backend.tuning.simulation import Array, ClosedLoopInputs, SimulatedRig
from plant.dynamics import PlantState

SOURCE = Path(__file__).with_name("twin.c")
PACING = Path(__file__).with_name("pacing_twin.c")


class CompilerMissingError(RuntimeError):
    """There is no gcc on this machine."""


class PacingTwin:
    """A loop in C that only waits for deadlines, compiled by gcc into ``folder``."""

    def __init__(self, folder: Path) -> None:
        self._program = folder / "pacing_twin"
        _compile(PACING, self._program, "-std=gnu11", "-O3")

    def lateness_us(self, periods: int, priority: int, period_s: float) -> Array:
        """Wait for the deadlines at ``priority`` of SCHED_FIFO, 0 for normal; return the lateness per period [µs]."""
        command = [str(self._program), str(periods), str(priority), str(round(1e9 * period_s))]
        said = subprocess.run(command, capture_output=True, text=True, check=True).stdout
        return 1e-3 * np.array([float(line) for line in said.split()])


class CTwin:
    """The C twin, compiled by gcc with ``flags`` into the empty ``folder``."""

    def __init__(self, folder: Path, flags: Sequence[str]) -> None:
        library = folder / "twin.so"
        _compile(SOURCE, library, "-std=c11", *flags, "-shared", "-fPIC")
        self._simulate = ctypes.CDLL(str(library)).simulate
        self._simulate.restype = ctypes.c_int64

    def simulate(
        self,
        rig: SimulatedRig,
        tuning: cascade.CascadeTuning,
        x: PlantState,
        controller: cascade.CascadeState,
        inputs: ClosedLoopInputs,
        out: Array,
    ) -> int:
        """Simulate like ``closed_loop.simulate``; return the tick of a trip of the safety module, or −1."""
        structs = [struct_of(value) for value in (rig, tuning, x, controller, inputs)]
        return int(self._simulate(*map(ctypes.byref, structs), _pointer(out)))


def struct_of(value: Any) -> ctypes.Structure:
    """Return a C struct with the fields of a NamedTuple: arrays as pointer and shape, None as nothing."""
    fields: list[tuple[str, Any]] = []
    values: list[Any] = []
    for name, part in value._asdict().items():
        if part is None:
            continue
        if isinstance(part, np.ndarray):
            fields += [(name, ctypes.POINTER(ctypes.c_double))]
            fields += [(f"{name}_{axis}", ctypes.c_int64) for axis in range(part.ndim)]
            values += [_pointer(part), *part.shape]
        else:
            converted = _converted(part)
            fields.append((name, type(converted)))
            values.append(converted)
    made = type(type(value).__name__, (ctypes.Structure,), {"_fields_": fields})(*values)
    assert isinstance(made, ctypes.Structure)
    return made


def _compile(source: Path, made: Path, *flags: str) -> None:
    gcc = shutil.which("gcc")
    if gcc is None:
        raise CompilerMissingError("gcc is not installed: apt-get install gcc, then run the bench again")
    subprocess.run([gcc, "-Wall", "-Wextra", "-Werror", *flags, "-o", made, source, "-lm"], check=True)


def _converted(part: Any) -> Any:
    if hasattr(part, "_asdict"):
        return struct_of(part)
    if isinstance(part, tuple):
        return (ctypes.c_double * len(part))(*part)
    return ctypes.c_double(part) if isinstance(part, float) else ctypes.c_int64(part)


def _pointer(array: Array) -> Any:
    if array.dtype != np.float64 or not array.flags.c_contiguous:
        raise ValueError("the C twin reads contiguous float64 arrays")
    return array.ctypes.data_as(ctypes.POINTER(ctypes.c_double))
