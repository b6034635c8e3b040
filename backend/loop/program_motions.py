"""From a program to the motion that plays it: what it asks for is looked at whole before anything moves."""

from backend.control.cascade import CascadeTuning
from backend.control.decoupler import bounds_for, decoupler_for
from backend.control.motion_primitives import PRETENSION_N, VoltageMargin
from backend.control.motion_types import Carry
from backend.errors import require_within
from backend.loop.mode import RefusedError
from backend.loop.motion import BASELINES, Baseline, ForceHold, Motion, MotorSteps, TensionSweep, Tracking
from backend.loop.program import Law, Program, Segment, require_able, require_few
from backend.loop.program_arrays import tension_hold_of, tension_sweep_of, voltage_steps_of
from backend.tuning.models import Lambdas
from plant.dynamics import elongation
from plant.interface import Measurement, Plant
from plant.parameters import PlantParameters


class ProgramMotions:
    """Makes the motions of one plant's programs."""

    def __init__(self, plant: Plant, parameters: PlantParameters) -> None:
        self._plant = plant
        self._parameters = parameters
        self._bounds = bounds_for(parameters)
        self._spring_A, self._spring_B = parameters.identified_spring("A"), parameters.identified_spring("B")
        self._geometry = decoupler_for(parameters)

    def motion_for(
        self, program: Program, carry: Carry, m: Measurement, tuning: CascadeTuning, lambdas: Lambdas
    ) -> Motion:
        """Return what plays the program from here on. Raises RefusedError or OutOfRangeError."""
        if program.law is Law.FORCE_HOLD:
            if program.excitation is None:
                raise ValueError("a force-hold program needs an excitation")
            # Motor B stays at zero: what motor A winds stretches both springs.
            theta_A = sum(self.wound(program.tension_N))
            return ForceHold(carry, tension_hold_of(program, program.excitation, carry, theta_A))
        if program.law is Law.MOTOR_STEPS:
            return self._motor_steps(program, carry)
        if program.law is Law.TENSION_SWEEP:
            return self._tension_sweep(program, carry)
        self._require_segments(program)
        bounds = self._bounds
        if program.law in BASELINES:
            return Baseline(program, self._parameters, lambdas, tuning, carry, m, bounds)
        return Tracking(tuning, carry, m, bounds, program.law is Law.CASCADE, program)

    def off_by(self, tensions: tuple[float, float], m: Measurement) -> tuple[float, float]:
        """How much less motors A and B read [rad] than they stand at, as the tensions [N] say."""
        (F_A, F_B), r_m, turned = tensions, self._geometry.r_m, self._geometry.r_j * m.q
        A, B = elongation(self._spring_A, F_A) + turned, elongation(self._spring_B, F_B) - turned
        return A / r_m - m.theta_A, B / r_m - m.theta_B

    def wound(self, F: float) -> tuple[float, float]:
        """theta_A, theta_B [rad] that hold F [N] in both tendons at q = 0."""
        r_m = self._geometry.r_m
        return elongation(self._spring_A, F) / r_m, elongation(self._spring_B, F) / r_m

    def require_references(self, q_ref: float, S_ref: float) -> None:
        """Raise OutOfRangeError unless the joint may be brought to q_ref [rad] and S_ref [N·m/rad]."""
        require_within("q_ref", q_ref, self._bounds.q_min, self._bounds.q_max, "rad")
        require_within("S_ref", S_ref, self._bounds.S_min, self._bounds.S_max, "N·m/rad")

    def _require_segments(self, program: Program) -> None:
        require_few(program.segments)
        q_min, q_max, S_min, S_max = self._bounds.q_min, self._bounds.q_max, self._bounds.S_min, self._bounds.S_max
        for segment in program.segments:
            # Most are plain and good, and a thousand calls would take half a period.
            good = q_min <= segment.q_ref <= q_max and S_min <= segment.S_ref <= S_max
            if not good or segment.F_push or segment.load_A or segment.load_B:
                self._require_segment(segment)

    def _require_segment(self, segment: Segment) -> None:
        self.require_references(segment.q_ref, segment.S_ref)
        require_able(segment, pushes=self._plant.pushes, loads_shafts=self._plant.loads_shafts)

    def _motor_steps(self, program: Program, carry: Carry) -> MotorSteps:
        if not program.steps:
            raise RefusedError("a program of voltage steps needs at least one step")
        theta_max = self._geometry.r_j / self._geometry.r_m * self._bounds.q_trip  # what the joint's range winds up
        for step in program.steps:
            require_within("theta_start", step.theta_start, -theta_max, 0.0, "rad", "0 is where the tendons go slack")
            require_within("u", step.u, -self._bounds.u_max, self._bounds.u_max, "V")
        room = VoltageMargin(*self.wound(PRETENSION_N), self._bounds.F_slack, theta_max)
        return MotorSteps(carry, voltage_steps_of(program, room))

    def _tension_sweep(self, program: Program, carry: Carry) -> TensionSweep:
        if not program.legs:
            raise RefusedError("a sweep of the tension needs at least one leg")
        tensions = (program.tension_N, *(leg.tension_N for leg in program.legs))
        for tension_N in tensions:
            require_within("tension_N", tension_N, self._bounds.F_slack, self._bounds.F_max, "N")
        return TensionSweep(carry, tension_sweep_of(program, [self.wound(tension_N) for tension_N in tensions]))
