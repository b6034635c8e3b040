"""Plans of experiments: settings in, a ``Program`` for the loop out. Pure."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, fields
from functools import cached_property
from typing import ClassVar, NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray

from backend.banks import TuningSettings
from backend.control import STEP_BRAKING_S, ZERO_VOLTS_S, Setpoint, setpoint_player
from backend.errors import OutOfRangeError, check_range
from backend.experiments import parser
from backend.experiments.compiler import CompiledExperiment, laid
from backend.experiments.parser import ExperimentError, Lines, find_line, parsed_setting, require_rules, settings_of
from backend.experiments.schema import Experiment
from backend.identification import Method
from backend.models import (
    Phase,
    Setting,
    SettingError,
    Value,
    build_plan,
    choice_setting,
    integer_setting,
    number_setting,
)
from backend.realtime import (
    IDENTIFYING,
    Excitation,
    Law,
    Program,
    Shape,
    TensionLeg,
    VoltageStep,
    make_segment_player,
)
from plant import T_s

# Composed plan -------------------------------------------------------------------------------------
#
# The plan of an experiment that is data: the experiment, and the values of its settings. Pure.


LAWS = tuple(law for law in Law if law not in IDENTIFYING)
KIND = "experiment"
"""Kind of the runs of all experiments but the paper's, whose runs have the kinds that they always had."""


@dataclass(frozen=True)
class ExperimentPlan:
    """``values`` are all settings by name. ``kind`` is the kind of its runs; ``lines`` tell where it was written."""

    experiment: Experiment
    values: Mapping[str, Value]
    kind: str = KIND
    lines: Lines = field(default_factory=dict, compare=False, repr=False)

    @cached_property
    def laid(self) -> CompiledExperiment:
        """What is played, and where it was written. Raises ExperimentError."""
        return laid(self.experiment, self.values, self.lines)

    def program(self) -> Program:
        """Return what the loop plays; the gains of its changes of the tuning are left to who knows the models."""
        return Program(self.law, self.laid.segments, walls=self.laid.walls, touches=self.laid.touches)

    def phases(self) -> tuple[Phase, ...]:
        """Return the named stretches."""
        return self.laid.phases

    @property
    def law(self) -> Law:
        """The control law. Raises ExperimentError."""
        named = self.values.get(self.experiment.law, self.experiment.law)
        if named not in LAWS:
            why = f"{named!r} is no control law; there are {', '.join(LAWS)}"
            raise ExperimentError(why, ("law",), find_line(("law",), self.lines))
        return Law(str(named))

    @property
    def settings(self) -> tuple[Setting, ...]:
        """The declared settings."""
        return settings_of(self.experiment, self.lines)

    def stored(self) -> dict[str, Value]:
        """Return what a run keeps of it: the experiment as it was, and its settings by name."""
        return {"experiment": parser.canonical(self.experiment), **self.values}


def composed(
    experiment: Experiment, given: Mapping[str, object], kind: str = KIND, lines: Lines | None = None
) -> ExperimentPlan:
    """Return the plan with these settings, the others at their defaults; it can be played, but for the plant.

    Raises ExperimentError, SettingError, OutOfRangeError.
    """
    where = {} if lines is None else lines
    settings = settings_of(experiment, where)
    values = parsed_setting(settings, given)
    plan = ExperimentPlan(experiment, values, kind, where)
    require_rules(experiment, settings, values, given, where)
    plan.program()
    return plan


# Identification plans ------------------------------------------------------------------------------
#
# Plans that identify motors and springs (method sections 2 and 3): settings in, a ``Program`` for
# the loop out. Pure.
#
# The actuator's is in ``backend.experiments.plans``. Angles in rad, voltages in V, tensions in N,
# times in s.


UPPER_END = -1.5
"""Where a step down starts [rad]: the tendons go slack above 0, and a step up needs the rest of the way to brake."""


@dataclass(frozen=True)
class MotorIdentificationPlan:
    """Unloaded voltage steps of both motors at once (method section 2).

    Both tendons are let slack, so that the motors run free. Each voltage is stepped up and then down again: the way
    back is data too, and the motors stay within the turn that the joint's range allows.
    """

    kind: ClassVar[str] = "motor_identification"

    u_low: float = number_setting(
        2.0, minimum=0.3, maximum=9.0, unit="V", symbol="u_low", meaning="smallest voltage step"
    )
    u_high: float = number_setting(
        5.0, minimum=0.5, maximum=9.5, unit="V", symbol="u_high", meaning="largest voltage step, short of saturation"
    )
    levels: int = integer_setting(4, 2, 8, "n", "number of voltages from the smallest to the largest")
    travel_rad: float = number_setting(
        12.0,
        minimum=2.0,
        maximum=12.0,
        unit="rad",
        symbol="Δθ",
        meaning="a step ends once a motor has turned by this much",
    )
    step_s: float = number_setting(
        2.5, minimum=0.3, maximum=10.0, unit="s", symbol="t_u", meaning="a step ends after this time at the latest"
    )
    settle_s: float = number_setting(
        1.0, minimum=0.5, maximum=10.0, unit="s", symbol="t_0", meaning="time the motors are held where a step starts"
    )

    def __post_init__(self) -> None:
        if self.u_low >= self.u_high:
            words, remedy = "smallest voltage step", "keep it below the largest"
            raise OutOfRangeError(
                quantity="u_low",
                value=self.u_low,
                minimum=None,
                maximum=self.u_high,
                unit="V",
                remedy=remedy,
                words=words,
            )

    def voltages(self) -> tuple[float, ...]:
        """Return the voltages [V] stepped to, both ways."""
        return tuple(round(float(u), 3) for u in np.linspace(self.u_low, self.u_high, self.levels))

    def program(self) -> Program:
        """Return the steps, up and down in turn."""
        lower_end = UPPER_END - self.travel_rad
        steps = (
            VoltageStep(start, u, self.step_s, self.travel_rad)
            for voltage in self.voltages()
            for start, u in ((lower_end, voltage), (UPPER_END, -voltage))
        )
        return Program(Law.MOTOR_STEPS, settle_s=self.settle_s, steps=tuple(steps))

    def phases(self) -> tuple[Phase, ...]:
        """Return one phase per step, as long as it can get."""
        around_each = self.settle_s + ZERO_VOLTS_S + STEP_BRAKING_S
        return tuple(
            Phase(
                f"step_{position}",
                f"Step to {step.u:g} V",
                position * (around_each + self.step_s),
                (position + 1) * (around_each + self.step_s),
            )
            for position, step in enumerate(self.program().steps)
        )


@dataclass(frozen=True)
class SpringIdentificationPlan:
    """Slow sweep of both tensions up and down, the joint held near 0 by antagonism (method section 3).

    Going both ways shows what is not the spring: the load cells' delay and friction between spring and load cell part
    the two ways, and the mean of both is free of it.
    """

    kind: ClassVar[str] = "spring_identification"

    F_low: float = number_setting(
        2.0, minimum=1.5, maximum=15.0, unit="N", symbol="F_low", meaning="tension where the sweep starts, above slack"
    )
    F_high: float = number_setting(
        45.0,
        minimum=20.0,
        maximum=47.0,
        unit="N",
        symbol="F_high",
        meaning="tension where the sweep turns, below the solid spring's",
    )
    sweep_s: float = number_setting(
        15.0, minimum=3.0, maximum=120.0, unit="s", symbol="t_s", meaning="time of one way up or down"
    )
    cycles: int = integer_setting(2, 1, 10, "n", "number of times up and down")
    settle_s: float = number_setting(
        2.0,
        minimum=0.5,
        maximum=30.0,
        unit="s",
        symbol="t_0",
        meaning="time at the lowest tension before the sweep starts",
    )

    def program(self) -> Program:
        """Return the sweep."""
        up_and_down = (TensionLeg(self.F_high, self.sweep_s), TensionLeg(self.F_low, self.sweep_s))
        return Program(Law.TENSION_SWEEP, tension_N=self.F_low, settle_s=self.settle_s, legs=up_and_down * self.cycles)

    def phases(self) -> tuple[Phase, ...]:
        """Return settling and every way up and down."""
        ways = [Phase("settle", "Lowest tension held", 0.0, self.settle_s)]
        for way in range(2 * self.cycles):
            start = self.settle_s + way * self.sweep_s
            name = "up" if way % 2 == 0 else "down"
            ways.append(Phase(f"{name}_{way // 2 + 1}", f"Tension {name}", start, start + self.sweep_s))
        return tuple(ways)


# Loop settings -------------------------------------------------------------------------------------
#
# What the loop is set to while an experiment runs: the tuning, and the seed of the simulator.


_T = TypeVar("_T")


@dataclass(frozen=True)
class LoopSettings(TuningSettings):
    """The tuning of an experiment and the seed of the simulator's noise."""

    seed: int = integer_setting(0, 0, 2**31 - 1, "seed", "seed of the simulator's noise")

    @property
    def tuning(self) -> TuningSettings:
        """The tuning alone."""
        return TuningSettings(**self.to_document())


def split_values(
    settings: Sequence[Setting], make: Callable[[Mapping[str, object]], _T], values: Mapping[str, object]
) -> tuple[_T, LoopSettings]:
    """Build a plan that has ``settings``, and loop settings, from one set of named values.

    Raises SettingError, OutOfRangeError.
    """
    of_loop = {item.name for item in fields(LoopSettings)}
    of_plan = {setting.name for setting in settings}
    for name, value in values.items():
        if name not in of_loop | of_plan:
            legal = (*sorted(of_plan), *sorted(of_loop))
            raise SettingError(name, value, f"unknown setting; known are {', '.join(legal)}", legal=legal)
    return (
        make({name: value for name, value in values.items() if name in of_plan}),
        build_plan(LoopSettings, {name: value for name, value in values.items() if name in of_loop}),
    )


# Profile -------------------------------------------------------------------------------------------
#
# The references and the push of a program over its whole length, as the loop will play them; for
# pictures. Pure.


Array = NDArray[np.float64]

POINTS = 400
"""So many over the whole, besides begin and end of each segment."""


class Profile(NamedTuple):
    """Times since the program began (n,) [s], q_ref (n,) [rad], S_ref (n,) [N·m/rad], F_push (n,) [N].

    n is 0 without segments.
    """

    t: Array
    q_ref: Array
    S_ref: Array
    F_push: Array


def build_profile(program: Program, q_ref: float, S_ref: float) -> Profile:
    """Return what a program asks for that begins at these references. Each segment is there from its first tick on."""
    whole = sum(round(segment.duration_s / T_s) for segment in program.segments)
    every = max(1, round(whole / POINTS))
    start, begun = Setpoint(q_ref, S_ref, 0.0), 0
    points = []
    for segment, row in zip(program.segments, make_segment_player(program.segments, start).segments, strict=True):
        ticks = round(segment.duration_s / T_s)
        chip = max(1, round(segment.period_s / T_s)) if segment.shape is Shape.PRBS else ticks + 1
        register, advanced = setpoint_player.INITIAL_REGISTER, 0
        for tick in sorted({1, *range(every, ticks, every), ticks}):
            while advanced < (tick - 1) // chip:
                register, advanced = setpoint_player.next_register(register, segment.count), advanced + 1
            target = setpoint_player.compute_setpoint(row, start, tick * T_s, register)
            points.append(((begun + tick) * T_s, target.q_ref, target.S_ref, target.F_push))
        start, begun = setpoint_player.compute_final_setpoint(row, start), begun + ticks
    return Profile(*np.array(points, dtype=np.float64).reshape(-1, 4).T)


# Plan ----------------------------------------------------------------------------------------------
#
# Plans of experiments: settings in, a ``Program`` for the loop out. Pure: the same plan gives the
# same program.
#
# Angles in rad, stiffness in N·m/rad, tensions and pushes in N, times in s.


MAX_EXCITATION_S = 600.0


@dataclass(frozen=True)
class ActuatorIdentificationPlan:
    """Closed-loop identification of G_q and G_S at one tendon tension (method section 4, figures 4 and 5).

    theta_B_ref is 0, a slow force loop holds the tension, and a maximum-length sequence moves theta_A_ref.
    """

    kind: ClassVar[str] = "actuator_identification"

    tension_N: float = number_setting(
        20.0, minimum=8.0, maximum=42.0, unit="N", symbol="F_0", meaning="tendon tension held while θ_A,ref is excited"
    )
    amplitude_rad: float = number_setting(
        1.0, minimum=0.01, maximum=2.0, unit="rad", symbol="a", meaning="amplitude of the binary sequence on θ_A,ref"
    )
    chip_s: float = number_setting(
        0.080,
        minimum=0.001,
        maximum=2.0,
        unit="s",
        symbol="t_c",
        meaning="shortest time between two changes of the sequence",
    )
    bits: int = integer_setting(7, 4, 12, "n", "length of the shift register; a period has 2^n - 1 chips")
    periods: int = integer_setting(
        2, 1, 10, "p", "periods of the sequence; the last third of all is kept for validation"
    )
    settle_s: float = number_setting(
        8.0,
        minimum=1.0,
        maximum=60.0,
        unit="s",
        symbol="t_0",
        meaning="time the tension is held before the excitation starts",
    )
    estimator: str = choice_setting(
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
        check_range(
            "chip_s",
            excitation.duration_s,
            minimum=None,
            maximum=MAX_EXCITATION_S,
            unit="s",
            remedy="take a shorter chip, fewer bits or fewer periods",
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

Plan = ExperimentPlan | IdentificationPlan
"""Every plan has a ``kind``, the ``program()`` that the loop plays and its named ``phases()``."""
