"""Keeps the 3D view at the newest sample, 30 times a second, in a thread of its own."""

import threading
import time
from collections.abc import Callable
from contextlib import redirect_stdout
from io import StringIO

import numpy as np
import viser
from numpy.typing import NDArray

from backend.sample import NAMES
from backend.scene.pose import can_be_drawn, pose
from backend.scene.stage import Stage
from backend.supervision import Part
from plant.parameters import PlantParameters

RATE_HZ = 30.0
PART = Part("A 3D view", "It stood still meanwhile.")


class SceneMirror:
    """A viser server on a loopback port, and ``run``, the work of a thread that moves its nodes while somebody looks.

    ``newest`` returns the newest sample, one value per field, None before the first.
    """

    def __init__(self, parameters: PlantParameters, newest: Callable[[], NDArray[np.float64] | None]) -> None:
        self._newest = newest
        self._geometry = parameters.geometry
        self._springs = parameters.identified_spring("A"), parameters.identified_spring("B")
        with redirect_stdout(StringIO()):  # it would print its address, which is nobody's business
            self._server = viser.ViserServer(host="127.0.0.1", port=0, verbose=False)
        self._stage = Stage(self._server, self._geometry.r_j, self._geometry.r_m)
        self._ending = threading.Event()

    @property
    def port(self) -> int:
        """Loopback port of the viser server."""
        return self._server.get_port()

    def close(self) -> None:
        """Stop the server."""
        with redirect_stdout(StringIO()):
            self._server.stop()

    def step(self) -> None:
        """Show the newest sample."""
        row = self._newest()
        sample = None if row is None else dict(zip(NAMES, row.tolist(), strict=True))
        if sample is not None and can_be_drawn(sample):
            self._stage.show(pose(sample, self._geometry.r_m, self._geometry.r_j, *self._springs))

    def end(self) -> None:
        """Let ``run`` return."""
        self._ending.set()

    def run(self) -> None:
        """Keep the view at the newest sample until ``end``."""
        due = time.monotonic()
        while not self._ending.wait(max(0.0, due - time.monotonic())):
            due = max(due + 1.0 / RATE_HZ, time.monotonic())
            if self._server.get_clients():
                self.step()
