"""What a program does to the joint and the shafts, where the plant can push and load."""

from plant.interface import NO_LOAD, Plant, PlantError, ShaftLoad


class ProgramPush:
    """``F_push`` [N] and ``load`` [N·m] in force by a program; what can do neither is not asked to."""

    def __init__(self, plant: Plant) -> None:
        self._plant = plant
        self.F_push, self.load = 0.0, NO_LOAD

    def act(self, F_push: float, load: ShaftLoad) -> None:
        """Push and load from now on. Raises PlantError."""
        (F_before, load_before), (self.F_push, self.load) = (self.F_push, self.load), (F_push, load)
        if load != load_before:
            self._plant.load(load)
        if F_push != F_before:
            self._plant.push(F_push)

    def let_go(self) -> None:
        """End both."""
        try:
            self.act(0.0, NO_LOAD)
        except PlantError:  # whoever pushes the plant has let go of it with it
            return

    def has_become(self, F_push: float, load: ShaftLoad) -> None:
        """Take note of what a batch of ticks has ended with."""
        self.F_push, self.load = F_push, load
