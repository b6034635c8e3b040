"""Plans of experiments: settings in, a ``Program`` for the loop out. Pure: the same plan gives the same program.

Angles in rad, stiffness in N·m/rad, tensions and pushes in N, times in s.
"""

import math
from collections.abc import Iterable
from dataclasses import dataclass
from typing import ClassVar

from backend.controllers.limits import STIFFNESS_RANGE
from backend.documents.result import Phase
from backend.experiments.plans.compliance_plan import CompliancePlan
from backend.experiments.plans.identification_plans import MotorIdentificationPlan, SpringIdentificationPlan
from backend.experiments.plans.robustness_plan import RobustnessPlan
from backend.experiments.plans.sequence_plan import Q_REF_MAX, SequencePlan
from backend.experiments.settings import choice, integer, number
from backend.identification.fit import Method
from backend.loop.motion import BASELINES
from backend.loop.program import Excitation, Law, Program, Segment
from backend.refusal import OutOfRangeError, require_within

MAX_EXCITATION_S = 600.0


@dataclass(frozen=True)
class TrackingPlan:
    """Experiment 1 of the paper (figure 7; method section 7).

    A lead-in brings joint and stiffness to where the steps begin. Then q steps between plus and minus the amplitude
    at constant stiffness, S pulses at constant position, and both at once. Where both move, a reference is held for
    the longer of the two times, so that both are at rest before the next change.
    """

    kind: ClassVar[str] = "tracking"

    q_amplitude: float = number(math.pi / 3, 0.01, Q_REF_MAX, "rad", "q_max", "joint position steps between ±q_max")
    q_hold: float = number(0.0, -Q_REF_MAX, Q_REF_MAX, "rad", "q_0", "joint position held during the stiffness pulses")
    S_hold: float = number(10.0, *STIFFNESS_RANGE, "N·m/rad", "S_0", "stiffness held during the position steps")
    S_low: float = number(8.0, *STIFFNESS_RANGE, "N·m/rad", "S_low", "lower level of the stiffness pulses")
    S_high: float = number(14.0, *STIFFNESS_RANGE, "N·m/rad", "S_high", "upper level of the stiffness pulses")
    controller: str = choice(
        Law.CASCADE,
        (Law.CASCADE, *BASELINES),
        "controller",
        "control law; the two without cascade are for comparison",
    )
    q_duration_s: float = number(8.0, 0.5, 60.0, "s", "t_q", "time each position reference is held")
    S_duration_s: float = number(6.0, 0.5, 60.0, "s", "t_S", "time each stiffness reference is held")

    def __post_init__(self) -> None:
        if self.S_low >= self.S_high:
            words, remedy = "lower level of the stiffness pulses", "keep it below the upper level"
            raise OutOfRangeError("S_low", self.S_low, None, self.S_high, "N·m/rad", remedy, words=words)

    def program(self) -> Program:
        """Return the whole experiment as one program of steps."""
        return Program(Law(self.controller), tuple(segment for part in self._parts() for segment in part[2]))

    def phases(self) -> tuple[Phase, ...]:
        """Return lead-in, position, stiffness and both."""
        phases: list[Phase] = []
        start = 0.0
        for name, title, segments in self._parts():
            end = start + sum(segment.duration_s for segment in segments)
            phases.append(Phase(name, title, start, end))
            start = end
        return tuple(phases)

    def _parts(self) -> tuple[tuple[str, str, tuple[Segment, ...]], ...]:
        q_max, q_0, S_0 = self.q_amplitude, self.q_hold, self.S_hold
        both_s = max(self.q_duration_s, self.S_duration_s)
        return (
            ("lead_in", "Lead-in to the first reference", _steps(both_s, [(0.0, S_0)])),
            (
                "position",
                "Position steps at constant stiffness",
                _steps(self.q_duration_s, [(q_max, S_0), (-q_max, S_0), (q_max, S_0), (q_0, S_0)]),
            ),
            (
                "stiffness",
                "Stiffness pulses at constant position",
                _steps(
                    self.S_duration_s,
                    [(q_0, self.S_high), (q_0, self.S_low), (q_0, self.S_high), (q_0, self.S_low), (q_0, S_0)],
                ),
            ),
            (
                "both",
                "Position and stiffness at once",
                _steps(both_s, [(q_max, self.S_high), (-q_max, self.S_low), (q_max, self.S_high), (0.0, S_0)]),
            ),
        )


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

Plan = TrackingPlan | CompliancePlan | RobustnessPlan | SequencePlan | IdentificationPlan
"""Every plan has a ``kind``, the ``program()`` that the loop plays and its named ``phases()``."""


def _steps(duration_s: float, references: Iterable[tuple[float, float]]) -> tuple[Segment, ...]:
    # Whole milliseconds, as the loop plays them: fractions would let plan and samples drift apart.
    return tuple(Segment(round(duration_s, 3), q_ref, S_ref) for q_ref, S_ref in references)
