"""Plans of experiments and identifications: settings from which the program of the control loop follows."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, fields
from functools import cached_property
from typing import ClassVar, NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray

from backend.banks import TuningSettings
from backend.control import STEP_BRAKING_S, ZERO_VOLTS_S, Setpoint, setpoint_player
from backend.errors import OutOfRangeError, check_range
from backend.experiments import messages, parser
from backend.experiments.compiler import CompiledExperiment, compile_experiment
from backend.experiments.parser import ExperimentError, Lines, build_settings, find_line, parse_values, require_rules
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

# Experiment plan -----------------------------------------------------------------------------------


LAWS = tuple(law for law in Law if law not in IDENTIFYING)
KIND = "experiment"
"""Kind of the runs of an experiment, except those of PAPER_EXPERIMENTS."""


@dataclass(frozen=True)
class ExperimentPlan:
    """An experiment with values of all settings; ``kind`` is that of its runs, ``lines`` its lines in a text."""

    experiment: Experiment
    values: Mapping[str, Value]
    kind: str = KIND
    lines: Lines = field(default_factory=dict, compare=False, repr=False)

    @cached_property
    def compiled(self) -> CompiledExperiment:
        """Compiled experiment. Raises ExperimentError."""
        return compile_experiment(self.experiment, self.values, self.lines)

    def program(self) -> Program:
        """Return the program, without the gains of tuning changes, which depend on the models of the banks."""
        return Program(
            self.law,
            self.compiled.segments,
            walls=self.compiled.walls,
            contact_detections=self.compiled.contact_detections,
        )

    def phases(self) -> tuple[Phase, ...]:
        """Return the named phases."""
        return self.compiled.phases

    @property
    def law(self) -> Law:
        """Control law. Raises ExperimentError."""
        named = self.values.get(self.experiment.law, self.experiment.law)
        if named not in LAWS:
            unknown = messages.unknown_law(law=named, known=", ".join(LAWS))
            raise ExperimentError(unknown, ("law",), find_line(("law",), self.lines))
        return Law(str(named))

    @property
    def settings(self) -> tuple[Setting, ...]:
        """Settings that the experiment declares."""
        return build_settings(self.experiment, self.lines)

    def to_stored_values(self) -> dict[str, Value]:
        """Return the values to store with a run: the canonical text of the experiment, and the settings by name."""
        return {"experiment": parser.to_canonical_text(self.experiment), **self.values}


def build_experiment_plan(
    experiment: Experiment, given: Mapping[str, object], kind: str = KIND, lines: Lines | None = None
) -> ExperimentPlan:
    """Return the plan with the given settings, others at their defaults, after checking that it compiles.

    Raises ExperimentError, SettingError, OutOfRangeError.
    """
    source_lines = {} if lines is None else lines
    settings = build_settings(experiment, source_lines)
    values = parse_values(settings, given)
    plan = ExperimentPlan(experiment, values, kind, source_lines)
    require_rules(experiment, settings, values, given, source_lines)
    plan.program()
    return plan


# Identification plans ------------------------------------------------------------------------------
# Identification of motors and springs (method sections 2 and 3). Angles in rad, voltages in V,
# tensions in N, times in s.


UPPER_END = -1.5
"""Angle [rad] at which a downward step starts; tendons are slack above 0, and an upward step needs space to brake."""


@dataclass(frozen=True)
class MotorIdentificationPlan:
    """Unloaded voltage steps of both motors at once (method section 2).

    Both tendons are slack, so the motors run freely. Each upward step is followed by a downward one, which is used as
    data and keeps the motors within the range that the joint allows.
    """

    kind: ClassVar[str] = "motor_identification"

    u_low: float = number_setting(
        2.0, minimum=0.3, maximum=9.0, unit="V", symbol="u_low", meaning="smallest voltage step"
    )
    u_high: float = number_setting(
        5.0, minimum=0.5, maximum=9.5, unit="V", symbol="u_high", meaning="largest voltage step, below saturation"
    )
    levels: int = integer_setting(4, 2, 8, "n", "number of voltages from the smallest to the largest")
    travel_rad: float = number_setting(
        12.0,
        minimum=2.0,
        maximum=12.0,
        unit="rad",
        symbol="Δθ",
        meaning="rotation of a motor after which a step ends",
    )
    step_s: float = number_setting(
        2.5, minimum=0.3, maximum=10.0, unit="s", symbol="t_u", meaning="maximum duration of a step"
    )
    settle_s: float = number_setting(
        1.0, minimum=0.5, maximum=10.0, unit="s", symbol="t_0", meaning="hold time of the motors before a step"
    )

    def __post_init__(self) -> None:
        if self.u_low >= self.u_high:
            raise OutOfRangeError(
                quantity="u_low",
                value=self.u_low,
                minimum=None,
                maximum=self.u_high,
                unit="V",
                remedy=messages.keep_below_largest_step(),
                label="smallest voltage step",
            )

    def voltages(self) -> tuple[float, ...]:
        """Return the voltages [V] of the steps, applied in both directions."""
        return tuple(round(float(u), 3) for u in np.linspace(self.u_low, self.u_high, self.levels))

    def program(self) -> Program:
        """Return the program: alternating upward and downward steps."""
        lower_end = UPPER_END - self.travel_rad
        steps = (
            VoltageStep(start, u, self.step_s, self.travel_rad)
            for voltage in self.voltages()
            for start, u in ((lower_end, voltage), (UPPER_END, -voltage))
        )
        return Program(Law.MOTOR_STEPS, settle_s=self.settle_s, steps=tuple(steps))

    def phases(self) -> tuple[Phase, ...]:
        """Return one phase per step, with its maximum duration."""
        around_each = self.settle_s + ZERO_VOLTS_S + STEP_BRAKING_S
        return tuple(
            Phase(
                f"step_{position}",
                messages.voltage_step(voltage_V=step.u),
                position * (around_each + self.step_s),
                (position + 1) * (around_each + self.step_s),
            )
            for position, step in enumerate(self.program().steps)
        )


@dataclass(frozen=True)
class SpringIdentificationPlan:
    """Slow sweep of both tensions up and down, with the joint held near 0 by antagonism (method section 3).

    Delay of the load cells and friction between spring and load cell separate the rising and the falling curve; their
    mean is free of both.
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
        meaning="tension where the sweep reverses, below the trip limit F_max",
    )
    sweep_s: float = number_setting(
        15.0, minimum=3.0, maximum=120.0, unit="s", symbol="t_s", meaning="duration of one rising or falling sweep"
    )
    cycles: int = integer_setting(2, 1, 10, "n", "number of cycles, each with a rising and a falling sweep")
    settle_s: float = number_setting(
        2.0,
        minimum=0.5,
        maximum=30.0,
        unit="s",
        symbol="t_0",
        meaning="hold time at the lowest tension before the sweep starts",
    )

    def program(self) -> Program:
        """Return the program of the sweep."""
        up_and_down = (TensionLeg(self.F_high, self.sweep_s), TensionLeg(self.F_low, self.sweep_s))
        return Program(Law.TENSION_SWEEP, tension_N=self.F_low, settle_s=self.settle_s, legs=up_and_down * self.cycles)

    def phases(self) -> tuple[Phase, ...]:
        """Return the phases: settling, then each rising and falling sweep."""
        phases = [Phase("settle", messages.hold_at_lowest_tension(), 0.0, self.settle_s)]
        for sweep in range(2 * self.cycles):
            start = self.settle_s + sweep * self.sweep_s
            name = "up" if sweep % 2 == 0 else "down"
            title = messages.tension_sweep(direction=name)
            phases.append(Phase(f"{name}_{sweep // 2 + 1}", title, start, start + self.sweep_s))
        return tuple(phases)


# Actuator identification plan ----------------------------------------------------------------------


MAX_EXCITATION_S = 600.0


@dataclass(frozen=True)
class ActuatorIdentificationPlan:
    """Closed-loop identification of G_q and G_S at one tendon tension (method section 4, figures 4 and 5).

    theta_B_ref is 0, a slow force loop holds the tension, and a maximum-length sequence excites theta_A_ref.
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
        meaning="shortest time between two level changes of the sequence",
    )
    bits: int = integer_setting(7, 4, 12, "n", "length of the shift register; a period has 2^n − 1 chips")
    periods: int = integer_setting(
        2, 1, 10, "p", "periods of the sequence; the last third of the excitation is used for validation"
    )
    settle_s: float = number_setting(
        8.0,
        minimum=1.0,
        maximum=60.0,
        unit="s",
        symbol="t_0",
        meaning="hold time of the tension before the excitation starts",
    )
    estimator: str = choice_setting(
        Method.DEFAULT,
        (Method.DEFAULT, Method.ARX),
        "estimator",
        "method that estimates the models from the recording; arx is the first-order method of the paper",
    )

    def program(self) -> Program:
        """Return the program: a held tension with the excitation."""
        return Program(Law.FORCE_HOLD, tension_N=self.tension_N, settle_s=self.settle_s, excitation=self.excitation())

    def excitation(self) -> Excitation:
        """Return the excitation. Raises OutOfRangeError if it is too long."""
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
            remedy=messages.shorter_excitation(),
            label=messages.duration_of_chips(),
        )
        return excitation

    def phases(self) -> tuple[Phase, ...]:
        """Return the phases: settling and excitation."""
        end = self.program().duration_s
        return (
            Phase("settle", messages.hold_without_excitation(), 0.0, self.settle_s),
            Phase("excitation", messages.excitation(), self.settle_s, end),
        )


IdentificationPlan = ActuatorIdentificationPlan | MotorIdentificationPlan | SpringIdentificationPlan
"""Plans whose runs yield models."""

Plan = ExperimentPlan | IdentificationPlan
"""Each plan has a ``kind``, a ``program()`` for the control loop, and named ``phases()``."""


# Loop settings -------------------------------------------------------------------------------------
# Settings of the loop during an experiment: the tuning, and the seed of the simulator.


_T = TypeVar("_T")


@dataclass(frozen=True)
class LoopSettings(TuningSettings):
    """The tuning of an experiment and the seed of the simulator's noise."""

    seed: int = integer_setting(0, 0, 2**31 - 1, "seed", "seed of the simulator's noise")

    @property
    def tuning(self) -> TuningSettings:
        """The tuning without the seed."""
        return TuningSettings(**self.to_document())


def split_values(
    settings: Sequence[Setting], make: Callable[[Mapping[str, object]], _T], values: Mapping[str, object]
) -> tuple[_T, LoopSettings]:
    """Build a plan with ``settings``, and loop settings, from one mapping of values.

    Raises SettingError, OutOfRangeError.
    """
    of_loop = {item.name for item in fields(LoopSettings)}
    of_plan = {setting.name for setting in settings}
    for name, value in values.items():
        if name not in of_loop | of_plan:
            legal = (*sorted(of_plan), *sorted(of_loop))
            raise SettingError(name, value, messages.unknown_setting(known=", ".join(legal)), legal=legal)
    return (
        make({name: value for name, value in values.items() if name in of_plan}),
        build_plan(LoopSettings, {name: value for name, value in values.items() if name in of_loop}),
    )


# Profile -------------------------------------------------------------------------------------------
# References and push of a program over time, as the loop executes it, for plots.


Array = NDArray[np.float64]

PROFILE_POINTS = 400
"""Number of points of a profile, in addition to start and end of each segment."""


class Profile(NamedTuple):
    """Times since the start of the program [s], q_ref [rad], S_ref [N·m/rad] and F_push [N], each (n,).

    n is 0 for a program without segments.
    """

    t: Array
    q_ref: Array
    S_ref: Array
    F_push: Array


def build_profile(program: Program, q_ref: float, S_ref: float) -> Profile:
    """Return the profile of a program that starts at these references, including the first tick of each segment."""
    whole = sum(round(segment.duration_s / T_s) for segment in program.segments)
    every = max(1, round(whole / PROFILE_POINTS))
    start, start_tick = Setpoint(q_ref, S_ref, 0.0), 0
    points = []
    for segment, row in zip(program.segments, make_segment_player(program.segments, start).segments, strict=True):
        ticks = round(segment.duration_s / T_s)
        chip = max(1, round(segment.period_s / T_s)) if segment.shape is Shape.PRBS else ticks + 1
        register, advanced = setpoint_player.INITIAL_REGISTER, 0
        for tick in sorted({1, *range(every, ticks, every), ticks}):
            while advanced < (tick - 1) // chip:
                register, advanced = setpoint_player.next_register(register, segment.count), advanced + 1
            target = setpoint_player.compute_setpoint(row, start, tick * T_s, register)
            points.append(((start_tick + tick) * T_s, target.q_ref, target.S_ref, target.F_push))
        start, start_tick = setpoint_player.compute_final_setpoint(row, start), start_tick + ticks
    return Profile(*np.array(points, dtype=np.float64).reshape(-1, 4).T)
