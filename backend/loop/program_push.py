"""What a program does to the joint and the shafts, where the plant can push, load and be obstructed."""

from contextlib import suppress

from backend.control.motion_types import Target
from backend.errors import require_within
from backend.loop.commands import Event, WallChanged
from backend.loop.contact import Acting, Contact
from backend.loop.mode import RefusedError
from backend.loop.program import IDENTIFYING, MAX_WALLS, NO_WALL, Program
from plant.dynamics import Obstacle, Obstructed
from plant.interface import NO_LOAD, Plant, PlantError, ShaftLoad


class ProgramPush:
    """``F_push`` [N], ``load`` [N·m], numbers of the ``wall`` and of the ``touch`` in force by a program.

    What can do none of these is not asked to. The operator's wall, number 0, is back where a program has ended.
    """

    def __init__(self, plant: Plant, events: list[Event], contact: Contact) -> None:
        self._plant = plant
        self._events = events
        self._contact = contact
        self.F_push, self.load, self.wall, self.touch = 0.0, NO_LOAD, 0, 0
        self._walls: tuple[Obstacle | None, ...] = (None,)  # the operator's first

    def obstruct(self, wall: Obstacle | None, tick: int) -> None:
        """Put an operator's wall in the joint's way, None takes it away.

        Raises RefusedError while a program puts up its own and on a plant that takes none, PlantError.
        """
        if len(self._walls) > 1:
            raise RefusedError("the program puts up walls by itself: wait for its end or stop it")
        self._put(wall, 0, tick)
        self._walls = (wall,)

    def require(self, program: Program) -> None:
        """Raise RefusedError or OutOfRangeError for walls that cannot be put up, and contacts not given way to."""
        self._contact.require(program)
        walls = program.walls
        require_within("walls", len(walls), None, MAX_WALLS, "1", words="number of changes of the obstacle")
        if walls and program.law in IDENTIFYING:
            raise RefusedError(f"no wall stands while a {program.law} program plays: leave it out")
        if walls:
            self._require_obstructed()
        for segment in program.segments:
            if not 0 <= segment.wall <= len(walls):
                raise RefusedError(f"a segment wants wall {segment.wall} of the program's {len(walls)}")

    def begin(self, program: Program) -> None:
        """Be ready for a program's walls and touches, numbered from 1 on."""
        self._walls = (self._walls[0], *program.walls)
        self._contact.begin(program)

    def act(self, target: Target, tick: int) -> None:
        """Push, load, obstruct and feel from now on as a program's target says. Raises PlantError."""
        if target.touch != self.touch:
            self.touch = target.touch
            self._contact.use(target.touch)
        if target.wall != self.wall:
            self.wall = target.wall
            self._put(self._walls[target.wall], target.wall, tick)
        self._act(target.F_push, target.load)

    def acting(self, tuning: int) -> Acting:
        """Return what is in force, beside the ``tuning`` of this number."""
        return Acting(self.F_push, self.load, tuning, self.wall, self.touch)

    def _act(self, F_push: float, load: ShaftLoad) -> None:
        (F_before, load_before), (self.F_push, self.load) = (self.F_push, self.load), (F_push, load)
        if load != load_before:
            self._plant.load(load)
        if F_push != F_before:
            self._plant.push(F_push)

    def let_go(self, tick: int) -> None:
        """End all of it; an operator's wall that has the joint in it now stays away."""
        with suppress(PlantError):  # whoever pushes the plant has let go of it with it
            self._act(0.0, NO_LOAD)
        self.touch = 0
        self._contact.end()
        operators, self._walls = self._walls[0], self._walls[:1]
        if self.wall:
            self.wall = 0
            try:
                self._put(operators, 0, tick)
            except PlantError:
                self._walls = (None,)
                with suppress(PlantError):
                    self._put(None, 0, tick)

    def has_become(self, F_push: float, load: ShaftLoad) -> None:
        """Take note of what a batch of ticks has ended with."""
        self.F_push, self.load = F_push, load

    def _put(self, wall: Obstacle | None, number: int, tick: int) -> None:
        self._require_obstructed().obstacle(wall)
        self._events.append(WallChanged(tick, number, wall))

    def _require_obstructed(self) -> Obstructed:
        if not isinstance(self._plant, Obstructed):
            raise RefusedError(NO_WALL)
        return self._plant
