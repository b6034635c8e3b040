"""Keeps the 3D view at the newest sample, 30 times a second, in a thread of its own."""

import asyncio
import threading
import time
from collections.abc import Callable
from contextlib import suppress

import numpy as np
from numpy.typing import NDArray

from backend.sample import NAMES
from backend.scene.portless import PortlessServer, SceneEndedError, Send
from backend.scene.pose import can_be_drawn, pose
from backend.scene.stage import Stage
from backend.supervision import Part
from plant.dynamics import Obstacle
from plant.parameters import PlantParameters

RATE_HZ = 30.0
UP_WITHIN_S = 5.0
"""Whoever wants to look waits so long for a scene that is being put up [s], and is sent away then."""

_LOOK_S = 0.05
PART = Part("A 3D view", "It stood still meanwhile.")


class SceneMirror:
    """A scene without a port, and ``run``, the work of a thread that moves its nodes while somebody looks.

    ``newest`` returns the newest sample, one value per field, None before the first; ``wall`` what stands in the way.
    """

    def __init__(
        self,
        parameters: PlantParameters,
        newest: Callable[[], NDArray[np.float64] | None],
        wall: Callable[[], Obstacle | None] = lambda: None,
    ) -> None:
        self._newest, self._wall = newest, wall
        self._geometry = parameters.geometry
        self.use(parameters)
        self._scene: tuple[PortlessServer, Stage] | None = None
        self._up = threading.Event()
        self._ending = threading.Event()

    def use(self, parameters: PlantParameters) -> None:
        """Take tendon forces from these springs from now on."""
        self._springs = parameters.identified_spring("A"), parameters.identified_spring("B")

    @property
    def server(self) -> PortlessServer:
        """The present scene's. Raises SceneEndedError where none has been put up."""
        if self._scene is None:
            raise SceneEndedError("there is no 3D view")
        return self._scene[0]

    async def show(self, send: Send) -> None:
        """Hand the scene to ``send`` until cancelled, from when it is up; see ``PortlessServer.show``.

        Raises SceneEndedError where it does not come up within UP_WITHIN_S.
        """
        with suppress(TimeoutError):
            async with asyncio.timeout(UP_WITHIN_S):
                while not self._up.is_set():
                    await asyncio.sleep(_LOOK_S)
        await self.server.show(send)

    def close(self) -> None:
        """Stop the server."""
        self.end()
        if self._scene is not None:
            self._scene[0].stop()

    def _step(self, stage: Stage) -> None:
        row = self._newest()
        sample = None if row is None else dict(zip(NAMES, row.tolist(), strict=True))
        if sample is not None and can_be_drawn(sample):
            stage.show_wall(self._wall())
            stage.show(pose(sample, self._geometry.r_m, self._geometry.r_j, *self._springs))

    def end(self) -> None:
        """Let ``run`` return."""
        self._ending.set()
        self._up.set()

    def run(self) -> None:
        """Put up the scene, keep it at the newest sample until ``end``. Raises SceneEndedError when viser's own dies.

        Called again after that, it puts up another scene; those who looked at the first were sent away and come back.
        """
        if self._scene is None or not self._scene[0].alive:
            self._scene = self._put_up()
        server, stage = self._scene
        self._up.set()
        due = time.monotonic()
        while not self._ending.wait(max(0.0, due - time.monotonic())):
            due = max(due + 1.0 / RATE_HZ, time.monotonic())
            if not server.alive:
                server.clear_up()
                raise SceneEndedError("viser's thread has ended")
            if server.viewers:
                self._step(stage)

    def _put_up(self) -> tuple[PortlessServer, Stage]:
        server = PortlessServer()
        return server, Stage(server, self._geometry.r_j, self._geometry.r_m)
