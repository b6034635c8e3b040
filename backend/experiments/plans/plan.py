"""Plans of experiments: settings in, a ``Program`` for the loop out. Pure: the same plan gives the same program.

Angles in rad, stiffness in N·m/rad, tensions and pushes in N, times in s.
"""

from dataclasses import dataclass
from typing import ClassVar

from backend.errors import require_within
from backend.experiments.plans.composed_plan import ComposedPlan
from backend.experiments.plans.identification_plans import MotorIdentificationPlan, SpringIdentificationPlan
from backend.experiments.plans.sequence_plan import SequencePlan
from backend.identification.fitting import Method
from backend.models.run import Phase
from backend.models.settings import choice, integer, number
from backend.realtime.program import Excitation, Law, Program

MAX_EXCITATION_S = 600.0


@dataclass(frozen=True)
class ActuatorIdentificationPlan:
    """Closed-loop identification of G_q and G_S at one tendon tension (method section 4, figures 4 and 5).

    theta_B_ref is 0, a slow force loop holds the tension, and a maximum-length sequence moves theta_A_ref.
    """

    kind: ClassVar[str] = "actuator_identification"

    tension_N: float = number(20.0, 8.0, 42.0, "N", "F_0", "tendon tension held while θ_A,ref is excited")
    amplitude_rad: float = number(1.0, 0.01, 2.0, "rad", "a", "amplitude of the binary sequence on θ_A,ref")
    chip_s: float = number(0.080, 0.001, 2.0, "s", "t_c", "shortest time between two changes of the sequence")
    bits: int = integer(7, 4, 12, "n", "length of the shift register; a period has 2^n - 1 chips")
    periods: int = integer(2, 1, 10, "p", "periods of the sequence; the last third of all is kept for validation")
    settle_s: float = number(8.0, 1.0, 60.0, "s", "t_0", "time the tension is held before the excitation starts")
    estimator: str = choice(
        Method.DEFAULT,
        (Method.DEFAULT, Method.ARX),
        "estimator",
        "what makes the models from the record; arx is the paper's, of first order",
    )

    def program(self) -> Program:
        """Return the force hold with its excitation."""
        return Program(Law.FORCE_HOLD, tension_N=self.tension_N, settle_s=self.settle_s, excitation=self.excitation())

    def excitation(self) -> Excitation:
        """Return the sequence with its timing. Raises OutOfRangeError when it would last too long."""
        from scipy.signal import max_len_seq

        register, _ = max_len_seq(self.bits)
        levels = "".join("+" if chip else "-" for chip in register)
        excitation = Excitation(self.amplitude_rad, self.chip_s, levels, self.periods)
        require_within(
            "chip_s",
            excitation.duration_s,
            None,
            MAX_EXCITATION_S,
            "s",
            "take a shorter chip, fewer bits or fewer periods",
            words="time of all chips together",
        )
        return excitation

    def phases(self) -> tuple[Phase, ...]:
        """Return settling and excitation."""
        end = self.program().duration_s
        return (
            Phase("settle", "Tension held, no excitation", 0.0, self.settle_s),
            Phase("excitation", "Excitation", self.settle_s, end),
        )


IdentificationPlan = ActuatorIdentificationPlan | MotorIdentificationPlan | SpringIdentificationPlan
"""Plans whose runs give models."""

Plan = ComposedPlan | SequencePlan | IdentificationPlan
"""Every plan has a ``kind``, the ``program()`` that the loop plays and its named ``phases()``."""
