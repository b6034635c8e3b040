"""Where joint and motors count from, beside what their encoders say."""

from plant.interface import Measurement


class Zeros:
    """The zeros that the loop has found of one plant.

    ``motors_known`` tells that those of the motor encoders are known, ``middle`` [rad] is where the joint reads that is
    said to be in its middle.
    """

    def __init__(self) -> None:
        self.motors_known = False
        self.middle = 0.0
        self.offset_A = self.offset_B = 0.0

    def from_middle(self, m: Measurement) -> Measurement:
        """Return the measurement with the joint from its middle, also where its encoder counts from elsewhere."""
        return m._replace(q=m.q - self.middle) if self.middle else m

    def move(self, by_A: float, by_B: float) -> None:
        """Take the motors' zeros as found where they read more by so many rad."""
        self.offset_A += by_A
        self.offset_B += by_B
        self.motors_known = True

    def doubt(self) -> None:
        """Let the motors' zeros be found anew before they are counted on."""
        self.motors_known = False

    def say_middle(self, q: float) -> None:
        """Take the joint to be in its middle where it reads q [rad]."""
        self.middle = q

    def begin_anew(self) -> None:
        """Forget all of it: the encoders themselves count from elsewhere now."""
        self.offset_A = self.offset_B = self.middle = 0.0
        self.motors_known = False
