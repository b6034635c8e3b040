"""Gains of the loop: conversion from commands, and the active tuning."""

from collections.abc import Sequence
from dataclasses import astuple
from typing import NamedTuple

import numpy as np

from backend.control import CascadeTuning, cascade, pid
from backend.errors import check_range
from backend.realtime import messages
from backend.realtime.commands import Event, TuningChanged
from backend.realtime.modes import CommandRejectedError
from backend.realtime.motions import BASELINES
from backend.realtime.program import IDENTIFYING, MAX_TUNINGS, EntryGains, MotorGains, Program, SetTuning
from backend.realtime.shared_state import StepContext
from backend.tuning import (
    MotorModel,
    PlantModel,
    PointModel,
    TuningParameters,
    combine_tuning,
    make_cascade_tuning,
    require_share,
)
from plant import PlantParameters

# Tuning command ------------------------------------------------------------------------------------
# Conversion between the cascade's tuning and the command that transfers it to the loop process.


def make_tuning_command(
    parameters: PlantParameters,
    lambdas: TuningParameters,
    points: Sequence[PointModel] = (),
    motor: MotorModel | None = None,
    interpolate: bool = False,
    u_plan: float = 0.0,
    k_ext: float = 0.0,
) -> SetTuning:
    """Return the command with the gains of ``make_cascade_tuning``.

    Raises TuningError.
    """
    tuning = make_cascade_tuning(parameters, lambdas, points, motor, interpolate)
    return SetTuning(
        lam_q=lambdas.lam_q,
        lam_S=lambdas.lam_S,
        motor_A=MotorGains(*tuning.motors.A),
        motor_B=MotorGains(*tuning.motors.B),
        entries=tuple(EntryGains(*map(float, row)) for row in tuning.schedule.entries),
        interpolate=interpolate,
        u_plan=u_plan,
        k_ext=k_ext,
    )


def build_cascade_tuning(command: SetTuning, plant_model: PlantModel) -> cascade.CascadeTuning:
    """Build the tuning of a command.

    Raises ValueError for a bank without entries, a gain that is not finite, or an invalid limit.
    """
    if not command.entries:
        raise ValueError(messages.no_bank_entries())
    rows = [astuple(entry) for entry in sorted(command.entries, key=lambda entry: entry.S_nominal)]
    table = np.array(rows, dtype=np.float64)
    inner = pid.MotorPairGains(
        *(pid.IPDGains(*map(float, astuple(motor))) for motor in (command.motor_A, command.motor_B))
    )
    if not (np.all(np.isfinite(table)) and np.all(np.isfinite(np.array(inner)))):
        raise ValueError(messages.gain_not_finite())
    check_range("u_plan", command.u_plan, 0.0, plant_model.bounds.u_max, "V")
    require_share(command.k_ext)
    return combine_tuning(
        plant_model=plant_model,
        inner=inner,
        entries=table,
        interpolate=command.interpolate,
        u_plan=command.u_plan,
        k_ext=command.k_ext,
    )


# Tunings -------------------------------------------------------------------------------------------
# The active tuning of the loop: the operator's, or one of a program until its end.


BIAS_NOT_CALIBRATED = messages.bias_not_calibrated()


class GainsInUse(NamedTuple):
    """Gains and their λ."""

    gains: CascadeTuning
    lambdas: TuningParameters


class ActiveGains:
    """Active tuning of the control step.

    ``number`` is that of the program's tuning, 0 for the operator's.
    """

    def __init__(self, step: StepContext, events: list[Event], gains: CascadeTuning, lambdas: TuningParameters) -> None:
        self.gains, self.lambdas = _without_feedforward(gains), lambdas
        self.number = 0
        self._step = step
        self._events = events
        self._program_gains: tuple[GainsInUse, ...] = ()  # index 0: the operator's
        step.retune(self.gains)  # no bias is calibrated yet

    def replace(self, gains: CascadeTuning, lambdas: TuningParameters) -> None:
        """Apply an operator's tuning. Raises CommandRejectedError if a program sets it."""
        if self._program_gains:
            raise CommandRejectedError(messages.program_sets_tuning())
        self._require_bias(gains)
        self._apply(GainsInUse(gains, lambdas))

    def build_for_program(self, program: Program, plant_model: PlantModel) -> tuple[GainsInUse, ...]:
        """Return the tunings of a program.

        Raises CommandRejectedError, OutOfRangeError or ValueError.
        """
        tunings = build_program_tunings(program, plant_model)
        for tuning in tunings:
            self._require_bias(tuning.gains)
        return tunings

    def _require_bias(self, gains: CascadeTuning) -> None:
        """Raise CommandRejectedError for a disturbance rejection without calibrated bias."""
        if gains.disturbance_feedforward.k_ext > 0.0 and not self._step.has_bias:
            raise CommandRejectedError(BIAS_NOT_CALIBRATED)

    def disable_feedforward(self) -> None:
        """Disable the disturbance rejection, as the bias is no longer valid."""
        self._program_gains = tuple(
            GainsInUse(_without_feedforward(one.gains), one.lambdas) for one in self._program_gains
        )
        self._apply(GainsInUse(_without_feedforward(self.gains), self.lambdas))

    def begin(self, tunings: Sequence[GainsInUse]) -> None:
        """Prepare for a program with ``tunings``, numbered from 1."""
        self._program_gains = (GainsInUse(self.gains, self.lambdas), *tunings) if tunings else ()

    def use(self, number: int, tick: int) -> None:
        """Activate a tuning of the program."""
        self.number = number
        self._apply(self._program_gains[number])
        self._events.append(TuningChanged(tick, number, self.lambdas.lam_q, self.lambdas.lam_S))

    def end(self, tick: int) -> None:
        """Restore the operator's tuning if a program has changed it."""
        if self.number:
            self.use(0, tick)
        self._program_gains = ()

    def _apply(self, tuning: GainsInUse) -> None:
        self.gains, self.lambdas = tuning
        self._step.retune(tuning.gains)


def _without_feedforward(gains: CascadeTuning) -> CascadeTuning:
    return gains._replace(disturbance_feedforward=gains.disturbance_feedforward._replace(k_ext=0.0))


def build_program_tunings(program: Program, plant_model: PlantModel) -> tuple[GainsInUse, ...]:
    """Return the tunings of a program.

    Raises CommandRejectedError, OutOfRangeError or ValueError.
    """
    check_range("tunings", len(program.tunings), None, MAX_TUNINGS, "1", label=messages.number_of_tuning_changes())
    if program.tunings and (program.law in BASELINES or program.law in IDENTIFYING):
        raise CommandRejectedError(messages.law_with_fixed_gains(law=program.law))
    for segment in program.segments:
        if not 0 <= segment.tuning <= len(program.tunings):
            raise CommandRejectedError(messages.unknown_tuning(number=segment.tuning, count=len(program.tunings)))
    return tuple(
        GainsInUse(build_cascade_tuning(command, plant_model), TuningParameters(command.lam_q, command.lam_S))
        for command in program.tunings
    )
