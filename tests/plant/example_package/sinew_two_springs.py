"""A plant of its own for Sinew: two motors that follow their voltages lazily, two springs, one joint."""

from plant.interface import NO_RAW, Measurement, MotorCommand, PlantError, ShaftLoad, T_s, require_numbers
from plant.parameters import PlantParameters

R_M, R_J = 7.5e-3, 75e-3  # reel and joint pulley [m]
J, B = 5.2e-4, 0.046  # joint: inertia [kg·m²], damping [N·m·s/rad]
K_M, T_M = 2.86, 0.22  # motor: speed per volt [rad/(V·s)], time constant [s]
SPRING = -2.498, 331.49, 8543.8  # tension over elongation [N/m^i]
SUBSTEPS = 20


def tension(x: float) -> float:
    """Tension [N] of a tendon whose spring is x [m] long beyond slack; it cannot push."""
    return max(0.0, SPRING[0] + SPRING[1] * x + SPRING[2] * x * x) if x > 0.0 else 0.0


class TwoSprings:
    """Advances by one period at each write, and waits in between."""

    paces_loop = False
    stepped = True
    pushes = False
    loads_shafts = False
    unattended_max_s = 0.4
    unready = ""
    description = "two springs, computed"
    raw = NO_RAW

    def __init__(self, F_max: float) -> None:
        self._F_max = F_max
        self._q = self._q_dot = 0.0
        self._theta = [0.0, 0.0]
        self._omega = [0.0, 0.0]
        self._tripped = False

    def open(self) -> None:
        """Nothing to connect: a card is opened here, its outputs at zero volts."""

    def _tensions(self) -> tuple[float, float]:
        wound_A, wound_B = R_M * self._theta[0], R_M * self._theta[1]
        return tension(wound_A - R_J * self._q), tension(wound_B + R_J * self._q)

    def read(self) -> Measurement:
        """Return what sensors would say."""
        F_A, F_B = self._tensions()
        theta_A, theta_B = self._theta
        return Measurement(
            self._q, theta_A, theta_B, F_A, F_B, S_true=float("nan"), F_push=0.0, safety_trip=float(self._tripped)
        )

    def write(self, command: MotorCommand) -> None:
        """Put the voltages on the motors for one period."""
        require_numbers(command)
        volts = [0.0 if self._tripped else max(-10.0, min(10.0, u)) for u in command]
        h = T_s / SUBSTEPS
        for _ in range(SUBSTEPS):
            F_A, F_B = self._tensions()
            self._q_dot += h * (R_J * (F_A - F_B) - B * self._q_dot) / J
            self._q += h * self._q_dot
            for side, u in enumerate(volts):
                self._omega[side] += h * (K_M * u - self._omega[side]) / T_M
                self._theta[side] += h * self._omega[side]
        self._tripped = self._tripped or max(self._tensions()) > self._F_max

    def push(self, F_push: float) -> None:
        """Refuse: this plant has nothing to push with."""
        raise PlantError("two-springs is not pushed by command")

    def load(self, load: ShaftLoad) -> None:
        """Refuse, as loads_shafts says."""
        raise PlantError("two-springs does not load its shafts")

    def inject(self, injected_fault: object) -> None:
        """Refuse: nothing here can be broken to order."""
        raise PlantError("nothing of two-springs is broken to order")

    def zero(self, q: float, theta_A: float, theta_B: float, *, at_switch: bool = False) -> None:
        """Refuse: its encoders know where they are."""
        raise PlantError("two-springs counts from its own zeros")

    def acknowledge(self) -> None:
        """Re-arm what watches over the tendons."""
        if max(self._tensions()) > self._F_max:
            raise PlantError("a tendon still carries too much")
        self._tripped = False

    def close(self) -> None:
        """Nothing to let go of: a card gets zero volts here, and is released."""


def make(parameters: PlantParameters, seed: int) -> TwoSprings:
    """Return the plant; ``seed`` is for those that have noise."""
    return TwoSprings(parameters.safety.F_max)
